"""The skin of a finite-element mesh as a surface: only boundary faces reach the renderer."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.mesh import Faces, Mesh
from gpusim.surface.paint import Paint
from gpusim.surface.surface import PaintFrame, Surface, face_normals

__all__ = ["Skin"]

Array = npt.NDArray[np.float64]


class Skin:
    """Boundary faces of a mesh with compact vertex numbers.

    ``faces`` are the mesh's boundary faces; ``nodes`` (P,) the mesh nodes on them, in the order of
    the surface's points.
    """

    def __init__(self, mesh: Mesh, faces: Faces) -> None:
        self.mesh, self.faces = mesh, faces
        self.nodes = np.unique(faces.nodes[faces.nodes >= 0])
        compact = np.full(mesh.node_count + 1, -1, np.int32)
        compact[self.nodes] = np.arange(len(self.nodes), dtype=np.int32)
        self._compact = compact[faces.nodes]  # -1 picks the last entry, which stays -1
        self._keys = faces.cell.astype(np.int64) * 8 + faces.local
        self._order = np.argsort(self._keys, kind="stable")

    def numbers(self, selected: Faces) -> npt.NDArray[np.int64]:
        """Positions of ``selected`` boundary faces within this skin.

        Raises
        ------
        InputError
            A selected face isn't on the boundary.
        """
        keys = selected.cell.astype(np.int64) * 8 + selected.local
        at = np.searchsorted(self._keys[self._order], keys)
        at = self._order[np.minimum(at, len(self._order) - 1)]
        if not (self._keys[at] == keys).all():
            raise InputError("skin: got a selection with inner faces; expected boundary faces only")
        return at

    def surface(
        self,
        paint: Mapping[str, Paint],
        region: npt.NDArray[np.int32],
        frames: Mapping[str, PaintFrame],
        name: str,
    ) -> Surface:
        """The undeformed surface with one paint per region; ``region`` (F,) per boundary face."""
        points = self.mesh.points[self.nodes]
        return Surface(points, self._compact, paint, region, points, frames, name=name)

    def moved(self, surface: Surface, u: Array) -> Surface:
        """``surface`` with its points displaced by the nodal displacements u (N, 3)."""
        return surface.moved(surface.rest + u[self.nodes])

    def locate(self, points: Array) -> tuple[npt.NDArray[np.int32], Array]:
        """Where undeformed ``points`` (M, 3) lie on the skin: nodes (M, 4) and weights (M, 4).

        A field's value there is ``sum(weights * field[nodes])`` with the face's own shape
        functions (bilinear on quadrilaterals).

        Raises
        ------
        InputError
            A point lies farther from every face than 1e-6 of the mesh's size.
        """
        faces = self.faces
        corners = faces.corners
        centre, normal = corners.mean(axis=1), face_normals(faces.points, faces.nodes)
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        radius = np.linalg.norm(corners - centre[:, None], axis=2).max(axis=1)
        low, high = self.mesh.bounds
        tolerance = 1e-6 * float(np.max(high - low))
        nodes = np.zeros((len(points), 4), np.int32)
        weights = np.zeros((len(points), 4))
        for i, point in enumerate(points):
            relative = point - centre
            off = np.abs(np.sum(relative * normal, axis=1))
            near = np.linalg.norm(relative, axis=1) <= radius + tolerance
            rows = np.flatnonzero(near & (off <= tolerance))
            best, outside = -1, np.inf
            for row in rows:
                share = _weights(point, corners[row], bool(faces.is_triangle[row]))
                if -share.min() < outside:
                    best, outside, weights[i] = int(row), -float(share.min()), share
            if best < 0 or not outside <= 1e-6:
                raise InputError(
                    f"skin: got point {point.tolist()}; expected one on the surface, between "
                    f"{low.tolist()} and {high.tolist()}"
                )
            nodes[i] = np.maximum(faces.nodes[best], 0)
        return nodes, weights


def _weights(point: Array, corners: Array, triangle: bool) -> Array:
    """Shape functions (4,) of a face at the point nearest to ``point`` in its plane."""
    if triangle:
        edges = np.stack([corners[1] - corners[0], corners[2] - corners[0]], axis=1)
        a, b = np.linalg.lstsq(edges, point - corners[0], rcond=None)[0]
        return np.array([1.0 - a - b, a, b, 0.0])
    signs = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    xi = np.zeros(2)
    for _ in range(20):
        shape = 0.25 * (1.0 + xi[0] * signs[:, 0]) * (1.0 + xi[1] * signs[:, 1])
        slope = 0.25 * np.stack(
            [signs[:, 0] * (1.0 + xi[1] * signs[:, 1]), signs[:, 1] * (1.0 + xi[0] * signs[:, 0])]
        )
        step = np.linalg.lstsq((slope @ corners).T, point - shape @ corners, rcond=None)[0]
        xi = np.clip(xi + step, -3.0, 3.0)
        if np.abs(step).max() < 1e-13:
            break
    result: Array = 0.25 * (1.0 + xi[0] * signs[:, 0]) * (1.0 + xi[1] * signs[:, 1])
    return result
