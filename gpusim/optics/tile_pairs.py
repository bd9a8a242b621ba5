"""Triangles of a view and the tiles of its picture that they lie in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

__all__ = ["LEVELS", "TILE", "Pairs", "meets", "spread_over"]

Numbers = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]
TILE = 8
"""px, side of the smallest tiles."""

LEVELS = (128, 32, TILE)
"""px, side of the tiles that large triangles are looked up by, one after the other."""


@dataclass(frozen=True, eq=False)
class Pairs:
    """Triangles and tiles (column, row) of one size that they lie in."""

    triangle: Numbers
    tile: Numbers
    size: int

    def __getitem__(self, index: Numbers | Flags) -> Pairs:
        return Pairs(self.triangle[index], self.tile[index], self.size)

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
