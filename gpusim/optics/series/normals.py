"""Normals of a surface's vertices, found on the device where its vertices have moved.

They are what `gpusim.optics.geometry.feature_edges.smooth_normals` finds: sides and areas of
triangles in ``real``, because float32 would see the sides of a fine mesh to a few digits only. The
device tells where a triangle leans so far from its vertices' normals that a crease may be near,
which the host looks at then.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.gpu import Buffer, Device, Recording, compare, twin_check
from gpusim.gpu.texture_array import Texels
from gpusim.optics.geometry.feature_edges import area_normals, smooth_normals
from gpusim.optics.raster.compute_raster import sheet
from gpusim.optics.shading.looks import NONE
from gpusim.surface.topology import sorted_keys

__all__ = ["Around", "NormalsPass", "check_normals", "normals_twin"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]

SURE = 1e-6
"""Cosine by which float32 may see a triangle lean less than it does."""


@dataclass(frozen=True, eq=False)
class Around:
    """The triangles at each vertex: ``triangle[start[v] : start[v + 1]]``, uint32."""

    start: npt.NDArray[np.uint32]
    triangle: npt.NDArray[np.uint32]

    @staticmethod
    def of(triangles: Numbers, vertices: int) -> Around:
        """Those of triangles (T, 3)."""
        order, ordered = sorted_keys(triangles.reshape(-1))
        start = np.searchsorted(ordered, np.arange(vertices + 1))
        return Around(start.astype(np.uint32), (order // 3).astype(np.uint32))


class NormalsPass:
    """Normals of vertices on the device, with the side of their pattern's cells the last of three
    texels each (`gpusim.optics.raster.triangle_records`)."""

    def __init__(self, device: Device, around: Around, triangles: int) -> None:
        self.device, self.triangles = device, triangles
        self.count = len(around.start) - 1
        self._start = device.buffer(around.start, "normals.start")
        self._around = device.buffer(around.triangle, "normals.around")
        self._areas = device.texels(2 * triangles, "rgba32float", "normals.areas")

    def record(
        self,
        recording: Recording,
        points: Buffer,
        corners: Buffer,
        vertices: Texels,
        counts: Buffer,
        size: float,
        smooth_angle: float,
        cell: float,
    ) -> None:
        """Find normals of ``vertices`` at ``points``; ``corners``: three of every triangle.

        ``counts``: the last of its six words becomes 1 where a triangle leans too far from a normal
        for ``smooth_angle``, rad. ``size``: what sides of triangles are like; ``cell``: that of a
        pattern's cells.
        """
        params = {
            # a power of two changes no digit
            "scale": 2.0 ** -np.round(np.log2(size)),
            "least": np.cos(0.5 * smooth_angle) + SURE,
            "cell": cell,
        }
        values = {
            "points": points, "corners": corners, "areas": self._areas, "known": self._areas,
            "start": self._start, "around": self._around, "vertices": vertices, "counts": counts,
        }  # fmt: skip
        for entry, count in (("of_triangles", self.triangles), ("of_vertices", self.count)):
            kernel = self.device.kernel("optics/series/normals", entry)
            bindings = kernel.bind_used(params={**params, "count": count}, **values)
            recording.dispatch(kernel, bindings, threads=(count,))


def normals_twin(points: Array, triangles: Numbers, smooth_angle: float) -> tuple[Array, bool]:
    """The same in float64: normals (V, 3), and whether a triangle leans too far from one."""
    area = area_normals(points, triangles)
    normal, sharp = smooth_normals(area, triangles, len(points), smooth_angle)
    return normal.T, bool(sharp.any())


@twin_check("optics/series/normals")
def check_normals(device: Device) -> None:
    """Compare what the device finds with the twin."""
    surface = sheet(0.95, 1.3, 0.2)
    triangles, points = surface.topology.triangles, surface.points
    found = NormalsPass(device, Around.of(triangles, len(points)), len(triangles))
    vertices = device.texels(3 * len(points), "rgba32uint", "normals.vertices")
    corners = device.buffer(triangles.astype(np.uint32).reshape(-1), "normals.corners")
    for angle in (np.pi, 0.1):
        counts = device.buffer(NONE, "normals.counts")
        with device.recording("optics.normals") as recording:
            real = device.real_buffer(points.reshape(-1), "normals.points")
            found.record(recording, real, corners, vertices, counts, 0.1, angle, 0.25)
        want, leans = normals_twin(points, triangles, angle)
        got = vertices.read().view(np.float32)[2::3]
        compare("optics/series/normals", got[:, :3], want, "single")
        compare("optics/series/normals, cell", got[:, 3], np.full(len(points), 0.25), "exact")
        compare(
            "optics/series/normals, leaning", counts.read(np.uint32)[5:6], [int(leans)], "exact"
        )
