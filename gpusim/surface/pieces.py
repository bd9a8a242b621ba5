"""Curved faces cut into flat pieces, whose vertices neighbouring faces share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.arrays.sorted_unique import distinct
from gpusim.errors import InputError
from gpusim.mesh import Faces
from gpusim.mesh.shape_functions import FACE_TYPES, shape_functions

__all__ = ["Vertices", "cut"]

Array = npt.NDArray[np.float64]
Int = npt.NDArray[np.int32]
Long = npt.NDArray[np.int64]

_WIDTH = 9


@dataclass(frozen=True, eq=False)
class Vertices:
    """Points of a surface in terms of mesh nodes.

    The first ones are the nodes ``nodes`` (A,) themselves; the others (B,) lie between: node
    numbers ``between`` (B,9) and ``weights`` (B,9).
    """

    nodes: Long
    between: Long
    weights: Array

    def values(self, field: Array) -> Array:
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
    if subdivisions < 1:
        raise InputError(f"skin: subdivisions; got {subdivisions}; expected at least 1")
    if not faces.is_quadratic.any():
        nodes, pieces = _numbered(faces.nodes[:, :4])
        everyone = np.arange(len(faces), dtype=np.int64)
        return pieces, everyone, Vertices(nodes, np.zeros((0, _WIDTH), np.int64), np.zeros((0, 9)))
    rows: list[Long] = []
    corners: list[npt.NDArray[np.int64]] = []  # entries of the (node, weight) table below
    tables: list[tuple[Long, Array]] = []
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


def _lattice(triangle: bool, n: int) -> tuple[Array, Long]:
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


def _merged(nodes: Long, weights: Array) -> tuple[Vertices, Long]:
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
