"""Where a surface's vertices lie on the image, found on the device from their places in the world.

The device reads vertices as `gpusim.optics.raster.triangle_records.vertex_blocks` writes them on
the host: positions in fixed point, with remainders. For hundreds of thousands of vertices the host
takes longer for that than the device for their pixels. Here it is done in ``real``, from places
that are uploaded as they are, and only where they have moved. Vertices that may not be drawn as
they are (behind the camera, far beside the image) are told from the others; then the host looks at
all.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.gpu import Buffer, Device, Recording, compare, twin_check
from gpusim.gpu.texture_array import Texels
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.geometry.clipping import GUARD, Screen
from gpusim.optics.geometry.triangle_corners import in_camera
from gpusim.optics.probes.paints import sheets_setup
from gpusim.optics.shading.looks import NONE

__all__ = ["TIMES", "Projection", "check_projection", "fill", "project_twin"]

Array = npt.NDArray[np.float64]

STEPS = 65536
"""Of a pixel, and of one of these."""

TIMES = 8.0
"""Up to how much shorter or longer the depths of vertices may be than the usual one."""


def split(values: Array) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """float64 as a sum of two float32."""
    high = values.astype(np.float32)
    return high, (values - high).astype(np.float32)


@dataclass(frozen=True, eq=False)
class Projection:
    """Vertices that the device makes, as several programs read them.

    ``vertices``: three texels each, see `gpusim.optics.raster.triangle_records`; ``screen``: column
    and row in 1/65536 px. ``depth``: the usual one, which 1 / depth is relative to. ``origin`` (3,)
    float32: places are taken from there, as a body that lies far from zero keeps its digits then.
    """

    camera: Camera
    count: int
    depth: float
    origin: npt.NDArray[np.float32]
    vertices: Texels
    screen: Buffer

    @staticmethod
    def of(camera: Camera, vertices: Texels, depth: float, near: Array) -> Projection:
        """That of ``vertices`` whose other texels are known, which lie about the place ``near``
        (3,)."""
        count = vertices.count // 3
        screen = vertices.device.pool.take(8 * count, "project.screen")  # type: ignore[attr-defined]
        return Projection(camera, count, depth, near.astype(np.float32), vertices, screen)

    @property
    def inverse_depth(self) -> float:
        """1 / depth that those of the vertices are relative to."""
        return 1.0 / self.depth

    @property
    def near(self) -> float:
        """What 1 / depth is scaled by to stay below 1."""
        return 0.999 * self.depth / TIMES

    def record(
        self,
        recording: Recording,
        points: Buffer,
        counts: Buffer,
    ) -> None:
        """Project ``points`` (V, 3) into the first texels; the last of six ``counts`` becomes 1
        where one may not be drawn as it is."""
        camera = self.camera
        kernel = recording.device.kernel("optics/series/project")  # type: ignore[attr-defined]
        world = camera.camera_from_world[:3].copy()
        world[:, 3] += world[:, :3] @ self.origin.astype(np.float64)
        world_high, world_low = split(world)
        lens = np.zeros((2, 4))
        lens[:, :3] = camera.K[:2]
        lens_high, lens_low = split(lens)
        depth_high, depth_low = split(np.array(self.depth))
        params = {
            "count": self.count, "depth_high": depth_high, "depth_low": depth_low,
            "times": TIMES,
            "low": np.full(2, -GUARD), "high": np.array([camera.width, camera.height]) + GUARD,
            "world_high": world_high, "world_low": world_low, "origin": np.append(self.origin, 0.0),
            "lens_high": lens_high, "lens_low": lens_low,
        }  # fmt: skip
        bindings = kernel.bind(
            params=params, points=points, vertices=self.vertices, screen=self.screen, counts=counts
        )  # fmt: skip
        recording.dispatch(kernel, bindings, threads=(self.count,))


def fill(recording: Recording, vertices: Texels, which: int, words: npt.NDArray[np.uint32]) -> None:
    """Write ``words`` (V, 4) into the second (1) or the last (2) of vertices' three texels."""
    kernel = recording.device.kernel("optics/series/project", "fill")  # type: ignore[attr-defined]
    own = recording.device.buffer(words, "project.words")  # type: ignore[attr-defined]
    params = {"count": len(words), "texel": which}
    bindings = kernel.bind(filled=params, words=own, vertices=vertices)
    recording.dispatch(kernel, bindings, threads=(len(words),))


def project_twin(
    camera: Camera, points: Array, depth: float
) -> tuple[npt.NDArray[np.int64], Array, npt.NDArray[np.bool_]]:
    """Columns and rows (V, 2) in steps of 2^-32 px, offsets of 1 / depth (V,), and which vertices
    (V,) may be drawn as they are."""
    at = in_camera(camera, points)
    share = at[:, 2] / depth
    good = (share > 1.0 / TIMES) & (share < TIMES)
    place = np.full((len(points), 2), np.inf)
    place[good] = Screen(camera).ideal(at[good])
    good &= (place > -GUARD).all(axis=1)
    good &= (place < np.array([camera.width, camera.height]) + GUARD).all(axis=1)
    steps, offset = np.zeros((len(points), 2), np.int64), np.zeros(len(points))
    whole = np.floor(place[good] * STEPS)
    steps[good] = STEPS * whole.astype(np.int64)
    steps[good] += ((place[good] * STEPS - whole) * STEPS).astype(np.int64)
    offset[good] = depth / at[good, 2] - 1.0
    return steps, offset, good


@twin_check("optics/series/project")
def _check(device: Device) -> None:
    camera = sheets_setup(layer=True).view.camera
    rng = np.random.default_rng(17)
    points = rng.normal(size=(301, 3)) * [0.7, 0.6, 0.4] + [0.0, 0.0, 4.0]
    for stray in (False, True):
        if stray:
            points[57], points[211], points[300] = (0.0, 0.0, -3.0), (900.0, 0.0, 9.0), (0, 0, 90.0)
        check_projection(device, camera, points)


def check_projection(device: Device, camera: Camera, points: Array) -> None:
    """Compare what the device makes of vertices with the twin."""
    rng, count = np.random.default_rng(18), len(points)
    painted = rng.integers(0, 1 << 30, (count, 4)).astype(np.uint32)
    normals = rng.normal(size=(count, 4)).astype(np.float32)
    vertices = device.texels(3 * count, "rgba32uint", "project.vertices")
    found = Projection.of(camera, vertices, 4.0, points[0])
    counts = device.buffer(NONE, "project.counts")
    with device.recording("optics.project") as recording:
        found.record(recording, device.real_buffer(points.reshape(-1), "project.points"), counts)
        fill(recording, vertices, 1, painted)
        fill(recording, vertices, 2, normals.view(np.uint32))
    steps, offset, good = project_twin(camera, points, found.depth)
    words = vertices.read().reshape(count, 12)[good]
    rest = np.stack([words[:, 3] & np.uint32(65535), words[:, 3] >> np.uint32(16)], axis=1)
    got = words[:, :2].view(np.int32).astype(np.int64) * STEPS + rest
    places = got / STEPS**2, steps[good] / STEPS**2
    # px, some steps
    compare("optics/series/project, places", *places, atol=1e-9, rtol=0.0)
    compare("optics/series/project, depths", words[:, 2].view(np.float32), offset[good], "single")
    compare("optics/series/project, paint", words[:, 4:8], painted[good], "exact")
    compare("optics/series/project, normals", words[:, 8:].view(np.float32), normals[good], "exact")
    nearest = np.floor((got + STEPS // 2) / STEPS)
    screen = found.screen.read(np.int32, (count, 2))[good]
    compare("optics/series/project, screen", screen, nearest, "exact")
    compare(
        "optics/series/project, strays", counts.read(np.uint32)[5:], [int(not good.all())], "exact"
    )
