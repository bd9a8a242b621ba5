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

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg.blas import dtrsm
from scipy.linalg.lapack import dpotrf, dpotri

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

    def eliminate(self, load: Float) -> tuple[Float, Float, Float]:
        """Of loads (Q,m) in the middle: what `substitute` needs, and what they do to the ends."""
        half = dtrsm(1.0, self.upper, load.T, lower=0, trans_a=1)
        return half.T, (self.left.T @ half).T, (self.right.T @ half).T

    def substitute(self, half: Float, left: Float, right: Float) -> Float:
        """Displacements (Q,m) in the middle, of those at the ends."""
        rest = half.T - self.left @ left.T
        rest = rest - self.right @ right.T
        return np.asarray(dtrsm(1.0, self.upper, rest, lower=0).T)

    @property
    def inverted(self) -> _InvertedJoin:
        """The same in products alone."""
        inverse, _ = dpotri(self.upper)
        lower = [dtrsm(1.0, self.upper, end, lower=0) for end in (self.left, self.right)]
        whole = np.triu(inverse) + np.triu(inverse, 1).T
        return _InvertedJoin(np.hstack([whole, *lower]), self.left.shape[1])


@dataclass(eq=False)
class _InvertedJoin:
    """``whole`` (m,m+a+c): M^-1 and M^-1 [b_left^T, b_right]; ``left`` is a."""

    whole: Float
    left: int

    def eliminate(self, load: Float) -> tuple[Float, Float, Float]:
        """As `_Join` does."""
        middle = len(self.whole)
        alone, to_left, to_right = np.split(load @ self.whole, [middle, middle + self.left], axis=1)
        return alone, to_left, to_right

    def substitute(self, alone: Float, left: Float, right: Float) -> Float:
        """As `_Join` does."""
        ends = np.concatenate([left, right], axis=1)
        return np.asarray(alone - ends @ self.whole[:, len(self.whole) :].T)


@dataclass(eq=False)
class _Elimination:
    """By the same ``join``: of planes in the middle of others, ``planes`` (3,J) left, middle, right
    of so many unknowns (``sizes``)."""

    join: _Join | _InvertedJoin
    planes: Long
    sizes: tuple[int, int, int]


@dataclass(eq=False)
class SubstructuredFactor:
    """The condensed stiffness K / scale of a lattice cut into slabs."""

    slabs: Slabs
    group: Group
    lattice: Lattice
    scale: float
    name: str = "direct"
    _eliminations: list[_Elimination] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._kind = self.lattice.grid(self.group.matrix_of)
        sizes = [len(one) for one in self.slabs.planes]
        # (planes, most) where the unknowns of each are; -1 stands for none
        self._at = np.full((len(sizes), max(sizes)), -1)
        for row, unknowns in zip(self._at, self.slabs.planes, strict=True):
            row[: len(unknowns)] = unknowns
        current = shared(self._slab, self.slabs.first.tolist())
        last_kind = int(self.slabs.kind[-1])
        ends = np.arange(len(sizes))
        for one in self.slabs.rounds:
            pairs = [(current[a], current[b]) for a, b in one.pairs.tolist()]
            done = shared(lambda pair: _join(*pair), pairs)
            for number, (_, join) in enumerate(done):
                left = 2 * np.flatnonzero(one.number == number)
                planes = ends[left + np.arange(3)[:, None]]
                self._eliminations.append(_Elimination(join, planes, one.sizes[number]))
            stop = 2 * len(one.number)
            ends = np.append(ends[: stop + 1 : 2], ends[stop + 1 :])
            lone = [current[last_kind]] if one.odd else []
            current = [superelement for superelement, _ in done] + lone
            last_kind = len(done) if one.odd else int(one.number[-1])
        last = current[-1]
        self._end = _factor(np.block([[last.a, last.b], [last.b.T, last.c]]))
        self._ends = ends[[0, -1], None], [sizes[0], sizes[-1]]

    def invert(self) -> None:
        """Products in place of substitutions, which take twice as long: for hundreds of right-hand
        sides, one after the other."""
        for one in self._eliminations:
            if isinstance(one.join, _Join):
                one.join = one.join.inverted

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
        cases, most = len(r), self._at.shape[1]
        # rows (planes L,most) of loads, and in their place of displacements as they are found
        planes = np.take(np.pad(r, ((0, 0), (0, 1))), self._at, axis=1)
        x = planes.swapaxes(0, 1).reshape(-1, most)
        eliminated = []
        for one in self._eliminations:
            left, middle, right = _places(one.planes, one.sizes, cases)
            alone, to_left, to_right = one.join.eliminate(x[middle])
            # a plane is the right one of a join before it is the left one of the next
            x[right] -= to_right
            x[left] -= to_left
            eliminated.append((one.join, alone, left, middle, right))
        first, last = _places(*self._ends, cases)
        both = np.concatenate([x[first], x[last]], axis=1)
        if both.size:
            half = dtrsm(1.0, self._end, both.T, lower=0, trans_a=1)
            both = dtrsm(1.0, self._end, half, lower=0).T
        x[first], x[last] = np.split(both, [len(self.slabs.planes[0])], axis=1)
        for join, alone, left, middle, right in reversed(eliminated):
            x[middle] = join.substitute(alone, x[left], x[right])
        result = np.zeros((cases, r.shape[1] + 1))
        result[:, self._at] = x.reshape(-1, cases, most).swapaxes(0, 1)
        return result[:, :-1]


def _places(planes: Long, sizes: Sequence[int], cases: int) -> list[tuple[Long, slice]]:
    """Rows of planes (K,J) among those of so many load cases, and columns of their ``sizes`` (K,)
    unknowns."""
    rows = cases * planes[:, :, None] + np.arange(cases)
    return [(of_plane.ravel(), slice(size)) for of_plane, size in zip(rows, sizes, strict=True)]


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
