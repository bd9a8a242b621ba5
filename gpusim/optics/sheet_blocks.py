"""Sheets that go on from cell to cell of a lamp's view, over blocks of cells.

A sheet over one cell is a node here, and knows those that it goes on in to the right and below. It
lies over a block of cells without a gap if at every corner inside both ways round end in the same
node: those squares are what blocks are made of.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import numpy.typing as npt

__all__ = ["SheetBlocks"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]
Squares = tuple[Array, Array]
LEVELS = 64
"""More than a side of a block can be halved."""


class SheetBlocks:
    """Nodes with what they go on in to the ``right`` and ``below`` (n,), -1 for none, and values
    (n,) of which the ``least`` and the ``most`` (k, n) count."""

    def __init__(self, right: Numbers, below: Numbers, least: Array, most: Array) -> None:
        count = len(right)
        ends = []
        for after in (right, below):
            before = np.full(count + 1, count)
            known = np.flatnonzero(after >= 0)
            before[after[known]] = known
            after = np.append(after, -1)
            ends += [np.where(after < 0, count, after), before]
        # two that go on in the same one don't both lie over what follows
        for k in (0, 2):
            back = ends[k + 1][ends[k]]
            ends[k] = np.where(back == np.arange(count + 1), ends[k], count)
        self._jumps = [[end] for end in ends]
        self._least = np.append(least, -np.inf)
        self._most = np.append(most, np.full((len(most), 1), np.inf), axis=1)

    def moved(self, node: Numbers, columns: Numbers, rows: Numbers) -> Numbers:
        """The nodes so many ``columns`` to the right and ``rows`` below, left and above where these
        are negative; the last one + 1 where a way there ends before."""
        for way, steps in ((0, columns), (1, -columns), (2, rows), (3, -rows)):
            steps = np.maximum(steps, 0)
            for level in range(int(steps.max(initial=0)).bit_length()):
                on = np.flatnonzero(steps >> level & 1)
                node = node.copy()
                node[on] = self._jump(way, level)[node[on]]
        return node

    def over(self, node: Numbers, wide: Numbers, tall: Numbers) -> tuple[Array, Array]:
        """The least (n,) and the most (k, n) over blocks of ``wide`` x ``tall`` cells (n,) whose
        first is that of a node; -inf and inf where the sheet has a gap. Blocks have two cells each
        way at least."""
        least = np.full(len(node), -np.inf)
        most = np.full((len(self._most), len(node)), np.inf)
        squares = np.maximum(np.stack([tall, wide]) - 1, 1)
        row_level, column_level = np.frexp(squares)[1] - 1
        level = row_level * LEVELS + column_level
        for one in np.unique(level):
            own = np.flatnonzero(level == one)
            i, j = divmod(int(one), LEVELS)
            low, high = self._block(i, j)
            down, across = squares[:, own] - np.array([[1 << i], [1 << j]])
            start = node[own]
            right = self.moved(start, across, np.zeros_like(down))
            corners = [start, right, self.moved(start, np.zeros_like(across), down)]
            corners.append(self.moved(right, np.zeros_like(across), down))
            least[own] = np.min([low[at] for at in corners], axis=0)
            most[:, own] = np.max([high[:, at] for at in corners], axis=0)
        return least, most

    def _jump(self, way: int, level: int) -> Numbers:
        """Nodes 2^``level`` steps on."""
        own = self._jumps[way]
        while len(own) <= level:
            own.append(own[-1][own[-1]])
        return own[level]

    @cached_property
    def _blocks(self) -> dict[tuple[int, int], Squares]:
        right, below = self._jump(0, 0), self._jump(2, 0)
        last = below[right]
        torn = (last != right[below]) | (last == len(right) - 1)
        corners = [np.arange(len(right)), right, below, last]
        least = np.min([self._least[at] for at in corners], axis=0)
        most = np.max([self._most[:, at] for at in corners], axis=0)
        return {(0, 0): (np.where(torn, -np.inf, least), np.where(torn, np.inf, most))}

    def _block(self, i: int, j: int) -> Squares:
        """The least and the most of blocks of 2^i x 2^j squares by their first node."""
        if (i, j) not in self._blocks:
            (low, high), way = (
                (self._block(i - 1, j), self._jump(2, i - 1))
                if i
                else (self._block(0, j - 1), self._jump(0, j - 1))
            )
            self._blocks[i, j] = np.minimum(low, low[way]), np.maximum(high, high[:, way])
        return self._blocks[i, j]
