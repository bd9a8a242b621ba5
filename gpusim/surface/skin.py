"""The skin of a finite-element mesh as a surface: boundary faces, cut into flat pieces.

Curved faces become several pieces, whose vertices neighbouring faces share.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy

from gpusim.arrays.array_types import Float, Int, Long
from gpusim.arrays.unique import distinct
from gpusim.errors import InputError
from gpusim.mesh import Faces, Mesh
from gpusim.mesh.nearest_places import nearest_places
from gpusim.mesh.polygons import cut_at_dents
from gpusim.mesh.shape_functions import FACE_TYPES, shape_functions
from gpusim.surface.frames import Frame, face_normals
from gpusim.surface.paint import Paint
from gpusim.surface.surface import Surface
from gpusim.validation import require, unmasked

_WIDTH = 9
# Pieces along a quadratic face's side, and up to how many such faces: at most 130,000 pieces.
_SUBDIVISIONS = ((8, 600), (4, 8000))


@dataclass(frozen=True, eq=False)
class Vertices:
    """Points of a surface in terms of mesh nodes.

    The first ones are the nodes ``nodes`` (A,) themselves; the others (B,) lie between: node
    numbers ``between`` (B,9) and ``weights`` (B,9).
    """

    nodes: Long
    between: Long
    weights: Float

    def values(self, field: Float) -> Float:
        """A nodal field (N,…) at the vertices (A+B,…)."""
        own = field[self.nodes]
        if not len(self.between):
            return own
        return np.concatenate([own, np.einsum("bk,bk...->b...", self.weights, field[self.between])])


def cut(faces: Faces, subdivisions: int) -> tuple[Int, Long, Vertices]:
    """(K,4) vertex numbers of the flat pieces (triangles end with -1), the face (K,) of each, and
    the vertices. A linear face is one piece, a quadratic one ``subdivisions``^2 of them.

    Raises InputError where ``subdivisions`` is less than 1.
    """
    require(subdivisions >= 1, "skin: subdivisions", subdivisions, "at least 1")
    if not faces.is_quadratic.any():
        nodes, pieces = _numbered(faces.nodes[:, :4])
        everyone = np.arange(len(faces), dtype=np.int64)
        return pieces, everyone, Vertices(nodes, np.zeros((0, _WIDTH), np.int64), np.zeros((0, 9)))
    rows: list[Long] = []
    corners: list[Long] = []  # entries of the (node, weight) table below
    tables: list[tuple[Long, Float]] = []
    offset = 0
    for name, own in faces.kinds():
        linear = name in ("tri3", "quad4")
        place, pattern = _lattice(name.startswith("tri"), 1 if linear else subdivisions)
        share = shape_functions(name, place)
        share[np.abs(share) < 1e-12] = 0.0
        nodes = np.zeros((len(own), len(place), _WIDTH), np.int64)
        weights = np.zeros((len(own), len(place), _WIDTH))
        columns = list(FACE_TYPES[name])
        nodes[:, :, : len(columns)] = faces.nodes[own][:, None, columns]
        weights[:, :, : len(columns)] = share
        number = offset + np.arange(len(own))[:, None] * len(place) + np.arange(len(place))
        corners.append(np.where(pattern < 0, -1, number[:, np.maximum(pattern, 0)]).reshape(-1, 4))
        rows.append(np.repeat(own, len(pattern)))
        tables.append((nodes.reshape(-1, _WIDTH), weights.reshape(-1, _WIDTH)))
        offset += number.size
    vertices, number_of = _merged(
        np.concatenate([nodes for nodes, _ in tables]), np.concatenate([w for _, w in tables])
    )
    face = np.concatenate(rows)
    order = np.argsort(face, kind="stable")
    entry = np.concatenate(corners)[order]
    pieces = np.where(entry < 0, -1, number_of[np.maximum(entry, 0)]).astype(np.int32)
    return pieces, face[order], vertices


def _numbered(nodes: Int) -> tuple[Long, Int]:
    """The distinct node numbers, and ``nodes`` as positions among them (-1 stays)."""
    used = distinct(nodes[nodes >= 0]).astype(np.int64)
    position = np.searchsorted(used, np.maximum(nodes, 0))
    return used, np.where(nodes < 0, -1, position).astype(np.int32)


def _lattice(triangle: bool, n: int) -> tuple[Float, Long]:
    """Reference coordinates (L,2) of a face's lattice, and its pieces (n*n,4)."""
    if not triangle:
        step = np.arange(n + 1) * (2.0 / n) - 1.0
        t, s = np.meshgrid(step, step, indexing="ij")
        j, i = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
        first = (j * (n + 1) + i).ravel()
        pieces = np.stack([first, first + 1, first + n + 2, first + n + 1], axis=1)
        return np.stack([s.ravel(), t.ravel()], axis=1), pieces
    places = [(a, b) for b in range(n + 1) for a in range(n + 1 - b)]
    number = {place: k for k, place in enumerate(places)}
    rows = []
    for a, b in places:
        if a + b < n:
            rows.append([number[a, b], number[a + 1, b], number[a, b + 1], -1])
        if a + b < n - 1:
            rows.append([number[a + 1, b], number[a + 1, b + 1], number[a, b + 1], -1])
    return np.array(places, dtype=np.float64) / n, np.array(rows)


def _merged(nodes: Long, weights: Float) -> tuple[Vertices, Long]:
    """Distinct vertices of (E,9) nodes and weights, and which of them each row is.

    A row with a single weight of one is a node. Others are equal if they have the same nodes with
    the same weights, as the two sides of an edge give.
    """
    single = (weights != 0.0).sum(axis=1) == 1
    of_single = nodes[single, np.argmax(weights[single], axis=1)]
    own = np.unique(of_single)
    number = np.empty(len(nodes), np.int64)
    number[single] = np.searchsorted(own, of_single)
    where = np.where(weights == 0.0, -1, nodes)[~single]
    order = np.argsort(where, axis=1, kind="stable")
    where = np.take_along_axis(where, order, axis=1)
    share = np.take_along_axis(weights[~single], order, axis=1)
    # a fraction of the edge differs by rounding between its two directions
    key = np.concatenate([where, np.round(share * 2.0**40).astype(np.int64)], axis=1)
    _, first, inverse = np.unique(key, axis=0, return_index=True, return_inverse=True)
    number[~single] = len(own) + inverse.reshape(-1)
    return Vertices(own, np.maximum(where[first], 0), share[first]), number


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
        pieces, face, self._vertices = cut(faces, subdivisions)
        whole, piece = cut_at_dents(self.at_vertices(mesh.points), pieces)
        self.pieces, self.face_of_piece = whole.astype(np.int32), face[piece]
        self.cell_of_piece = faces.cell[self.face_of_piece]
        self._keys = faces.cell.astype(np.int64) * 8 + faces.local
        self._order = np.argsort(self._keys, kind="stable")

    def __repr__(self) -> str:
        return f"Skin({len(self.nodes)} nodes, {len(self.pieces)} pieces)"

    def numbers(self, selected: Faces) -> Long:
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

    def at_vertices(self, values: Float) -> Float:
        """A nodal field (N,…) at the surface's vertices (P,…), by the faces' shape functions."""
        return self._vertices.values(values)

    def surface(
        self,
        paint: Mapping[str, Paint],
        region: Int,
        frames: Mapping[str, Frame],
        name: str,
    ) -> Surface:
        """The undeformed surface with one paint per region; ``region`` (F,) per boundary face."""
        points = self.at_vertices(self.mesh.points)
        own = np.asarray(region)[self.face_of_piece]
        return Surface(points, self.pieces, paint, own, points, frames, name=name)

    def moved(self, surface: Surface, u: Float) -> Surface:
        """``surface`` with its points displaced by the nodal displacements u (N, 3)."""
        return surface.moved(surface.rest + self.at_vertices(u))

    def locate(self, points: Float) -> tuple[Int, Float]:
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
        reach = 1.5 * radius + tolerance
        of_point: list[Long] = []
        queries = np.where(np.isfinite(points), points, low)  # what is NaN is near no face below
        around = scipy.spatial.cKDTree(centre).query_ball_point(queries, reach.max())
        for point, rows in zip(points, around, strict=True):
            some = np.array(rows, np.int64)
            relative = point - centre[some]
            off = np.abs(np.sum(relative * normal[some], axis=1))
            near = np.linalg.norm(relative, axis=1) <= reach[some]
            of_point.append(np.sort(some[near & (off <= 2.0 * bulge[some] + tolerance)]))
        owner = np.repeat(np.arange(len(points)), [len(rows) for rows in of_point])
        face = np.concatenate([np.zeros(0, np.int64), *of_point])
        outside, distance, share = nearest_places(faces, face, points[owner])
        outside[~(distance <= tolerance)] = np.inf
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
