"""Bricks that are numbered along three axes as on a lattice, wherever their nodes lie.

Swept, bent and moved meshes have no two cells alike, but every second sheet of their nodes can be
left out as if they had (`gpusim.fem.multigrid.geometric_coarsening`). Where a cell is along its
axes is told by its neighbours; a sheet's coordinate is how far it lies, on average, from the first.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import breadth_first_order

from gpusim.arrays.array_types import Float, Int, Long
from gpusim.arrays.ragged import along_paths
from gpusim.fem.lattice.lattice import CORNERS, Lattice, crowded, filled_grids

# corners of the sides that look along each axis, and of those that lie against them
_AHEAD = ((1, 2, 6, 5), (3, 2, 6, 7), (4, 5, 6, 7))
_BEHIND = ((0, 3, 7, 4), (0, 1, 5, 4), (0, 1, 2, 3))
# Trilinear functions of the sheets' numbers must be nearly those of place: nodes may lie this
# share of a cell beside where the kept ones around them have them, and proportions of cells may
# differ this many times
_BESIDE, _UNLIKE = 0.4, 3.0


def mapped_lattice(points: Float, block: Int) -> Lattice | None:
    """The numbers of hex8 cells (M,8) along three axes; None where there are none, or where cells
    are too unlike for sheets to be left out. Every node must be used by a cell.

    ``planes`` of the result are mean distances along each axis from the first sheet.
    """
    neighbours = [_ahead(block, axis) for axis in range(3)]
    place = _places(neighbours, len(block))
    if place is None:
        return None
    shape = tuple(int(n) + 2 for n in place.max(axis=0))
    if crowded(shape, len(points)):
        return None
    # a place by one number is looked up several times as fast as by three
    across = np.array([shape[1] * shape[2], shape[2], 1])
    number, code = np.full(len(points), -1, dtype=np.int64), place @ across
    for step, nodes in zip(CORNERS @ across, block.T, strict=True):
        number[nodes] = code + step
    if any((number[n] != code + s).any() for s, n in zip(CORNERS @ across, block.T, strict=True)):
        return None
    of_node = np.stack(np.unravel_index(number, shape), axis=1).astype(np.int32)
    grids = filled_grids(shape, of_node, place)
    if grids is None:
        return None
    lengths = _lengths(points, block)
    if not _alike(lengths):
        return None
    planes = _planes(lengths, place)
    if not _smooth(points, grids[0], planes):
        return None
    return Lattice(*grids, of_node, planes)


def _ahead(block: Int, axis: int) -> Long:
    """(M,) the cell that each one's side along ``axis`` lies against, -1 where there is none."""
    ahead, behind = block[:, _AHEAD[axis]], block[:, _BEHIND[axis]]
    count = np.int64(block.max(initial=0)) + 1
    # opposite corners tell a side from all others, but for cells that overlap
    key = behind[:, 0].astype(np.int64) * count + behind[:, 2]
    wanted = ahead[:, 0].astype(np.int64) * count + ahead[:, 2]
    order = np.argsort(key)
    at = np.minimum(np.searchsorted(key, wanted, sorter=order), len(key) - 1)
    neighbour: Long = order[at]
    return np.where((behind[neighbour] == ahead).all(axis=1), neighbour, -1)


def _places(neighbours: list[Long], count: int) -> Int | None:
    """(M,3) numbers of the cells along the axes; None where neighbours contradict each other, or
    don't reach all cells."""
    cell = np.arange(count)
    pairs = [(cell[next_ >= 0], next_[next_ >= 0]) for next_ in neighbours]
    first, second = (np.concatenate(ends) for ends in zip(*pairs, strict=True))
    graph = csr_matrix((np.ones(len(first), np.int8), (first, second)), shape=(count, count))
    _, before = breadth_first_order(graph, 0, directed=False)
    if int((before < 0).sum()) != 1:
        return None
    step = np.zeros((count, 3), dtype=np.int64)
    back = np.where(before >= 0, before, 0)
    for axis, next_ in enumerate(neighbours):
        step[:, axis] = (next_[back] == cell).astype(np.int64) - (next_ == back)
    step[0] = 0
    place = along_paths(before, step)
    for axis, (one, other) in enumerate(pairs):
        apart = place[other] - place[one]
        apart[:, axis] -= 1
        if apart.any():
            return None
    return np.asarray(place - place.min(axis=0), dtype=np.int32)


def _planes(lengths: Float, place: Int) -> tuple[Float, Float, Float]:
    """Coordinates of the sheets: sums of the cells' mean lengths."""
    x, y, z = (
        np.concatenate([[0.0], np.cumsum(
            np.bincount(place[:, axis], weights=length) / np.bincount(place[:, axis])
        )])
        for axis, length in enumerate(lengths)
    )  # fmt: skip
    return x, y, z


def _lengths(points: Float, block: Int) -> Float:
    """(3,M) lengths of the cells along each axis, from side to side."""
    corner = [points[nodes] for nodes in block.T]
    middle = [
        [(corner[a] + corner[b] + corner[c] + corner[d]) / 4.0 for a, b, c, d in sides]
        for sides in zip(_BEHIND, _AHEAD, strict=True)
    ]
    return np.stack([np.linalg.norm(end - begin, axis=1) for begin, end in middle])


def _alike(lengths: Float) -> bool:
    """Whether all cells are of about the same proportions."""
    if not lengths.min(initial=np.inf) > 0.0:
        return False
    ratios = np.log(lengths / lengths[[1, 2, 0]])
    return bool(np.abs(ratios - np.median(ratios, axis=1)[:, None]).max() <= np.log(_UNLIKE))


def _smooth(points: Float, node: Int, planes: tuple[Float, Float, Float]) -> bool:
    """Whether nodes lie about where those beside them along each axis have them."""
    for axis, plane in enumerate(planes):
        numbers = np.moveaxis(node, axis, 0)
        below, inner, above = numbers[:-2], numbers[1:-1], numbers[2:]
        inside = (below >= 0) & (inner >= 0) & (above >= 0)
        share = ((plane[1:-1] - plane[:-2]) / (plane[2:] - plane[:-2]))[:, None, None]
        share = np.broadcast_to(share, inner.shape)[inside][:, None]
        low, middle, high = (points[one[inside]] for one in (below, inner, above))
        beside = np.linalg.norm((1.0 - share) * low + share * high - middle, axis=1)
        if (beside > 0.5 * _BESIDE * np.linalg.norm(high - low, axis=1)).any():
            return False
    return True
