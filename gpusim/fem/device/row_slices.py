"""Rows of blocks side by side: threads that work together read one stretch of memory.

Eight rows of about the same length are a slice (sliced ELL: Monakov, Lokhmotov & Avetisyan, HiPEAC
2010). Its texels are stored by place in the row first and by row last, so that one load of eight
threads is 128 bytes in a row. Where each thread went through a row of its own, waiting for memory
took two fifths of the time.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from gpusim.fem.assembly.block_rows import BlockRows, ranges
from gpusim.fem.assembly.matrix_product import ahead

__all__ = ["SLICE", "WINDOW", "RowSlices"]

Long = npt.NDArray[np.int64]
Single = npt.NDArray[np.float32]

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

    def blocks(
        self, rows: BlockRows, scale: float, exact: bool
    ) -> Iterator[tuple[int, list[Single]]]:
        """(first texel, (t,4) texels) one after the other: blocks over ``scale`` by columns, as
        float32 and, if ``exact``, what that leaves of them."""
        cuts = [0]
        while cuts[-1] < len(self.head):
            end = int(self.start[cuts[-1]]) + _CHUNK // (_FOUR * SLICE)
            last = int(np.searchsorted(self.start + self.head, end, side="right"))
            cuts.append(max(last, cuts[-1] + 1))
        return ahead(partial(self._halves, rows, scale, exact), list(pairwise(cuts)))

    def _halves(
        self, rows: BlockRows, scale: float, exact: bool, ends: tuple[int, int]
    ) -> tuple[int, list[Single]]:
        some = self._some(*ends)
        own = rows.row_class[some.nodes]
        degree = rows.table_start[own + 1] - rows.table_start[own]
        source = ranges(rows.table_start[own], degree)
        low, high = (int(source.min()), int(source.max()) + 1) if len(source) else (0, 0)
        blocks = rows.table[low:high].reshape(-1, 9)
        blocks = blocks if scale == 1.0 else blocks / scale
        # the block behind the last one is zero, and fills rows up
        listed = np.full(4 * int(some.fours.sum()), high - low)
        listed[ranges(4 * (np.cumsum(some.fours) - some.fours), degree)] = source - low
        places = np.full((some.list_texels // SLICE, SLICE, 4), high - low)
        places[some._places()] = listed.reshape(-1, 4)
        halves = [blocks.astype(np.float32)]
        if exact:
            halves.append((blocks - halves[0]).astype(np.float32))
        texels = [_interleaved(half, places) for half in halves]
        return _FOUR * SLICE * int(self.start[ends[0]]), texels

    def _places(self) -> tuple[Long, Long]:
        """Four within the slices' sum, and lane, of each four of each node."""
        lane = np.arange(len(self.nodes)) % SLICE
        start = np.repeat(self.start, SLICE)[: len(self.nodes)]
        return ranges(start, self.fours), np.repeat(lane, self.fours)


def _sliced(nodes: Long, fours: Long) -> RowSlices:
    head = fours[::SLICE]
    return RowSlices(nodes, fours, head, np.cumsum(head) - head)


def _interleaved(blocks: Single, places: Long) -> Single:
    """(t,4) texels of blocks (B,9) at ``places`` (S,8,4): by place in the row, then by row."""
    padded = np.empty((len(blocks) + 1, 9), dtype=np.float32)
    padded[-1] = 0.0
    # by columns; pieces of three numbers would be copied one by one
    for k in range(9):
        padded[:-1, k] = blocks[:, 3 * (k % 3) + k // 3]
    # a texel is moved as one number of 16 bytes
    rows = padded.take(places.ravel(), axis=0).reshape(-1, 4).view(np.complex128)
    turned = rows.reshape(-1, SLICE, _FOUR).transpose(0, 2, 1)
    return np.ascontiguousarray(turned).view(np.float32).reshape(-1, 4)
