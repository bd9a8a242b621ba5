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
from functools import partial
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from gpusim.arrays.unique import unique_rows
from gpusim.fem.assembly.matrix_product import shared
from gpusim.fem.lattice.equal_boxes import equal_boxes
from gpusim.fem.lattice.lattice import OFFSETS, Lattice
from gpusim.fem.lattice.run_sums import RowSums
from gpusim.parallel.machine import processors

__all__ = ["RunLayout", "RunPattern", "numbering_axes"]

Real = npt.NDArray[np.floating]
Float = npt.NDArray[np.float64]
Long = npt.NDArray[np.int64]

_Task = TypeVar("_Task")
# a kind of runs, and a box of them or their places
_Odd = tuple[int, tuple[slice, slice, slice] | Long]

# nodes in a run: more waste work on zeros, fewer are slow to multiply
_RUN = 4
# lines of nodes that are looked at for the order in which they are numbered
_LINES = 200
# runs at a time: what they see and give should stay in the cache
_CHUNK = 768
_ODD_CHUNK = 384
# runs of a lattice below which threads wait for each other longer than they work
_LEAST_TO_SHARE = 40_000
# boxes of fewer odd runs than this are gathered one run at a time
_SMALL_BOX = 8
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

    def put(self, x: Float, stored: Real) -> None:
        """Store x (3N,) in the order of the nodes."""
        _, middle, fast = self.shape
        grid = self.body(stored)[:, :middle, : 3 * fast]
        if self._in_order:
            grid[:] = x.reshape(grid.shape)
        else:
            values = np.zeros((*self.shape, 3))
            values[self.present] = x.reshape(-1, 3)[self.number]
            grid[:] = values.reshape(grid.shape)

    def get(self, stored: Real) -> Float:
        """(3N,) in the order of the nodes."""
        _, middle, fast = self.shape
        grid = self.body(stored)[:, :middle, : 3 * fast]
        if self._in_order:
            return grid.astype(np.float64).reshape(-1)
        result = np.empty((self.node_count, 3))
        result[self.number] = grid.reshape(*self.shape, 3)[self.present]
        return result.reshape(-1)

    def places(self, unknowns: npt.NDArray[np.bool_]) -> Long:
        """Where the unknowns (N,3) that are set, and everything that isn't a node, are stored."""
        slow, middle, fast = self.shape
        grid = np.zeros((slow, middle + 1, self.row // 3, 3), dtype=bool)
        inside = np.ones((*self.shape, 3), dtype=bool)
        inside[self.present] = unknowns[self.number]
        grid[:, :middle, :fast] = inside
        return np.asarray(np.flatnonzero(grid) + self.origin)


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
        self._boxes: list[tuple[int, tuple[slice, slice, slice]]] = []
        self._gathered: list[tuple[int, Long]] = []
        self._split(equal_boxes(kind, odd))

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

    def _split(self, boxes: Long) -> None:
        """Boxes to chunks; runs of small ones by kind."""
        extent = boxes[:, 2::2] - boxes[:, 1::2]
        large = extent.prod(axis=1) >= _SMALL_BOX
        for kind, x0, x1, y0, y1, z0, z1 in boxes[large].tolist():
            rest = slice(y0, y1), slice(z0, z1)
            step = max(1, _ODD_CHUNK // ((y1 - y0) * (z1 - z0)))
            for x in range(x0, x1, step):
                self._boxes.append((kind, (slice(x, min(x + step, x1)), *rest)))
        _, middle, _ = self.layout.shape
        odd: dict[int, list[Long]] = {}
        for kind, x0, x1, y0, y1, z0, z1 in boxes[~large].tolist():
            at = np.mgrid[x0:x1, y0:y1, z0:z1]
            place = (at[0] * (middle + 1) + at[1]) * self.layout.runs + at[2]
            odd.setdefault(kind, []).append(place.ravel())
        for kind, places in odd.items():
            joined = np.concatenate(places)
            for start in range(0, len(joined), _ODD_CHUNK):
                self._gathered.append((kind, joined[start : start + _ODD_CHUNK]))
        self._odd_runs: list[_Odd] = [*self._boxes, *self._gathered]

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

    def own_matrices(self, blocks: Float, dtype: npt.DTypeLike) -> Real:
        """(T, 3 R, 3 R) for blocks (C,3,3) that take each node to itself."""
        blocks = np.concatenate([blocks, np.zeros((1, 3, 3))])
        result = np.zeros((len(self._classes), _RUN, 3, _RUN, 3), dtype=dtype)
        for k in range(_RUN):
            result[:, k, :, k, :] = blocks[self._classes[:, k]].transpose(0, 2, 1)
        return result.reshape(-1, 3 * _RUN, 3 * _RUN)

    def apply(
        self, matrices: Real, x: Real, out: Real, add: Real | None = None,
        relative: RowSums | None = None,
    ) -> None:  # fmt: skip
        """out = A x (+ add) for stored vectors; ``out`` must be none of the others.

        ``relative``, the `RowSums` of float64 matrices whose rows add up to zero but for
        rounding: x enters by differences, so that bodies that move as a whole cost no digits.
        """
        self._share(partial(self._common, matrices, x, out, add, relative), self._chunks)
        self._share(partial(self._odd, matrices, x, out, add, relative), self._odd_runs)
        self._clear(out)

    def scale(self, matrices: Real, x: Real, out: Real) -> None:
        """out = D x by ``own_matrices``."""
        wide = 3 * _RUN
        start, row = self.layout.origin, self.layout.row
        for first, stop, kind in self._chunks:
            here = slice(start + first * row, start + stop * row)
            np.matmul(x[here].reshape(-1, wide), matrices[kind], out=out[here].reshape(-1, wide))
        source, result = self._by_runs(x), self._by_runs(out)
        for kind, box in self._boxes:
            result[box] = 0.0 if self._empty[kind] else source[box] @ matrices[kind]
        body, into = (self.layout.body(v).reshape(-1, wide) for v in (x, out))
        for kind, place in self._gathered:
            into[place] = body[place] @ matrices[kind]
        self._clear(out)

    def _share(self, work: Callable[[list[_Task]], None], tasks: list[_Task]) -> None:
        """Do the tasks, a share of them on each processor."""
        small = self.layout.runs * self.layout.shape[0] * self.layout.shape[1] < _LEAST_TO_SHARE
        threads = 1 if small else min(processors(), len(tasks))
        shared(work, [tasks[k::threads] for k in range(threads)])

    def _clear(self, out: Real) -> None:
        """Empty the row after each slab, in which whole chunks have left something."""
        self.layout.body(out)[:, -1] = 0.0

    def _by_runs(self, stored: Real) -> Real:
        """(slow, middle + 1, runs, 3 R) view."""
        body = self.layout.body(stored)
        return body.reshape(*body.shape[:2], self.layout.runs, 3 * _RUN)

    def _common(
        self, matrices: Real, x: Real, out: Real, add: Real | None, relative: RowSums | None,
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
                own = seen[:, :, 1, 3:6].copy()
                seen -= np.tile(own, _RUN + 2)[:, :, None]
                own = own.reshape(-1, 3)
            rows = seen.reshape(-1, 3 * (wide + 6))
            count = (stop - first) * layout.runs
            here = slice(layout.origin + first * layout.row, layout.origin + stop * layout.row)
            into, part, matrix = out[here].reshape(count, wide), share[:count], matrices[kind]
            np.matmul(rows[:count], matrix[0], out=into)
            if add is not None:
                into += add[here].reshape(count, wide)
            for row in (1, 2):
                np.matmul(rows[row * layout.runs :][:count], matrix[row], out=part)
                into += part
            if relative is not None:
                # the rows beside have been taken relative to nodes of their own
                middle = own[layout.runs :][:count]
                for row in (0, 2):
                    step = own[row * layout.runs :][:count] - middle
                    relative.add_step(kind, row, step, into)
                relative.take_own(kind, seen[1:-1, :, 1, 3:-3].reshape(count, wide), into)

    def _odd(
        self, matrices: Real, x: Real, out: Real, add: Real | None, relative: RowSums | None,
        tasks: list[_Odd],
    ) -> None:  # fmt: skip
        """Runs of another kind than their slab's commonest: boxes, and single ones."""
        boxes = [(kind, place) for kind, place in tasks if isinstance(place, tuple)]
        single = [(kind, place) for kind, place in tasks if not isinstance(place, tuple)]
        self._box(matrices, x, out, add, relative, boxes)
        self._gather(matrices, x, out, add, relative, single)

    def _box(
        self, matrices: Real, x: Real, out: Real, add: Real | None, relative: RowSums | None,
        boxes: list[tuple[int, tuple[slice, slice, slice]]],
    ) -> None:  # fmt: skip
        """Boxes of runs of another kind than their slab's commonest."""
        layout, wide, item = self.layout, 3 * _RUN, x.itemsize
        result = self._by_runs(out)
        more = None if add is None else self._by_runs(add)
        step = (layout.slab * item, layout.row * item, wide * item)
        for kind, box in boxes:
            if self._empty[kind]:
                result[box] = 0.0
                continue
            slabs, rows, runs = (one.stop - one.start for one in box)
            begin = layout.origin - layout.slab - layout.row - 3
            begin += box[0].start * layout.slab + box[1].start * layout.row + box[2].start * wide
            seen = np.ndarray(
                (slabs, rows + 2, runs, 3, wide + 6), x.dtype, x.data, begin * item,
                (step[0], step[1], step[2], step[0], item),
            ).copy()  # fmt: skip
            count, matrix = rows * runs, matrices[kind]
            own = None if relative is None else seen[:, :, :, 1, 3:6].copy()
            if own is not None:
                seen -= np.tile(own, _RUN + 2)[:, :, :, None]
                own = own.reshape(slabs, -1, 3)
            inner = seen.strides
            windows = np.ndarray(
                (slabs, rows, runs, 3, 3 * (wide + 6)), x.dtype, seen.data, 0,
                (inner[0], inner[1], inner[2], inner[1], item),
            )  # fmt: skip
            value = windows.reshape(-1, 9 * (wide + 6)) @ matrix.reshape(-1, wide)
            value = value.reshape(slabs, count, wide)
            if own is not None:
                assert relative is not None
                for row in (0, 2):
                    apart = own[:, row * runs :][:, :count] - own[:, runs:][:, :count]
                    relative.add_step(kind, row, apart, value)
                inner_runs = seen[:, 1:-1, :, 1, 3:-3].reshape(slabs, count, wide)
                relative.take_own(kind, inner_runs, value)
            value = value.reshape(slabs, rows, runs, wide)
            if more is not None:
                value += more[box]
            result[box] = value

    def _gather(
        self, matrices: Real, x: Real, out: Real, add: Real | None, relative: RowSums | None,
        parts: list[tuple[int, Long]],
    ) -> None:  # fmt: skip
        """Single runs of another kind."""
        layout, wide, item = self.layout, 3 * _RUN, x.itemsize
        into = layout.body(out).reshape(-1, wide)
        more = None if add is None else layout.body(add).reshape(-1, wide)
        begin = layout.origin - layout.slab - layout.row - 3
        every = np.ndarray(
            (len(into), 3, 3, wide + 6), x.dtype, x.data, begin * item,
            (wide * item, layout.row * item, layout.slab * item, item),
        )  # fmt: skip
        for kind, place in parts:
            matrix = matrices[kind].reshape(-1, wide)
            windows = every[place]
            if relative is not None:
                windows = windows - np.tile(windows[:, 1, 1, 3:6], _RUN + 2)[:, None, None]
            value = windows.reshape(len(place), -1) @ matrix
            if relative is not None:
                relative.take_own(kind, windows[:, 1, 1, 3:-3], value)
            into[place] = value if more is None else value + more[place]
