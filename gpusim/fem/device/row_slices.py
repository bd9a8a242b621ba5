"""Rows of blocks side by side: threads that work together read one stretch of memory.

Eight rows of about the same length are a slice (sliced ELL: Monakov, Lokhmotov & Avetisyan, HiPEAC
2010). Its texels are stored by place in the row first and by row last, so that one load of eight
threads is 128 bytes in a row. Where each thread went through a row of its own, waiting for memory
took two fifths of the time.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from gpusim.fem.assembly.block_rows import BlockRows, ranges

__all__ = ["SLICE", "WINDOW", "RowSlices"]

Long = npt.NDArray[np.int64]
Float = npt.NDArray[np.float64]

SLICE = 8
# nodes are sorted by the length of their rows within as many of them
WINDOW = 2048
# texels of blocks that are put together at a time: large pieces of new memory are slow to touch
_CHUNK = 1 << 18
# texels of four blocks
_FOUR = 9


@dataclass(frozen=True, eq=False)
class RowSlices:
    """``nodes`` eight after the other, the longest row of eight first; ``fours`` of neighbours of
    each; ``head`` those of each slice's first node, ``start`` the sum of the slices before."""

    nodes: Long
    fours: Long
    head: Long
    start: Long

    @staticmethod
    def of(degree: Long) -> RowSlices:
        """Slices of all nodes, which have ``degree`` (N,) neighbours."""
        fours = -(-degree // 4)
        # windows are whole slices
        nodes = np.lexsort((-fours, np.arange(len(degree)) // WINDOW))
        return _sliced(nodes, fours[nodes])

    def parts(self, most: int) -> list[RowSlices]:
        """Slices that take at most ``most`` texels of blocks together."""
        total = np.cumsum(_FOUR * SLICE * self.head)
        cuts = [0]
        while cuts[-1] < len(self.head):
            before = int(total[cuts[-1] - 1]) if cuts[-1] else 0
            cuts.append(max(int(np.searchsorted(total, before + most, side="right")), cuts[-1] + 1))
        return [self._some(first, last) for first, last in pairwise(cuts)]

    def _some(self, first: int, last: int) -> RowSlices:
        part = slice(SLICE * first, SLICE * last)
        return _sliced(self.nodes[part], self.fours[part])

    @property
    def list_texels(self) -> int:
        return SLICE * int(self.head.sum())

    @property
    def block_texels(self) -> int:
        return _FOUR * self.list_texels

    def info(self) -> npt.NDArray[np.uint32]:
        """(n,4): first texel of its neighbours, fours of them, first texel of its blocks, node."""
        lane = np.arange(len(self.nodes)) % SLICE
        start = SLICE * np.repeat(self.start, SLICE)[: len(self.nodes)]
        columns = [start + lane, self.fours, _FOUR * start + lane, self.nodes]
        return np.stack(columns, axis=1).astype(np.uint32)

    def neighbours(self, rows: BlockRows) -> npt.NDArray[np.uint32]:
        """(t,4) neighbours; rows are filled up with the node itself."""
        degree = rows.degree[self.nodes]
        listed = np.repeat(self.nodes.astype(np.uint32), 4 * self.fours)
        into = ranges(4 * (np.cumsum(self.fours) - self.fours), degree)
        listed[into] = rows.neighbour[ranges(rows.start[self.nodes], degree)]
        result = np.zeros((self.list_texels // SLICE, SLICE, 4), dtype=np.uint32)
        result[self._places()] = listed.reshape(-1, 4)
        return result.reshape(-1, 4)

    def blocks(self, rows: BlockRows, scale: float) -> Iterator[tuple[int, Float]]:
        """(first texel, (t,4) texels) one after the other: blocks over ``scale`` by columns."""
        first = 0
        while first < len(self.head):
            end = int(self.start[first]) + _CHUNK // (_FOUR * SLICE)
            last = max(int(np.searchsorted(self.start + self.head, end, side="right")), first + 1)
            some = self._some(first, last)
            own = rows.row_class[some.nodes]
            degree = rows.table_start[own + 1] - rows.table_start[own]
            blocks = np.zeros((4 * int(some.fours.sum()), 3, 3))
            into = ranges(4 * (np.cumsum(some.fours) - some.fours), degree)
            source = ranges(rows.table_start[own], degree)
            blocks[into] = rows.table[source].transpose(0, 2, 1)
            blocks /= scale
            result = np.zeros((some.list_texels // SLICE, _FOUR, SLICE, 4))
            four, lane = some._places()
            result[four, :, lane] = blocks.reshape(-1, _FOUR, 4)
            yield _FOUR * SLICE * int(self.start[first]), result.reshape(-1, 4)
            first = last

    def _places(self) -> tuple[Long, Long]:
        """Four within the slices' sum, and lane, of each four of each node."""
        lane = np.arange(len(self.nodes)) % SLICE
        start = np.repeat(self.start, SLICE)[: len(self.nodes)]
        return ranges(start, self.fours), np.repeat(lane, self.fours)


def _sliced(nodes: Long, fours: Long) -> RowSlices:
    head = fours[::SLICE]
    return RowSlices(nodes, fours, head, np.cumsum(head) - head)
