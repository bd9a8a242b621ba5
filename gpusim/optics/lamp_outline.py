"""Outlines of what hides a lamp from other surfaces, in place of the faces inside of them.

What hides nothing of itself (`gpusim.optics.lamp_layer`) is met once at most by a ray from any
point of the lamp, and met where its border winds round the ray. Of receivers beyond all of it that
they look past, the border alone tells what they see of the lamp: a few hundred edges where there
are some hundred thousand faces. Of other closed bodies the border of what shows its back to all of
the lamp does, beside the faces that turn about (`gpusim.optics.lamp_band`).
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import numpy.typing as npt

from gpusim.optics.corners import CHUNK
from gpusim.optics.lamp_chain import Chain
from gpusim.optics.lamp_layer import Alone, Patch
from gpusim.optics.lamp_view import Reach
from gpusim.optics.windows import Windows

__all__ = ["BEFORE", "BEYOND", "CLEAR", "UNSURE", "Outline"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]
States = npt.NDArray[np.int8]

CLEAR, BEFORE, BEYOND, UNSURE = 0, 1, 2, 3
"""Nothing of the surface is where receivers look; all of it is farther from the lamp than they are;
all of it is nearer; or neither is sure."""

MOST_CELLS = 256
"""Of either side of the table of depths."""

MARGIN = 1e-6
"""Of the highest s, by which receivers must be beyond what hides the lamp."""


class Outline:
    """The border of what a lamp sees of ``surface`` in its ``view``, or of what shows it its back
    alone; ``points`` (P, 3) of that, ``places`` (3, P): p, q, s of these; ``top`` and ``bottom``:
    the highest and the lowest s; ``margin`` in s and ``across`` in p and q count as nothing;
    ``once``: whether the border winds once at most, but for folds."""

    def __init__(self, alone: Alone, patch: Patch) -> None:
        self.surface, self.view = alone.surface, alone.view
        self.points, view = alone.points, alone.view
        self.places = np.stack(view.place(*(np.ascontiguousarray(v) for v in self.points.T)))
        self._triangles = patch.triangles
        self._border, self.once = patch.border, patch.once
        self.top, self.bottom = float(patch.high[2]), float(patch.low[2])
        self.margin = MARGIN * max(abs(self.top), abs(self.bottom))
        self.across = MARGIN * float((patch.high - patch.low)[:2].max())

    def chain(self, tolerance: float) -> Chain:
        """The edges of the border, joined where they leave it by no more than ``tolerance`` in p
        and q, or what looks like that from the lamp."""
        return Chain.of(self._border, self.places, max(self.view.half), tolerance)

    @cached_property
    def _cells(self) -> tuple[Array, Array, Windows, Windows]:
        """Where the cells of a table begin, how large they are, and their highest and (turned over)
        lowest s."""
        places, triangles = self.places, self._triangles
        size, used = np.zeros(2), np.zeros(places.shape[1], bool)
        low, high = np.full(2, np.inf), np.full(2, -np.inf)
        for first in range(0, len(triangles), CHUNK):
            corner = [np.ascontiguousarray(v) for v in triangles[first : first + CHUNK].T]
            for axis in range(2):
                own = [np.take(places[axis], numbers) for numbers in corner]
                least = np.minimum(np.minimum(own[0], own[1]), own[2])
                most = np.maximum(np.maximum(own[0], own[1]), own[2])
                size[axis] = max(size[axis], float((most - least).max()))
                low[axis] = min(low[axis], float(least.min()))
                high[axis] = max(high[axis], float(most.max()))
            for numbers in corner:
                used[numbers] = True
        # a triangle lies in the cells round any of its corners' then
        size = np.maximum(np.maximum(size, (high - low) / MOST_CELLS), 1e-300)
        shape = (np.floor((high - low) / size).astype(np.int64) + 3)[::-1]
        place = places[:, used]
        column, row = (
            np.floor((place[axis] - low[axis]) / size[axis]).astype(np.int64) + 1
            for axis in range(2)
        )
        cell = row * shape[1] + column
        tables = []
        for sign in (1.0, -1.0):
            table = np.full(shape, -np.inf)
            np.maximum.at(table.reshape(-1), cell, sign * place[2])
            around = np.pad(table, 1, constant_values=-np.inf)
            across = np.maximum(np.maximum(around[:, :-2], around[:, 1:-1]), around[:, 2:])
            tables.append(np.maximum(np.maximum(across[:-2], across[1:-1]), across[2:]))
        return low - size, size, Windows(tables[0]), Windows(tables[1])

    def window(self, reach: Reach) -> Array:
        """(2, 2, n): first and last p, and q, that receivers in boxes look at: of lines from the
        lamp through them, on either side as far as the outline goes."""
        rise = np.maximum(np.maximum(self.top - reach.s[0], reach.s[1] - self.bottom), 0.0)
        # unlimited boxes stay so
        rise = np.minimum(rise, 1e150)
        sides = zip(self.view.half, (reach.p, reach.q), strict=True)
        return np.stack([[own[0] - half * rise, own[1] + half * rise] for half, own in sides])

    def depths(self, reach: Reach) -> tuple[Array, Array]:
        """The lowest and the highest s (n,) where receivers in boxes look; inf and -inf where
        nothing is."""
        origin, size, most, least = self._cells
        ends, shape = self.window(reach), most.shape
        first, last = np.empty((2, 2, len(reach.s[0])), np.int64)
        for axis, limit in enumerate(shape[::-1]):
            low, high = (np.clip((v - origin[axis]) / size[axis], -1, limit) for v in ends[axis])
            first[axis] = np.clip(np.floor(np.nan_to_num(low, nan=-1.0)), 0, limit)
            last[axis] = np.clip(np.floor(np.nan_to_num(high, nan=limit)), -1, limit - 1)
        return -least.highest(first, last), most.highest(first, last)

    def states(self, reach: Reach) -> States:
        """(n,) where receivers in boxes are: see `CLEAR` and the others. What is behind the lamp is
        clear."""
        lowest, highest = self.depths(reach)
        result = np.full(len(highest), UNSURE, np.int8)
        with np.errstate(invalid="ignore"):
            deep = reach.s[1] - reach.s[0]
            result[reach.s[1] + 0.5 * deep + self.margin < lowest] = BEYOND
        result[reach.s[0] >= highest] = BEFORE
        result[(highest == -np.inf) | (reach.s[1] == -np.inf)] = CLEAR
        return result
