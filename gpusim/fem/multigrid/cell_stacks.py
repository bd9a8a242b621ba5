"""Stacks of cells: which way bricks and wedges lie on one another, from surface to surface.

A thin body is a few cells thick everywhere, whatever their shape: near a hole they may be shorter
along the surface than across. Cells are told apart by their neighbours, not by numbers or lengths,
so that blocks of a mesh may meet in any way.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from gpusim.fem.assembly.element_batches import Elements

__all__ = ["EDGES", "thin_axes"]

Float = npt.NDArray[np.float64]
Int = npt.NDArray[np.int32]
Long = npt.NDArray[np.int64]

EDGES: dict[str, tuple[tuple[tuple[int, int], ...], ...]] = {
    "hex8": (
        ((0, 1), (3, 2), (7, 6), (4, 5)),
        ((0, 3), (1, 2), (5, 6), (4, 7)),
        ((0, 4), (1, 5), (2, 6), (3, 7)),
    ),
    "wedge6": (
        ((0, 1), (3, 4)),
        ((1, 2), (4, 5)),
        ((2, 0), (5, 3)),
        ((0, 3), (1, 4), (2, 5)),
    ),
}
"""Edges of a cell along each of its axes, from one end to the other."""

# nodes of a cell: along an axis whose edges have all of them it may lie in a stack
_NODES = {"hex8": 8, "wedge6": 6}
# a stack is thin where it is at most this share of what the body measures the next way
_THIN = 1.0 / 3.0


def thin_axes(groups: Sequence[Elements], points: Float, most: int) -> list[Long] | None:
    """For each group (M,) the axis along which its cells' stack is thin and of at most ``most``
    cells, -1 where there is none. None for cells other than hex8 and wedge6.

    ``points`` (N,3) are the nodes of the cells in ``groups``.
    """
    if any(group.name not in EDGES for group in groups):
        return None
    # a face is told by the sum of its corners' random numbers, modulo 2^64
    mark = np.random.default_rng(11).integers(0, 2**63, len(points), dtype=np.uint64)
    faces, lengths, parts = [], [], []
    for number, group in enumerate(groups):
        for axis, edges in enumerate(EDGES[group.name]):
            if 2 * len(edges) < _NODES[group.name]:
                continue
            low, high = (group.cells[:, list(end)] for end in zip(*edges, strict=True))
            faces.append(np.stack([mark[low].sum(axis=1), mark[high].sum(axis=1)], axis=1))
            across = points[high].mean(axis=1) - points[low].mean(axis=1)
            lengths.append(np.linalg.norm(across, axis=1))
            parts.append((number, axis))
    stack = _stacks(np.concatenate(faces))
    length = np.concatenate(lengths)
    total = np.asarray(np.bincount(stack, weights=length)[stack], dtype=np.float64)
    cells = np.bincount(stack).astype(np.int32)[stack]
    sizes = np.sort(np.ptp(points, axis=0))
    found = [_Thinnest(len(group.cells), float(sizes[1])) for group in groups]
    first = 0
    for number, axis in parts:
        own = slice(first, first + len(groups[number].cells))
        found[number].look(axis, total[own], cells[own])
        first = own.stop
    return [one.axes(most) for one in found]


def _stacks(faces: npt.NDArray[np.uint64]) -> Int:
    """(S,) number of the stack that each cell belongs to along an axis, by its two faces (S,2)."""
    flat = faces.ravel()
    order = np.argsort(flat)
    equal = np.flatnonzero(flat[order[1:]] == flat[order[:-1]])
    one, other = order[equal] // 2, order[equal + 1] // 2
    count = len(faces)
    links = csr_matrix((np.ones(len(one), dtype=np.int8), (one, other)), shape=(count, count))
    return np.asarray(connected_components(links, directed=False)[1])


class _Thinnest:
    """Of a group's cells: the shortest stack and the next."""

    def __init__(self, count: int, size: float) -> None:
        self._least, self._next = np.full(count, np.inf), np.full(count, size)
        self._axis, self._cells = np.full(count, -1, dtype=np.int64), np.zeros(count, np.int32)

    def look(self, axis: int, length: Float, cells: Int) -> None:
        shorter = length < self._least
        self._next = np.minimum(self._next, np.where(shorter, self._least, length))
        self._least = np.where(shorter, length, self._least)
        self._axis[shorter], self._cells[shorter] = axis, cells[shorter]

    def axes(self, most: int) -> Long:
        thin = (self._cells <= most) & (self._least <= _THIN * self._next)
        return np.where(thin, self._axis, -1)
