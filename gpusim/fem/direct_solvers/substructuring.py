"""A direct solver for long lattices: congruent sections are condensed once.

The body is cut into slabs, one per layer of cells along its longest axis. Two neighbours are
joined by eliminating the plane between them (static condensation, Guyan 1965, exact here), pairs
of pairs likewise, until one superelement with two end planes is left. Joining the same two
superelements gives the same result, so a uniform beam of n slabs takes about log2(n) joins in
place of n, and the factors of a beam of any length fit the cache. A notch or a change of material
adds a few distinct joins of its own.

With plane matrices a, b, c of a superelement on its left and right unknowns, [[a, b], [b^T, c]],
and M = c_left + a_right of the plane in the middle:

    a = a_left - b_left M^-1 b_left^T,  b = -b_left M^-1 b_right,
    c = c_right - b_right^T M^-1 b_right.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.linalg.blas import dtrsm
from scipy.linalg.lapack import dpotrf

from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.arrays.unique import unique_rows
from gpusim.fem.assembly.element_batches import Group
from gpusim.fem.assembly.stiffness_rounding import indefinite
from gpusim.fem.lattice.lattice import CORNERS, Lattice
from gpusim.parallel.threads import shared


@dataclass(frozen=True, eq=False)
class Slabs:
    """Slabs of a lattice along ``axis``.

    ``kind`` (S,) number of each slab among the distinct ones, ``first`` the layer of the first of
    each kind, ``planes`` the free unknowns (flat, of 3N) of the S+1 planes, ``rounds`` the joins.
    """

    axis: int
    kind: Long
    first: Long
    planes: list[Long]
    rounds: list[_Round]

    @property
    def operations(self) -> float:
        """Multiplications and additions of all distinct joins."""
        total = 0.0
        for one in self.rounds:
            for left, middle, right in one.sizes:
                total += middle**3 / 3.0 + middle**2 * (left + right)
                total += middle * (left + right) ** 2
        return total

    @property
    def nbytes(self) -> int:
        """Of the factors."""
        return sum(8 * m * (m + a + b) for one in self.rounds for a, m, b in one.sizes)


@dataclass(frozen=True, eq=False)
class _Round:
    """One round of joins: ``pairs`` (J,2) distinct kinds of the round before, ``number`` (S/2,)
    which of them each join is, ``sizes`` (left, middle, right) unknowns of each distinct one,
    ``odd`` whether the last superelement stays as it is."""

    pairs: Long
    number: Long
    sizes: list[tuple[int, int, int]]
    odd: bool


def cut_slabs(group: Group, lattice: Lattice, free: Bool) -> Slabs | None:
    """Slabs along the longest axis of a lattice; None where a plane holds no free unknown inside,
    so that the body falls apart there."""
    axis = int(np.argmax(lattice.cell.shape))
    layers = lattice.cell.shape[axis]
    kind = lattice.grid(group.matrix_of)
    held = np.full((*lattice.node.shape, 3), -1, dtype=np.int64)
    held[tuple(lattice.place.T)] = free
    layer = np.moveaxis(kind, axis, 0).reshape(layers, -1)
    plane = np.moveaxis(held, axis, 0).reshape(layers + 1, -1)
    _, of_plane = unique_rows(plane)
    _, of_layer = unique_rows(layer)
    first, slab = unique_rows(np.stack([of_layer, of_plane[:-1], of_plane[1:]], axis=1))
    nodes = np.moveaxis(lattice.node, axis, 0).reshape(layers + 1, -1)
    unknowns = []
    for number in range(layers + 1):
        plane_nodes = nodes[number][nodes[number] >= 0].astype(np.int64)
        flat = (3 * plane_nodes[:, None] + np.arange(3)).ravel()
        unknowns.append(flat[free[plane_nodes].ravel()])
    sizes = np.array([len(one) for one in unknowns])
    if not (sizes[1:-1] > 0).all():
        return None
    return Slabs(axis, slab, first, unknowns, _rounds(slab, sizes))


def _rounds(slab: Long, sizes: Long) -> list[_Round]:
    """The joins, round by round; the planes' sizes follow from the kinds."""
    kind, left, right = slab, np.arange(len(slab)), np.arange(1, len(slab) + 1)
    rounds = []
    while len(kind) > 1:
        count = len(kind) // 2
        pairs = np.stack([kind[: 2 * count : 2], kind[1 : 2 * count : 2]], axis=1)
        where, number = unique_rows(pairs)
        table = [
            (int(sizes[left[2 * k]]), int(sizes[right[2 * k]]), int(sizes[right[2 * k + 1]]))
            for k in where.tolist()
        ]
        odd = len(kind) % 2 == 1
        rounds.append(_Round(pairs[where], number, table, odd))
        joined = number
        ends = right[1 : 2 * count : 2]
        if odd:
            # the lone one at the end keeps its matrices, under a number of its own
            joined = np.append(joined, len(where))
            ends = np.append(ends, right[-1])
        left = left[::2][: len(joined)]
        kind, right = joined, ends
    return rounds


@dataclass(eq=False)
class _Super:
    """A superelement: its plane matrices, and how it was joined."""

    a: Float
    b: Float
    c: Float


@dataclass(eq=False)
class _Join:
    """What solving needs of a join: the factor U of M = U^T U, and U^-T [b_left^T, b_right]."""

    upper: Float
    left: Float
    right: Float


@dataclass(eq=False)
class SubstructuredFactor:
    """The condensed stiffness K / scale of a lattice cut into slabs."""

    slabs: Slabs
    group: Group
    lattice: Lattice
    scale: float
    name: str = "direct"
    _joins: list[list[_Join]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._kind = self.lattice.grid(self.group.matrix_of)
        current = shared(self._slab, self.slabs.first.tolist())
        last_kind = int(self.slabs.kind[-1])
        for one in self.slabs.rounds:
            pairs = [(current[a], current[b]) for a, b in one.pairs.tolist()]
            done = shared(lambda pair: _join(*pair), pairs)
            self._joins.append([join for _, join in done])
            lone = [current[last_kind]] if one.odd else []
            current = [superelement for superelement, _ in done] + lone
            last_kind = len(done) if one.odd else int(one.number[-1])
        last = current[-1]
        whole = np.block([[last.a, last.b], [last.b.T, last.c]])
        self._end = _factor(whole)

    def _slab(self, layer: int) -> _Super:
        """Plane matrices of one layer of cells."""
        axis, lattice = self.slabs.axis, self.lattice
        cell = np.moveaxis(lattice.cell, axis, 0)[layer]
        at = np.argwhere(cell >= 0)
        place = np.insert(at, axis, layer, axis=1)
        matrices = self.group.matrices[self._kind[tuple(place.T)]] / self.scale
        corner = place[:, None, :] + CORNERS[None]
        nodes = lattice.node[corner[..., 0], corner[..., 1], corner[..., 2]].astype(np.int64)
        unknowns = (3 * nodes[:, :, None] + np.arange(3)).reshape(len(nodes), 24)
        low, high = self.slabs.planes[layer], self.slabs.planes[layer + 1]
        size = len(low) + len(high)
        local = _positions(np.concatenate([low, high]), unknowns)
        row = np.broadcast_to(local[:, :, None], matrices.shape)
        column = np.broadcast_to(local[:, None, :], matrices.shape)
        inside = (row >= 0) & (column >= 0)
        total = np.bincount(
            (row * size + column)[inside], weights=matrices[inside], minlength=size * size
        )
        dense: Float = np.asarray(total, dtype=np.float64).reshape(size, size)
        cut = len(low)
        return _Super(dense[:cut, :cut], dense[:cut, cut:], dense[cut:, cut:])

    def apply(self, r: Float) -> Float:
        """K^-1 r for (L,3N) r; zero on fixed unknowns."""
        planes = [np.ascontiguousarray(r[:, one].T) for one in self.slabs.planes]
        cases = len(r)
        # forward: which planes are the ends of each superelement, and what loads they gather
        ends = np.arange(len(planes))
        middles: list[tuple[Long, Long, Long, list[Float]]] = []
        for one, joins in zip(self.slabs.rounds, self._joins, strict=True):
            count = len(one.number)
            left, middle, right = (ends[k : k + 2 * count : 2] for k in range(3))
            solved: list[Float] = [np.zeros((0, cases))] * count
            for number, join in enumerate(joins):
                alike = np.flatnonzero(one.number == number)
                load = np.concatenate([planes[middle[k]] for k in alike], axis=1)
                half = dtrsm(1.0, join.upper, load, lower=0, trans_a=1)
                to_left, to_right = join.left.T @ half, join.right.T @ half
                for place, k in enumerate(alike):
                    part = slice(cases * place, cases * (place + 1))
                    solved[k] = half[:, part]
                    planes[left[k]] = planes[left[k]] - to_left[:, part]
                    planes[right[k]] = planes[right[k]] - to_right[:, part]
            middles.append((left, middle, right, solved))
            ends = np.append(ends[: 2 * count + 1 : 2], ends[2 * count + 1 :])
        first, last = int(ends[0]), int(ends[-1])
        both = np.concatenate([planes[first], planes[last]])
        if len(both):
            both = dtrsm(1.0, self._end, both, lower=0, trans_a=1)
            both = dtrsm(1.0, self._end, both, lower=0)
        x: list[Float] = [np.zeros((0, cases))] * len(planes)
        x[first], x[last] = np.split(both, [len(planes[first])])
        for (left, middle, right, solved), one, joins in zip(
            reversed(middles), reversed(self.slabs.rounds), reversed(self._joins), strict=True
        ):
            for number, join in enumerate(joins):
                alike = np.flatnonzero(one.number == number)
                half = np.concatenate([solved[k] for k in alike], axis=1)
                half = half - join.left @ np.concatenate([x[left[k]] for k in alike], axis=1)
                half = half - join.right @ np.concatenate([x[right[k]] for k in alike], axis=1)
                full = dtrsm(1.0, join.upper, half, lower=0)
                for place, k in enumerate(alike):
                    x[middle[k]] = full[:, cases * place : cases * (place + 1)]
        result = np.zeros_like(r)
        for unknowns, value in zip(self.slabs.planes, x, strict=True):
            result[:, unknowns] = value.T
        return result


def _positions(wanted: Long, values: Long) -> Long:
    """Where each of ``values`` stands in ``wanted`` (distinct numbers), -1 where it doesn't."""
    if not len(wanted):
        return np.full(values.shape, -1, dtype=np.int64)
    order = np.argsort(wanted)
    at = order[np.minimum(np.searchsorted(wanted, values, sorter=order), len(wanted) - 1)]
    return np.where(wanted[at] == values, at, -1)


def _factor(matrix: Float) -> Float:
    if not len(matrix):
        return matrix
    upper, info = dpotrf(matrix, lower=0, clean=1)
    if info > 0:
        raise indefinite("direct solver")
    return np.asfortranarray(upper)


def _join(left: _Super, right: _Super) -> tuple[_Super, _Join]:
    upper = _factor(left.c + right.a)
    lower_left = dtrsm(1.0, upper, np.asfortranarray(left.b.T), lower=0, trans_a=1)
    lower_right = dtrsm(1.0, upper, np.asfortranarray(right.b), lower=0, trans_a=1)
    joined = _Super(
        left.a - lower_left.T @ lower_left,
        -(lower_left.T @ lower_right),
        right.c - lower_right.T @ lower_right,
    )
    return joined, _Join(upper, lower_left, lower_right)
