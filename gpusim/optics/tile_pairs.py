"""Triangles of a view and the tiles of its picture that they lie in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

__all__ = ["LEVELS", "NONE", "TILE", "Pairs", "counted", "meets", "spread_over"]

Numbers = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]
TILE = 8
"""px, side of the smallest tiles."""

LEVELS = (128, 32, TILE)
"""px, side of the tiles that large triangles are looked up by, one after the other."""

NONE = np.zeros((1, 1), np.int64)
"""Of `counted`: nothing to add to."""


@dataclass(frozen=True, eq=False)
class Pairs:
    """Triangles and tiles (column, row) of one size that they lie in."""

    triangle: Numbers
    tile: Numbers
    size: int

    def __getitem__(self, index: Numbers | Flags | slice) -> Pairs:
        return Pairs(self.triangle[index], self.tile[index], self.size)

    def joined(self, others: Pairs) -> Pairs:
        """These, then others of their size."""
        return Pairs(
            np.concatenate([self.triangle, others.triangle]),
            np.concatenate([self.tile, others.tile]), self.size,
        )  # fmt: skip

    def within(self, size: int) -> Pairs:
        """The same triangles with the larger tiles that theirs are in."""
        return Pairs(self.triangle, self.tile // (size // self.size), size)

    def split(self, size: int) -> Pairs:
        """The smaller tiles under all of them."""
        parts = self.size // size
        step = np.stack(np.meshgrid(np.arange(parts), np.arange(parts)), axis=-1).reshape(-1, 2)
        triangle = np.repeat(self.triangle, parts * parts)
        return Pairs(triangle, (self.tile[:, None] * parts + step).reshape(-1, 2), size)


def meets(pairs: Pairs, mask: Flags) -> Flags:
    """(n,) which of the tiles of pairs hold one of the smallest tiles of a ``mask`` (rows,
    columns)."""
    parts = pairs.size // TILE
    tall, wide = (-(-n // parts) for n in mask.shape)
    room = np.zeros((tall * parts, wide * parts), bool)
    room[: mask.shape[0], : mask.shape[1]] = mask
    held: Flags = np.any(room.reshape(tall, parts, wide, parts), axis=(1, 3))
    # tiles beside the picture hold none
    row, column = pairs.tile[:, 1], pairs.tile[:, 0]
    inside = (row < tall) & (column < wide)
    result = np.zeros(len(row), bool)
    result[inside] = held[row[inside], column[inside]]
    return result


def spread_over(pairs: Pairs, shape: tuple[int, int]) -> Flags:
    """(rows, columns) which of the smallest tiles lie in tiles of pairs."""
    parts = pairs.size // TILE
    held = np.zeros((-(-shape[0] // parts), -(-shape[1] // parts)), bool)
    held[pairs.tile[:, 1], pairs.tile[:, 0]] = True
    return np.repeat(np.repeat(held, parts, axis=0), parts, axis=1)[: shape[0], : shape[1]]


def counted(pairs: Pairs, shape: tuple[int, int], more: Numbers) -> Numbers:
    """How many pairs there are of each tile of their size, added to ``more``; ``shape``: of the
    smallest tiles."""
    parts = pairs.size // TILE
    tall, wide = -(-shape[0] // parts), -(-shape[1] // parts)
    number = pairs.tile[:, 1] * wide + pairs.tile[:, 0]
    own = np.bincount(number, minlength=tall * wide).reshape(tall, wide)
    own += more[:tall, :wide]
    return own
