"""Vectors on a lattice as runs of nodes, and products with the rows of blocks that repeat there.

Along the fastest axis four nodes at a time, a run, get their values from the nodes in the
nine rows around them by one dense matrix, the same for every run whose nodes have the same rows of
blocks. Of many runs this is a product of two dense matrices, of which one stays in the cache: it
moves little more than the vectors and runs at the speed of BLAS.

A vector is stored row after row, with an empty place at the end of each row and an empty row at
the end of each slab, so that a node's neighbours lie at the same steps everywhere and the empty
places stand for those that don't exist.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Bool, Float, Long, Real
from gpusim.arrays.error_free_sums import two_sum
from gpusim.arrays.unique import unique_rows
from gpusim.fem.lattice.lattice import OFFSETS, Lattice
from gpusim.parallel.machine import processors
from gpusim.parallel.threads import shared

_Task = TypeVar("_Task")
# nodes in a run: more waste work on zeros, fewer are slow to multiply
_RUN = 4
# lines of nodes that are looked at for the order in which they are numbered
_LINES = 200
# runs at a time: what they see and give should stay in the cache
_CHUNK = 768
_ODD_CHUNK = 384
# runs of a lattice below which threads wait for each other longer than they work
_LEAST_TO_SHARE = 40_000
# kinds of runs, and the share of runs that aren't their slab's commonest kind, beyond which an
# assembled matrix is as good
_MOST_KINDS, _MOST_ODD = 512, 0.8


def numbering_axes(lattice: Lattice) -> tuple[int, int, int]:
    """The lattice's axes from slow to fast in the numbering of its nodes."""
    step = []
    for axis in range(3):
        node = np.moveaxis(lattice.node, axis, 0)
        lines = node.reshape(len(node), -1)
        # a few hundred lines tell
        lines = lines[:, :: 1 + lines.shape[1] // _LINES].astype(np.int64)
        a, b = lines[:-1], lines[1:]
        both = (a >= 0) & (b >= 0)
        step.append(float(np.median(np.abs(b[both] - a[both]))) if both.any() else 0.0)
    order = sorted(range(3), key=lambda axis: -step[axis])
    return order[0], order[1], order[2]


class RunLayout:
    """Where the nodes of a lattice lie in a stored vector; ``order`` its axes from slow to fast."""

    def __init__(self, lattice: Lattice, order: tuple[int, int, int]) -> None:
        self.order = order
        node = lattice.node.transpose(order)
        self.shape = node.shape
        slow, middle, fast = node.shape
        self.runs = -(-(fast + 1) // _RUN)
        self.row = 3 * _RUN * self.runs
        self.slab = (middle + 1) * self.row
        self.origin = self.slab + 2 * self.row
        self.size = self.origin + (slow + 1) * self.slab + 2 * self.row
        present = node >= 0
        # where nodes are numbered along the lattice a vector is the grid itself
        self._in_order = bool((node.ravel() == np.arange(node.size)).all())
        self.present = present
        self.number = node[present]

    @property
    def node_count(self) -> int:
        return len(self.number)

    def zeros(self, dtype: npt.DTypeLike) -> Real:
        """A stored vector of zeros."""
        return np.zeros(self.size, dtype=dtype)

    def body(self, stored: Real) -> Real:
        """(slow, middle + 1, width) view of all slabs, with their empty places."""
        slow, middle, _ = self.shape
        end = self.origin + slow * self.slab
        return stored[self.origin : end].reshape(slow, middle + 1, self.row)

    def put(self, x: Real, stored: Real) -> None:
        """Store x (3N,) in the order of the nodes."""
        _, middle, fast = self.shape
        grid = self.body(stored)[:, :middle, : 3 * fast]
        if self._in_order:
            grid[:] = x.reshape(grid.shape)
        else:
            values = np.zeros((*self.shape, 3), dtype=x.dtype)
            values[self.present] = x.reshape(-1, 3)[self.number]
            grid[:] = values.reshape(grid.shape)

    def get(self, stored: Real, into: Real) -> None:
        """Copy a stored vector to one (3N,) in the order of the nodes."""
        _, middle, fast = self.shape
        grid = self.body(stored)[:, :middle, : 3 * fast]
        if self._in_order:
            into.reshape(grid.shape)[:] = grid
        else:
            into.reshape(-1, 3)[self.number] = grid.reshape(*self.shape, 3)[self.present]


class RunPattern:
    """The kinds of runs on a lattice whose nodes are of some classes (N,), and products by them.

    The sums don't depend on the number of threads.
    """

    def __init__(self, layout: RunLayout, node_class: npt.NDArray[np.integer], count: int) -> None:
        self.layout = layout
        slow, middle, fast = layout.shape
        classes = np.full((slow, middle, layout.runs * _RUN), count)
        classes[:, :, :fast][layout.present] = node_class[layout.number]
        classes = classes.reshape(-1, _RUN)
        first, number = unique_rows(classes)
        kind = number.reshape(slow, middle, layout.runs)
        self._classes = classes[first]
        self._empty = (self._classes == count).all(axis=1)
        self._count = count
        flat = kind.reshape(slow, -1)
        common = np.array([np.bincount(row).argmax() for row in flat])
        odd = kind != common[:, None, None]
        share = float((odd & ~self._empty[kind]).mean())
        self.worthwhile = len(first) <= _MOST_KINDS and share <= _MOST_ODD
        if not self.worthwhile:
            return
        self._chunks = self._common_chunks(common)
        self._odd_runs = self._odd_chunks(kind, odd)

    def _common_chunks(self, common: Long) -> list[tuple[int, int, int]]:
        """(first row, stop, kind): slabs of the same commonest kind, some rows at a time."""
        middle = self.layout.shape[1]
        step = max(1, _CHUNK // self.layout.runs)
        cuts = np.flatnonzero(np.diff(common)) + 1
        chunks = []
        for first, stop in zip([0, *cuts.tolist()], [*cuts.tolist(), len(common)], strict=True):
            # the empty row after the last slab of a stretch is left out
            last = stop * (middle + 1) - 1
            chunks += [
                (row, min(row + step, last), int(common[first]))
                for row in range(first * (middle + 1), last, step)
            ]
        return chunks

    def _odd_chunks(self, kind: Long, odd: Bool) -> list[tuple[int, Long]]:
        """(kind, places) of runs of another kind than their slab's commonest, some at a time."""
        _, middle, _ = self.layout.shape
        slab, row, run = np.nonzero(odd)
        place = (slab * (middle + 1) + row) * self.layout.runs + run
        order = np.argsort(kind[odd], kind="stable")
        cuts = np.flatnonzero(np.diff(kind[odd][order])) + 1
        return [
            (int(kind[odd][of_kind[0]]), place[of_kind[start : start + _ODD_CHUNK]])
            for of_kind in np.split(order, cuts)
            for start in range(0, len(of_kind), _ODD_CHUNK)
        ]

    def matrices(self, blocks: Float, dtype: npt.DTypeLike) -> Real:
        """(T, 3, 9 (R + 2), 3 R) for blocks (C,27,3,3) at ``OFFSETS`` of each class of nodes: for
        each kind of run and each of three rows, what the nodes in three slabs and R + 2 places
        give to the run."""
        blocks = np.concatenate([blocks, np.zeros((1, 27, 3, 3))])
        runs, length = self._classes, _RUN
        result = np.zeros((len(runs), 3, 3, length + 2, 3, length, 3), dtype=dtype)
        for number, offset in enumerate(OFFSETS.tolist()):
            slab, row, place = (offset[axis] + 1 for axis in self.layout.order)
            for k in range(length):
                block = blocks[runs[:, k], number]
                result[:, row, slab, k + place, :, k, :] += block.transpose(0, 2, 1)
        return result.reshape(len(runs), 3, 9 * (length + 2), 3 * length)

    def apply(self, matrices: Real, x: Real, out: Real, relative: RowSums | None = None) -> None:
        """out = A x for stored vectors; ``out`` isn't ``x``.

        ``relative``, the `RowSums` of float64 matrices whose rows add up to zero but for
        rounding: x enters by differences, so that bodies that move as a whole cost no digits.
        """
        self._share(partial(self._common, matrices, x, out, relative), self._chunks)
        self._share(partial(self._odd, matrices, x, out, relative), self._odd_runs)
        # whole chunks have left something in the row after each slab
        self.layout.body(out)[:, -1] = 0.0

    def _share(self, work: Callable[[list[_Task]], None], tasks: list[_Task]) -> None:
        """Do the tasks, a share of them on each processor."""
        small = self.layout.runs * self.layout.shape[0] * self.layout.shape[1] < _LEAST_TO_SHARE
        threads = 1 if small else min(processors(), len(tasks))
        shared(work, [tasks[k::threads] for k in range(threads)])

    def _common(
        self, matrices: Real, x: Real, out: Real, relative: RowSums | None,
        chunks: list[tuple[int, int, int]],
    ) -> None:  # fmt: skip
        """Rows of runs by the matrix of their slab's commonest kind."""
        layout, wide, item = self.layout, 3 * _RUN, x.itemsize
        most = max((stop - first for first, stop, _ in chunks), default=0)
        space = np.empty((most + 2, layout.runs, 3, wide + 6), dtype=x.dtype)
        share = np.empty((most * layout.runs, wide), dtype=x.dtype)
        for first, stop, kind in chunks:
            begin = layout.origin - layout.slab - 3 + (first - 1) * layout.row
            seen = space[: stop - first + 2]
            seen[:] = np.ndarray(
                seen.shape, x.dtype, x.data, begin * item,
                (layout.row * item, wide * item, layout.slab * item, item),
            )  # fmt: skip
            if relative is not None:
                node_values = seen[:, :, 1, 3:6].copy()
                seen -= np.tile(node_values, _RUN + 2)[:, :, None]
                node_values = node_values.reshape(-1, 3)
            rows = seen.reshape(-1, 3 * (wide + 6))
            count = (stop - first) * layout.runs
            here = slice(layout.origin + first * layout.row, layout.origin + stop * layout.row)
            into, part, matrix = out[here].reshape(count, wide), share[:count], matrices[kind]
            np.matmul(rows[:count], matrix[0], out=into)
            for row in (1, 2):
                np.matmul(rows[row * layout.runs :][:count], matrix[row], out=part)
                into += part
            if relative is not None:
                # the rows beside have been taken relative to nodes of their own
                middle = node_values[layout.runs :][:count]
                for row in (0, 2):
                    step = node_values[row * layout.runs :][:count] - middle
                    relative.add_step(kind, row, step, into)
                relative.take_own(kind, seen[1:-1, :, 1, 3:-3].reshape(count, wide), into)

    def _odd(
        self, matrices: Real, x: Real, out: Real, relative: RowSums | None,
        parts: list[tuple[int, Long]],
    ) -> None:  # fmt: skip
        """Runs of another kind than their slab's commonest."""
        layout, wide, item = self.layout, 3 * _RUN, x.itemsize
        into = layout.body(out).reshape(-1, wide)
        # what a run sees of a row is moved as one piece
        stretch = np.dtype(f"V{(wide + 6) * item}")
        every = np.ndarray(len(x) - wide - 5, stretch, x.data, 0, (item,))
        begin = layout.origin - layout.slab - layout.row - 3
        rows = begin + layout.row * np.arange(3)[:, None] + layout.slab * np.arange(3)
        for kind, place in parts:
            if self._empty[kind]:
                into[place] = 0.0
                continue
            matrix = matrices[kind].reshape(-1, wide)
            windows = every[wide * place[:, None, None] + rows].view(x.dtype)
            windows = windows.reshape(-1, 3, 3, wide + 6)
            if relative is not None:
                windows = windows - np.tile(windows[:, 1, 1, 3:6], _RUN + 2)[:, None, None]
            value = windows.reshape(len(place), -1) @ matrix
            if relative is not None:
                relative.take_own(kind, windows[:, 1, 1, 3:-3], value)
            into[place] = value


@dataclass(frozen=True, eq=False)
class RowSums:
    """Sums of the matrices by kind of run, to twice the
    digits.

    A product by differences to one node in place of each node's own leaves the sum of a row's
    blocks times the difference of the two. That sum is rounding, yet along a slender body all rows
    have the same one, and forces of 1e-16 add up. ``beside``, ``rest`` (T,3,3,3 R) of the three
    rows of nodes, ``own`` (T,3 R,3 R) of all, for each of the R nodes of a run.
    """

    beside: Float
    rest: Float
    own: Float

    @staticmethod
    def of(matrices: Real) -> RowSums:
        """Of float64 matrices (T,3,9 (R + 2),3 R)."""
        kinds, wide = len(matrices), matrices.shape[-1]
        parts = matrices.reshape(kinds, 3, -1, 3, wide).transpose(2, 0, 1, 3, 4)
        beside, rest = _added(parts)
        total, total_rest = _added(np.concatenate([beside, rest], axis=1).transpose(1, 0, 2, 3))
        diagonal = np.zeros((kinds, wide, wide))
        for first in range(0, wide, 3):
            here = slice(first, first + 3)
            diagonal[:, here, here] = (total + total_rest)[:, :, here]
        return RowSums(beside, rest, diagonal)

    def add_step(self, kind: int, row: int, step: Real, into: Real) -> None:
        """A row's nodes lie by ``step`` (…,3) from what they were taken relative to."""
        into += step @ self.beside[kind, row]
        into += step @ self.rest[kind, row]

    def take_own(self, kind: int, x: Real, into: Real) -> None:
        """Each node was to be relative to itself; ``x`` (…,3 R) relative to the first one."""
        into -= x @ self.own[kind]


def _added(terms: Real) -> tuple[Float, Float]:
    """The sum of (K,…) over the first axis and what it lacks, term by term."""
    total, rest = np.zeros(terms.shape[1:]), np.zeros(terms.shape[1:])
    for term in terms:
        total, lost = two_sum(total, term)
        rest += lost
    return total, rest
