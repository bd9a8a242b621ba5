"""Images of one fine surface in a series: the device looks at all of its vertices, the host at few.

From the second image in a row on, what a surface's triangles and its pattern are is on the device
(`gpusim.optics.series.resident`). Then nothing but where vertices are has to be found for another
image, and the device finds it (`gpusim.optics.series.normals`, `gpusim.optics.series.project`). The
host takes some thousand triangles for all, and the surface's border: whether it is one layer, which
way its triangles look and how large they are. The device, which looks at every one, tells where
that was wrong, and the image is begun again by `gpusim.optics.geometry.view.look`.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
import numpy.typing as npt

from gpusim.gpu import Buffer, Device, Recording
from gpusim.gpu.texture_array import most_texels
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.geometry.clipping import GUARD, Screen, wound
from gpusim.optics.geometry.pixel_footprint import regions_of
from gpusim.optics.geometry.single_layer import snapped, winds_once
from gpusim.optics.geometry.surface_normals import Shape, shapes_of
from gpusim.optics.geometry.triangle_corners import CHUNK, in_camera
from gpusim.optics.geometry.view import View
from gpusim.optics.light.lights import Light
from gpusim.optics.raster.compute_raster import Sight
from gpusim.optics.raster.triangle_records import Records
from gpusim.optics.raster.vertex_buffers import Drawn
from gpusim.optics.series.late_vertices import LateVertices
from gpusim.optics.series.project import TIMES, Projection
from gpusim.optics.series.resident import Resident
from gpusim.optics.shading.glance import may_glance
from gpusim.optics.shading.lighting import casts_shadows
from gpusim.optics.shading.looks import EVEN, NONE, SAMPLED
from gpusim.optics.shading.setup import Setup
from gpusim.optics.shading.speckled import may_be_speckled
from gpusim.surface.surface import Surface

__all__ = ["LateSight"]

Array = npt.NDArray[np.float64]

FEWEST = 100_000
"""Triangles from which on it is worth while."""

SEEN = 0.5
"""Share of the triangles (of those that are looked at) that are in the image: with fewer it is
better to leave the others out."""

MOST = 4_000_000
"""Triangles of an image that is made at once."""

ROOM = 0.5
"""Of what vertices may be beside the image, or nearer or farther than others: as far as those that
are looked at may be."""


class LateDrawn(Drawn):
    """Triangles whose vertices the device projects."""

    def __init__(self, device: Device, view: View, found: Projection, corners: Buffer) -> None:
        self.device, self.label, self._view = device, "shade", view
        self.near, self.corners, self._screen = found.near, corners, found.screen

    @cached_property
    def screen(self) -> Buffer:
        return self._screen

    @cached_property
    def fixed(self) -> npt.NDArray[np.int32]:
        return self._view.fixed()

    @cached_property
    def inverse(self) -> npt.NDArray[np.float32]:
        return self._view.raster_depth()[1]


class LateSight(Sight):
    """Where the triangles of a view are that is one layer, before any vertex is looked at."""

    late = True

    def __init__(
        self, device: Device, view: View, rows: int, resident: Resident, shape: Shape,
        turned: bool, depth: float, size: float,
    ) -> None:  # fmt: skip
        self.resident, self._shape, self._turned, self._size = resident, shape, turned, size
        self._found = Projection.of(view.camera, resident.vertices, depth, shape.points[0])
        self._side = 1.0
        drawn = LateDrawn(device, view, self._found, resident.corners(turned))
        super().__init__(device, view, rows, drawn)
        self.counts = counts = device.buffer(NONE, "late.counts")
        # the device begins with that while the host sets up paints and lights
        with device.recording("optics.project") as recording:
            resident.prepare(recording, shape, turned, counts, size)
            self._found.record(recording, resident.points(shape), counts)

    @staticmethod
    def of(
        device: Device,
        surfaces: Sequence[Surface],
        camera: Camera,
        lights: Sequence[Light] | None,
        rows: int,
    ) -> LateSight | None:
        """One of what a camera sees in a series, or None where all has to be looked at; ``rows`` of
        a band."""
        if len(surfaces) != 1 or lights is None or camera.lens is not None:
            return None
        surface = surfaces[0]
        if not device.atomics64 or casts_shadows(lights):
            return None
        count = len(surface.topology.triangles)
        if not FEWEST <= count <= MOST or 3 * len(surface.points) > most_texels(device):
            return None
        resident = Resident.of(device, surface)
        if resident is None or resident.steady is None:
            return None
        steady, shape = resident.steady, shapes_of(surfaces)[0]
        if shape.smooth_known and shape.smooth[1].any():
            return None
        sampled = _Sampled.of(steady.corner(False), shape.points, camera)
        if sampled is None:
            return None
        screen, corner = Screen(camera), steady.corner(sampled.turned)
        table = LateVertices(steady, shape, screen, sampled.turned)
        ends = table.some(np.concatenate(steady.border)).place
        if not winds_once(snapped(np.stack(np.split(ends, 2), axis=1)), camera.height):
            return None
        source = steady.edge_source(sampled.turned)
        start, end = (corner[source[:, 0], (source[:, 1] + k) % 3] for k in (0, 1))
        edges = np.stack([table.some(vertices).place for vertices in (start, end)], axis=1)
        view = View(
            camera, table, corner, steady.paint, steady.topology.source, regions_of(surface),
            edges, steady.body, source, EVEN * sampled.largest, layer=True,
            largest=sampled.largest,
        )  # fmt: skip
        if not (may_glance(view, lights) or may_be_speckled(view, lights)):
            return None
        depth = _usual_depth(shape.points, camera)
        if not depth > 0.0:
            return None
        return LateSight(device, view, rows, resident, shape, sampled.turned, depth, sampled.size)

    def records(self, setup: Setup) -> Records:
        """The records of a setup, whose vertices `prepare` makes."""
        featured = setup.table.paints["featured"] > 0
        self._side = float(setup.table.paints["cell"][featured].max(initial=0.0)) or 1.0
        found = self._found
        return Records(setup, self.drawn, found.vertices, found.inverse_depth, looked=False)

    def prepare(self, recording: Recording) -> None:
        assert self.counts is not None
        self.resident.prepare(
            recording, self._shape, self._turned, self.counts, self._size, self._side
        )  # fmt: skip

    def release(self) -> None:
        super().release()
        self.device.pool.give(self._found.screen)


def _usual_depth(points: Array, camera: Camera) -> float:
    """Of points (P, 3) in the world, by the mean of 1 / depth; 0 where some aren't ahead."""
    # no matrix product: its threads wait busily for the next one, on the device's processors
    T, total = camera.camera_from_world[2], 0.0
    for first in range(0, len(points), CHUNK):
        x, y, z = points[first : first + CHUNK].T
        depth = x * T[0]
        depth += T[1] * y
        depth += T[2] * z
        depth += T[3]
        if not depth.min() > 0.0:
            return 0.0
        total += float(np.divide(1.0, depth, out=depth).sum())
    return len(points) / total


class _Sampled:
    """What some triangles tell of all: whether they look away, the longest side of a box round one,
    px, the usual depth and the usual length of a side."""

    def __init__(self, turned: bool, largest: float, depth: float, size: float) -> None:
        self.turned, self.largest, self.depth, self.size = turned, largest, depth, size

    @staticmethod
    def of(corner: npt.NDArray[np.int64], points: Array, camera: Camera) -> _Sampled | None:
        """Of triangles (T, 3); None where those aren't alike enough to tell."""
        some = corner[:: max(len(corner) // SAMPLED, 1)]
        world = points[some.T]
        at = in_camera(camera, world.reshape(-1, 3)).reshape(world.shape)
        z = at[..., 2]
        depth = float(1.0 / np.mean(1.0 / z)) if z.min() > 0.0 else 0.0
        times = 1.0 + ROOM * (TIMES - 1.0)
        if not (z.min() * times > depth and z.max() < times * depth):
            return None
        place = Screen(camera).ideal(at)
        low, high = place.min(axis=0), place.max(axis=0)
        size = np.array([camera.width, camera.height])
        beyond = (low < -ROOM * GUARD) | (high > size + ROOM * GUARD)
        within = ((high > 0.0) & (low < size - 1.0)).all(axis=1)
        front, flat = wound(list(place[..., 0]), list(place[..., 1]))
        if beyond.any() or flat.any() or front.any() != front.all() or within.mean() < SEEN:
            return None
        largest = float((high - low).max())
        side = float(np.abs(world[1] - world[0]).max(axis=1).mean())
        return _Sampled(not front.any(), largest, depth, side)
