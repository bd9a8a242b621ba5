"""The skin of a finite-element mesh as a surface: only boundary faces reach the renderer."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.mesh import Faces, Mesh
from gpusim.mesh.shape_functions import FACE_TYPES, shape_functions, shape_gradients
from gpusim.surface.frames import Frame
from gpusim.surface.paint import Paint
from gpusim.surface.pieces import cut
from gpusim.surface.plane import face_normals
from gpusim.surface.surface import Surface
from gpusim.validation import unmasked

__all__ = ["Skin"]

Array = npt.NDArray[np.float64]

# Pieces along a quadratic face's side, and up to how many such faces: at most 130,000 pieces.
_SUBDIVISIONS = ((8, 600), (4, 8000))


@unmasked()
class Skin:
    """Boundary faces of a mesh, cut into flat pieces with compact vertex numbers.

    A linear face is one piece. A quadratic one is cut into ``subdivisions``^2 pieces whose
    vertices lie on it and move with it: with 2 they are its nodes, and the middle of an 8-noded
    one. Neighbours share the vertices between them. By default a coarse mesh is cut finer (8 or 4,
    else 2), because the curve between nodes is what a camera sees of a few large faces.

    ``faces`` are the mesh's boundary faces and ``nodes`` the nodes on them, ``pieces`` (K,4) int32
    the surface's faces, ``face_of_piece`` (K,) the boundary face that each is of, and
    ``cell_of_piece`` (K,) its cell.

    Examples
    --------
    >>> bar = gs.mesh.box(size=(1, 0.1, 0.1), divisions=(4, 1, 1))
    >>> skin = gs.Skin(bar, gs.mesh.boundary_faces(bar))
    >>> skin.pieces.shape
    (18, 4)
    """

    def __init__(self, mesh: Mesh, faces: Faces, subdivisions: int | None = None) -> None:
        self.mesh, self.faces, self.nodes = mesh, faces, faces.node_numbers()
        if subdivisions is None:
            curved = int(faces.is_quadratic.sum())
            subdivisions = next((n for n, most in _SUBDIVISIONS if curved <= most), 2)
        self.pieces, self.face_of_piece, self._vertices = cut(faces, subdivisions)
        self.cell_of_piece = faces.cell[self.face_of_piece]
        self._keys = faces.cell.astype(np.int64) * 8 + faces.local
        self._order = np.argsort(self._keys, kind="stable")

    def __repr__(self) -> str:
        return f"Skin({len(self.nodes)} nodes, {len(self.pieces)} pieces)"

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

    def at_vertices(self, values: Array) -> Array:
        """A nodal field (N,…) at the surface's vertices (P,…), by the faces' shape functions."""
        return self._vertices.values(values)

    def surface(
        self,
        paint: Mapping[str, Paint],
        region: npt.NDArray[np.int32],
        frames: Mapping[str, Frame],
        name: str,
    ) -> Surface:
        """The undeformed surface with one paint per region; ``region`` (F,) per boundary face."""
        points = self.at_vertices(self.mesh.points)
        own = np.asarray(region)[self.face_of_piece]
        return Surface(points, self.pieces, paint, own, points, frames, name=name)

    def moved(self, surface: Surface, u: Array) -> Surface:
        """``surface`` with its points displaced by the nodal displacements u (N, 3)."""
        return surface.moved(surface.rest + self.at_vertices(u))

    def locate(self, points: Array) -> tuple[npt.NDArray[np.int32], Array]:
        """Where undeformed ``points`` (M, 3) lie on the skin: nodes (M, w) and weights (M, w).

        A field's value there is ``sum(weights * field[nodes])`` with the face's own shape
        functions; w = 4 on linear meshes, up to 9 on quadratic ones.

        Raises
        ------
        InputError
            A point lies farther from every face than 1e-6 of the mesh's size.
        """
        faces = self.faces
        corners = faces.corners
        centre, normal = corners.mean(axis=1), face_normals(faces.points, faces.nodes)
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        real = faces.nodes >= 0
        own = faces.points[np.maximum(faces.nodes, 0)] - centre[:, None]
        radius = np.where(real, np.linalg.norm(own, axis=2), 0.0).max(axis=1)
        # a curved face bulges out of the plane of its corners, a little more than its nodes do
        bulge = np.where(real, np.abs(np.einsum("fki,fi->fk", own, normal)), 0.0).max(axis=1)
        low, high = self.mesh.bounds
        tolerance = 1e-6 * float(np.max(high - low))
        names = np.empty(len(faces), dtype=object)
        for name, rows in faces.kinds():
            names[rows] = name
        reach = 1.5 * radius + tolerance
        # along the body's longest axis only a few faces are near a point
        axis = int(np.argmax(high - low))
        order = np.argsort(centre[:, axis], kind="stable")
        first, last = (
            np.searchsorted(centre[order, axis], points[:, axis] + side * reach.max())
            for side in (-1.0, 1.0)
        )
        of_point: list[npt.NDArray[np.int64]] = []
        for point, begin, end in zip(points, first, last, strict=True):
            some = order[begin:end]
            relative = point - centre[some]
            off = np.abs(np.sum(relative * normal[some], axis=1))
            near = np.linalg.norm(relative, axis=1) <= reach[some]
            of_point.append(np.sort(some[near & (off <= 2.0 * bulge[some] + tolerance)]))
        owner = np.repeat(np.arange(len(points)), [len(rows) for rows in of_point])
        face = np.concatenate([np.zeros(0, np.int64), *of_point])
        outside, share = np.full(len(face), np.inf), np.zeros((len(face), faces.nodes.shape[1]))
        for name in np.unique(names[face].astype(str)):
            some = np.flatnonzero(names[face] == name)
            columns = list(FACE_TYPES[name])
            place = faces.points[faces.nodes[face[some]][:, columns]]
            beyond, distance, part = _nearest(name, place, points[owner[some]])
            outside[some] = np.where(distance <= tolerance, beyond, np.inf)
            share[some[:, None], columns] = part
        order = np.lexsort((outside, owner))
        which, first = np.unique(owner[order], return_index=True)
        best = order[first]
        found = np.zeros(len(points), dtype=bool)
        found[which] = outside[best] <= 1e-6
        if not found.all():
            raise InputError(
                f"skin: got point {points[int(np.argmin(found))].tolist()}; expected one on the "
                f"surface, between {low.tolist()} and {high.tolist()}"
            )
        nodes = np.maximum(faces.nodes[face[best]], 0).astype(np.int32)
        return nodes, share[best]


def _nearest(name: str, nodes: Array, point: Array) -> tuple[Array, Array, Array]:
    """How far outside their faces (reference coordinates) the nearest places of the extended faces
    (n, k, 3) to points (n, 3) are, their distances, and the shape functions (n, k) there.
    Gauss-Newton iteration, all at once."""
    triangle = name.startswith("tri")
    xi = np.full((len(point), 2), 1.0 / 3.0 if triangle else 0.0)
    left = np.arange(len(point))
    for _ in range(30):
        own, at = nodes[left], xi[left]
        slope = np.einsum("nka,nkd->nad", own, shape_gradients(name, at))
        gap = point[left] - np.einsum("nk,nka->na", shape_functions(name, at), own)
        step = np.einsum("nda,na->nd", np.linalg.pinv(slope), gap)
        xi[left] = np.clip(at + step, -3.0, 3.0)
        # a place beside its face stays at a limit: that is no reason to go on with all the others
        left = left[np.abs(xi[left] - at).max(axis=1) >= 1e-13]
        if not left.size:
            break
    share = shape_functions(name, xi)
    a, b = xi.T
    outside = (
        np.maximum(np.maximum(-a, -b), a + b - 1.0)
        if triangle
        else np.maximum(np.abs(a), np.abs(b)) - 1.0
    )
    gap = point - np.einsum("nk,nka->na", share, nodes)
    return outside, np.linalg.norm(gap, axis=1), share
