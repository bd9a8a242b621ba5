"""Markers of a scene: which a measurement asks for, how they move, how wide a camera sees them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.measure.structures.marker_crosses import LEAST_WIDTH
from gpusim.optics.camera.pinhole import Camera
from gpusim.pipeline.scene_objects.moving_bodies import SceneObjects
from gpusim.pipeline.scene_objects.surfaces import BodyParts
from gpusim.scene import Scene
from gpusim.scene.description import model as m
from gpusim.validation import require


@dataclass(frozen=True, eq=False)
class MarkerSet:
    """The markers of a measurement: ``count`` on bodies, then those that can't move.

    ``position`` (M, 3), m, on the unloaded structure; ``size`` (M,), m; ``names``, ``group_names``
    (M,); ``groups``: body number and paint, in the order asked for.
    """

    groups: tuple[tuple[int, m.MarkersTable], ...]
    count: int
    position: Float
    size: Float
    names: tuple[str, ...]
    group_names: tuple[str, ...]

    def displacement(
        self, objects: SceneObjects, of_body: Callable[[int], Iterable[Float]]
    ) -> Float:
        """(K, M, 3) of the markers on bodies, for K fields (N, 3) that there are ``of_body``."""
        parts, first = [], 0
        for body, paint in self.groups:
            own = self.position[first : first + len(paint.markers)]
            first += len(own)
            nodes, weights = objects.bodies[body].skin.locate(own)
            u = np.stack([field[nodes] for field in of_body(body)])
            parts.append(np.einsum("mk,fmka->fma", weights, u))
        return np.concatenate(parts, axis=1)

    def true_motion(self, objects: SceneObjects, frames: Sequence[int]) -> tuple[Float, Float]:
        """True displacements in m of the markers on bodies: (M, 3) in the first frame, and
        (F, M, 3) from there to each of the ``frames``."""
        every = self.displacement(
            objects, lambda body: [objects.displacement(body, frame) for frame in (0, *frames)]
        )
        return every[0], every[1:] - every[0]

    def exposure_drift(self, objects: SceneObjects, camera: m.CameraTable) -> Float | None:
        """(F, M, 3) m by which the mean of an exposure lies off its middle, frame by frame; None
        where no body is known in between, or the ``camera`` sees an instant."""
        if camera.shutter is None:
            return None
        frames, exposure = range(len(objects.frames)), camera.shutter.exposure
        if not any(map(objects.vibrations, frames)):
            return None
        return self.displacement(
            objects, lambda body: (objects.drift(body, frame, exposure) for frame in frames)
        )


def collect_markers(
    spec: m.MarkerMeasureTable, scene: Scene, bodies: Sequence[BodyParts]
) -> MarkerSet:
    """The markers of the paints of ``spec`` on bodies, in order, and on props."""
    painted = [(k, paint) for k, parts in enumerate(bodies) for paint in parts.body.paints]
    by_name = {paint.name: (k, paint) for k, paint in painted if isinstance(paint, m.MarkersTable)}
    groups = tuple(by_name[name] for name in spec.groups)
    on_props = {paint.name: paint for prop in scene.props for paint in prop.paints}
    paints = [paint for _, paint in groups]
    still = [paint for name in spec.static if isinstance(paint := on_props[name], m.MarkersTable)]
    every = [(paint, marker) for paint in (*paints, *still) for marker in paint.markers]
    return MarkerSet(
        groups=groups,
        count=sum(len(paint.markers) for paint in paints),
        position=np.array([marker.position for _, marker in every]),
        size=np.array([paint.size for paint, _ in every]),
        names=tuple(marker.name for _, marker in every),
        group_names=tuple(paint.name for paint, _ in every),
    )


def check_widths(what: str, marks: MarkerSet, camera: Camera) -> Float:
    """Widths (M,) px of the markers; raises InputError for one that is too small."""
    widths: Float = camera.K[0, 0] * marks.size / camera.to_camera(marks.position)[:, 2]
    narrow = int(np.argmin(widths))
    place = f"{what}: marker {marks.names[narrow]!r} is too small for camera {camera.name!r}"
    least = LEAST_WIDTH / 0.95
    expected = f"more than {least:.1f} px (a larger marker, a longer lens or more pixels)"
    require(widths[narrow] >= least, place, f"a width of {widths[narrow]:.1f} px", expected)
    return widths
