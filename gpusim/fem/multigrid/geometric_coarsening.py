"""Coarser levels by geometry: midside nodes dropped, lattice planes left out.

Both keep nodes of the finer level and interpolate between them, so a coarse element's matrix is
the sum of Q^T K Q over the elements inside it (Galerkin), found per *distinct* element: no sparse
matrix product is needed, and congruent elements stay congruent.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.sparse import csr_matrix

from gpusim.arrays.array_types import Bool, Float, Int, Long
from gpusim.arrays.unique import unique_rows
from gpusim.fem.assembly.element_batches import (
    DistinctGroup,
    Elements,
    Group,
    held_matrices,
    masked,
)
from gpusim.fem.elements.straight_tetrahedra import StraightTets
from gpusim.fem.lattice.lattice import CORNERS, Lattice
from gpusim.fem.multigrid.transfer import PlaneWeights, plane_shares
from gpusim.mesh.cell_types import CELL_TYPES

# planes are left out along an axis while its spacing is below this multiple of the finest one
_STRETCHED = 1.9
# the thinnest part must keep at least this many elements across: fewer can't bend
_ACROSS = 4
_LEAST_GAIN = 0.6
_CHUNK = 2048


@dataclass(frozen=True, eq=False)
class Coarser:
    """``interpolation`` (N,K) from the coarse nodes; ``kept`` (K,) are their numbers on the
    fine level; ``groups`` the coarse elements, fixed unknowns zeroed, none where they would have to
    be formed from those of a tangent; ``lattice`` of the coarse nodes, or None."""

    interpolation: csr_matrix | PlaneWeights
    kept: Int
    groups: list[Elements]
    lattice: Lattice | None


def drop_midsides(groups: Sequence[Elements], free: Bool) -> Coarser:
    """Quadratic elements become linear ones on their corners (p-multigrid)."""
    count = len(free)
    corner = np.zeros(count, dtype=bool)
    for group in groups:
        corner[group.cells[:, : CELL_TYPES[group.name].corners].ravel()] = True
    kept = np.flatnonzero(corner).astype(np.int32)
    number = np.full(count, -1, dtype=np.int32)
    number[kept] = np.arange(len(kept), dtype=np.int32)
    rows, columns, values = [kept], [number[kept]], [np.ones(len(kept))]
    done = corner.copy()
    coarse: list[Group] = []
    formed: list[Elements] = []
    for group in groups:
        kind = CELL_TYPES[group.name]
        for local, parents in enumerate(kind.parents, start=kind.corners):
            node, first = np.unique(group.cells[:, local], return_index=True)
            new = ~done[node]
            node, first = node[new], first[new]
            done[node] = True
            rows.append(np.repeat(node, len(parents)).astype(np.int32))
            columns.append(number[group.cells[np.ix_(first, np.array(parents))]].ravel())
            values.append(np.full(len(node) * len(parents), 1.0 / len(parents)))
        if not isinstance(group, Group | DistinctGroup):
            continue  # a tangent's: they would have to answer again, and their sum is there
        if isinstance(group, DistinctGroup) and isinstance(group.source, StraightTets):
            # linear elements are theirs without midsides, but for fixed unknowns
            touched = np.asarray(~free[group.cells].all(axis=(1, 2)))
            cells = number[group.cells[~touched, :4]]
            formed.append(DistinctGroup("tet4", cells, group.source.chosen(~touched).linear()))
            group = DistinctGroup(group.name, group.cells[touched], group.source.chosen(touched))
        coarse.append(_linear(group, free, number))
    weights = csr_matrix(
        (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))),
        shape=(count, len(kept)),
    )
    stored = [masked(group, free[kept]) for group in _joined(coarse)]
    return Coarser(weights, kept, [one for one in (*formed, *stored) if len(one.cells)], None)


def _linear(group: Elements, free: Bool, number: Int) -> Group:
    kind = CELL_TYPES[group.name]
    cells = number[group.cells[:, : kind.corners]]
    weight = np.zeros((kind.nodes, kind.corners))
    weight[np.arange(kind.corners), np.arange(kind.corners)] = 1.0
    for local, parents in enumerate(kind.parents, start=kind.corners):
        weight[local, list(parents)] = 1.0 / len(parents)
    spread: Float = np.asarray(np.kron(weight, np.eye(3)), dtype=np.float64)
    if not isinstance(group, Group):
        held = ~free[group.cells].reshape(-1, 3 * kind.nodes)
        of_cell = np.arange(len(group.cells))

        def without_held(which: Long) -> Float:
            return group.at(which) * ~(held[which, :, None] | held[which, None, :])

        return Group(kind.linear, cells, of_cell, _galerkin(without_held, len(of_cell), spread))
    of_cell, extra = held_matrices(group, free)
    parts = [
        _galerkin(matrices.__getitem__, len(matrices), spread)
        for matrices in (group.matrices, extra)
    ]
    return Group(kind.linear, cells, of_cell, np.concatenate(parts))


def _galerkin(at: Callable[[Long], Float], count: int, spread: Float) -> Float:
    """(count,m,m) Q^T K Q of matrices K that ``at`` gives of some numbers, with ``spread`` Q."""
    result = np.empty((count, spread.shape[1], spread.shape[1]))
    for first in range(0, count, _CHUNK):
        which = np.arange(first, min(first + _CHUNK, count))
        result[which] = np.matmul(spread.T, np.matmul(at(which), spread))
    return result


def _joined(groups: list[Group]) -> list[Group]:
    """One group per cell type."""
    result: dict[str, Group] = {}
    for group in groups:
        old = result.get(group.name)
        if old is not None:
            group = Group(
                group.name,
                np.concatenate([old.cells, group.cells]),
                np.concatenate([old.matrix_of, group.matrix_of + len(old.matrices)]),
                np.concatenate([old.matrices, group.matrices]),
            )
        result[group.name] = group
    return list(result.values())


def drop_planes(group: Group, lattice: Lattice, free: Bool) -> Coarser | None:
    """Every second plane left out where that is fit (see ``coarse_lattice``), with elements."""
    weights = coarse_lattice(lattice)
    if weights is None:
        return None
    coarse, kept = weights.coarse, weights.kept
    parts = _inside(lattice, coarse, weights.keep, masked(group, free))
    return Coarser(weights, kept, [masked(parts, free[kept])], coarse)


def coarse_lattice(lattice: Lattice) -> PlaneWeights | None:
    """Weights of a lattice without every second plane; None where too little would be gained.

    Planes on which the body begins or ends stay, so that coarse cells are full or empty. All
    planes stay along an axis whose spacing is already coarse. A body with a thin part is left to
    aggregation: trilinear functions bend too stiffly, within its plane as well as across.
    """
    keep = _kept_planes(lattice)
    if keep is None:
        return None
    shape = tuple(len(one) for one in keep)
    if np.prod(shape) > _LEAST_GAIN * np.prod(lattice.node.shape):
        return None
    node = lattice.node[np.ix_(*keep)]
    place = np.argwhere(node >= 0).astype(np.int32)
    number = np.full(shape, -1, dtype=np.int32)
    number[tuple(place.T)] = np.arange(len(place), dtype=np.int32)
    filled = lattice.cell[np.ix_(*(one[:-1] for one in keep))] >= 0
    cell = np.full(filled.shape, -1, dtype=np.int32)
    cell[filled] = np.arange(int(filled.sum()), dtype=np.int32)
    planes = tuple(lattice.planes[axis][keep[axis]] for axis in range(3))
    coarse = Lattice(number, cell, place, (planes[0], planes[1], planes[2]))
    return PlaneWeights(lattice, coarse, keep)


def _kept_planes(lattice: Lattice) -> list[Long] | None:
    """Plane numbers to keep along each axis; None where some part is thin."""
    solid = lattice.cell >= 0
    spacing = [np.diff(one) for one in lattice.planes]
    finest = min(float(np.median(one)) for one in spacing)
    keep = []
    for axis in range(3):
        lines = np.moveaxis(solid, axis, 0).reshape(solid.shape[axis], -1)
        count = len(lines)
        if np.median(spacing[axis]) > _STRETCHED * finest:
            keep.append(np.arange(count + 1))
            continue
        if _thinnest(lines) < 2 * _ACROSS:
            return None
        change = (lines[1:] != lines[:-1]).any(axis=1)
        borders = np.concatenate([[0], np.flatnonzero(change) + 1, [count]])
        inside = [np.arange(a, b, 2) for a, b in pairwise(borders)]
        keep.append(np.concatenate([*inside, [count]]))
    return keep


def _thinnest(lines: Bool) -> int:
    """Fewest solid cells one after the other, down the columns of (n,m)."""
    edge = np.zeros((1, lines.shape[1]), dtype=np.int8)
    step = np.diff(np.concatenate([edge, lines.astype(np.int8), edge]), axis=0).T
    # by column, so that the n-th beginning belongs to the n-th end
    return int((np.nonzero(step == -1)[1] - np.nonzero(step == 1)[1]).min(initial=len(lines)))


def _inside(lattice: Lattice, coarse: Lattice, keep: list[Long], group: Group) -> Group:
    """Coarse elements: sums over the one to eight fine ones inside each."""
    at, nodes = coarse.corner_nodes()
    place = np.stack(np.unravel_index(at, coarse.cell.shape), axis=1)
    kind = lattice.grid(group.matrix_of)
    first = [keep[axis][place[:, axis]] for axis in range(3)]
    double = [np.diff(keep[axis])[place[:, axis]] == 2 for axis in range(3)]
    columns = []
    for child in CORNERS:
        here = np.ones(len(place), dtype=bool)
        for axis in range(3):
            here &= double[axis] if child[axis] else True
        spot = [np.where(here, first[axis] + child[axis], 0) for axis in range(3)]
        columns.append(np.where(here, kind[spot[0], spot[1], spot[2]], -1))
    for axis in range(3):
        _, share = plane_shares(lattice.planes[axis], keep[axis])
        middle = np.where(double[axis], share[first[axis] + 1 * double[axis]], -1.0)
        columns.append(np.rint(middle * 2.0**40).astype(np.int64))
    key = np.stack(columns, axis=1)
    representative, number = unique_rows(key)
    chosen = key[representative]
    matrices = np.zeros((len(chosen), 24, 24))
    share = chosen[:, 8:] * 2.0**-40
    for local, child in enumerate(CORNERS):
        has = np.flatnonzero(chosen[:, local] >= 0)
        for start in range(0, len(has), _CHUNK):
            part = has[start : start + _CHUNK]
            spread = _child_weights(child, share[part])
            fine = group.matrices[chosen[part, local]]
            matrices[part] += np.matmul(spread.transpose(0, 2, 1), np.matmul(fine, spread))
    return Group("hex8", nodes, number, 0.5 * (matrices + matrices.transpose(0, 2, 1)))


def _child_weights(child: Long, share: Float) -> Float:
    """(C,24,24): nodes of child cell ``child`` from the corners of its coarse cell.

    ``share`` (C,3) is where the middle plane lies, negative where there is none.
    """
    weight = np.ones((len(share), 8, 8))
    for axis in range(3):
        middle = share[:, axis]
        low = np.where(child[axis] == 1, middle, 0.0)
        high = np.where(child[axis] == 1, 1.0, np.where(middle < 0.0, 1.0, middle))
        end = np.stack([low, high], axis=1)[:, CORNERS[:, axis]]
        upper = CORNERS[:, axis] == 1
        weight *= np.where(upper[None, None, :], end[:, :, None], 1.0 - end[:, :, None])
    spread = np.zeros((len(share), 8, 3, 8, 3))
    for k in range(3):
        spread[:, :, k, :, k] = weight
    return spread.reshape(len(share), 24, 24)
