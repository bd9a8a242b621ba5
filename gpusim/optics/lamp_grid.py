"""Casters filed by where a lamp sees them, so that a receiver finds those that may hide the lamp.

In the lamp's view (p, q, s), a receiver has to look, around its own p and q, as far as half the
lamp's size times the difference in s to the nearest caster there.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

import numpy as np
import numpy.typing as npt

from gpusim.optics.casters import Casters, LampFaces
from gpusim.optics.lamp_edges import LampEdges
from gpusim.optics.lamp_view import LampView, Reach, overlap
from gpusim.optics.ragged import batches, cells_of, expand
from gpusim.optics.side_lines import side_lines, told_by
from gpusim.optics.windows import Windows

__all__ = ["LampGrid"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]
LEAST_CELLS, MOST_CELLS, LONGEST = 1 << 14, 1 << 20, 1 << 11
MOST_ENTRIES = 1 << 20
"""Of casters in cells, unless all are that small; large ones lie in many."""

LONG = 3
"""Cells across which a caster is worth a closer look."""

WIDE, ROUNDS = 16, 8
"""Cells across a window that is looked at more closely, and how often at most."""

TOGETHER = 1 << 18
"""Entries of cells that are looked at together: what belongs to them stays in the caches."""

EACH = 4
"""Entries of cells that cost as much as a receiver and a caster looked at by themselves."""


class LampGrid:
    """Casters of one view of a lamp, in cells of p and q, each with its highest s."""

    def __init__(
        self,
        view: LampView,
        casters: Casters,
        faces: LampFaces,
        lowest: float,
        rise: float = 0.0,
    ) -> None:
        """``lowest``: the smallest s of any receiver. ``rise``: the least difference in s to a
        receiver for which the casters are exact enough."""
        self.view, self.lowest, self.rise = view, lowest, rise
        reach = view.reach(np.moveaxis(casters.corners[faces.face], 0, 2))
        ahead = np.flatnonzero(reach.s[1] > max(lowest, -1e300))
        self.face, self.rim = faces.face[ahead], faces.rim[ahead]
        self.side, self.reach = faces.side[ahead], reach[ahead]
        low = self._mapped(np.stack([self.reach.p[0], self.reach.q[0]]))
        high = self._mapped(np.stack([self.reach.p[1], self.reach.q[1]]))
        self.count = len(ahead)
        corners = view.place(*np.moveaxis(casters.corners[self.face], 2, 0))
        self.places = corners
        self.lines = side_lines(*corners[:2])
        self.outlined = told_by(self.lines)
        self.edges = LampEdges.of(view, corners, self.side, casters.both_sides[self.face])
        self.origin = low.min(axis=1, initial=np.inf) if self.count else np.zeros(2)
        extent = high.max(axis=1, initial=-np.inf) - self.origin if self.count else np.ones(2)
        extent = np.maximum(extent, 1e-12)
        # under grazing light faces are far shorter one way than the other, and so are their cells
        size = extent / np.sqrt(LEAST_CELLS)
        if self.count:
            size = np.minimum(size, np.median(high - low, axis=1))
        size = np.maximum(size, extent / LONGEST)
        size *= max(1.0, float(np.sqrt((extent / size).prod() / MOST_CELLS)))
        origin = self.origin[:, None]
        while True:
            first = np.floor((low - origin) / size[:, None]).astype(np.int64)
            last = np.floor((high - origin) / size[:, None]).astype(np.int64)
            if (last - first + 1).prod(axis=0).sum() <= MOST_ENTRIES + 4 * self.count:
                break
            size = 2.0 * size
        self.size = size
        self.shape = (np.floor(extent / size).astype(np.int64) + 1)[::-1]
        self.first, self.last = first, last
        box, cell = self._cells(first, last)
        order = np.argsort(cell, kind="stable")
        self.entry, self.column = box[order], cell[order] % self.shape[1]
        self.start = np.searchsorted(cell[order], np.arange(self.shape.prod() + 1))
        self.highest = self.reach.s[1]
        long = np.any(last - first >= LONG, axis=0)
        met, height = self._heights(box, cell, long, corners)
        top = np.full(self.shape, -np.inf)
        np.maximum.at(top.reshape(-1), cell[met], height[met])
        levels = [top]
        while max(top.shape) > 1:
            top = np.pad(top, [(0, n % 2) for n in top.shape], constant_values=-np.inf)
            top = np.maximum(top[::2], top[1::2])
            top = np.maximum(top[:, ::2], top[:, 1::2])
            levels.append(top)
        # the pyramid of highest s, level after level
        self.pyramid = np.concatenate([level.reshape(-1) for level in levels])
        self.rows, self.columns = np.array([level.shape for level in levels]).T
        self.level = np.cumsum(self.rows * self.columns) - self.rows * self.columns

    def meets(self, reach: Reach, caster: Numbers) -> tuple[Flags, Flags]:
        """What boxes (n) have to do with casters (n), as far as the lamp's view tells.

        Whether a box may see the lamp hidden by the caster; and whether it may see the lamp past
        an edge at which the caster's shadow ends.
        """
        rise = np.clip(self.highest[caster] - reach.s[0], 0.0, 1e150)
        bounded = np.ones(len(caster), bool)
        middle, half = [], []
        for size, own in zip(self.view.half, (reach.p, reach.q), strict=True):
            low, high = own
            finite = np.isfinite(low) & np.isfinite(high)
            if not finite.all():
                low, high = np.where(finite, low, 0.0), np.where(finite, high, 0.0)
                bounded &= finite
            middle.append(0.5 * (low + high))
            half.append(0.5 * (high - low) + rise * size)
        inside, past = np.ones(len(caster), bool), np.zeros(len(caster), bool)
        for k, (gap, width) in enumerate(self.beside(caster, middle, half)):
            inside &= gap <= width
            past |= self.rim[:, k][caster] & (np.abs(gap) <= width)
        return inside | ~bounded, past | ~bounded

    def beside(
        self, caster: Numbers, middle: list[Array], half: list[Array]
    ) -> Iterator[tuple[Array, Array]]:
        """Of each side of the outlines of casters (n,): how far outside of it rectangles of p and q
        have their ``middle``, and how far they reach towards it."""
        for normal_p, normal_q, offset in self.lines:
            p, q = normal_p[caster], normal_q[caster]
            gap = p * middle[0] + q * middle[1] - offset[caster]
            yield gap, (np.abs(p) * half[0] + np.abs(q) * half[1]) * (1.0 + 1e-9)

    def near(self, reach: Reach, box: Numbers, caster: Numbers) -> Numbers:
        """Those of the boxes ``box`` of ``reach`` that a caster (as many) is too near to."""
        if not self.rise:
            return box[:0]
        rise = self.reach.s[0][caster] - reach.s[1][box]
        return box[np.flatnonzero(rise < self.rise)]

    def _mapped(self, values: Array) -> Array:
        """Finite coordinates of the grid: p and q of half a space reach to infinity."""
        values = np.clip(values, -1e150, 1e150)
        if self.view.lamp.far:
            return values
        return values / (1.0 + np.abs(values))

    def cells(self) -> tuple[Numbers, Numbers]:
        """Number of the caster and of the cell for every cell that a caster is filed in: of each
        caster row by row."""
        return self._cells(self.first, self.last)

    def rectangles(self, cell: Numbers) -> tuple[list[Array], list[Array]]:
        """Middle and half the size of cells (n,), p and q (n,) of each; a little larger than they
        are."""
        middle, half = [], []
        for axis, index in enumerate((cell % self.shape[1], cell // self.shape[1])):
            low = self.origin[axis] + (index - 1e-6) * self.size[axis]
            low, high = self._unmapped(low), self._unmapped(low + (1.0 + 2e-6) * self.size[axis])
            middle.append(0.5 * (low + high))
            half.append(0.5 * (high - low))
        return middle, half

    def window(self, reach: Reach, top: Array | None = None) -> tuple[Numbers, Numbers]:
        """Cells (2, n) from first to last that rays from receivers to the lamp pass before their s
        is ``top`` (n,), or before they are above all casters there."""
        return self._window(reach, self.top(reach) if top is None else top)

    def around(self, reach: Reach) -> tuple[Numbers, Numbers]:
        """Cells (2, n) from first to last that receivers in boxes lie in."""
        return self._window(reach, reach.s[0])

    def _cells(self, first: Numbers, last: Numbers) -> tuple[Numbers, Numbers]:
        """Number of the box and of the cell for every cell of the boxes first … last (2, n)."""
        return cells_of(first, last, int(self.shape[1]))

    def _heights(
        self, box: Numbers, cell: Numbers, long: Flags, corners: tuple[Array, Array, Array]
    ) -> tuple[Flags, Array]:
        """Whether casters ``box`` (n,) have a part in cells of the rectangles around them, and an
        upper bound of its s: a ``long`` one that lies aslant is in few, and high in fewer still.

        ``corners``: p, q, s of theirs, (count, 4) each.
        """
        met, height = np.ones(len(box), bool), self.highest[box]
        asked = np.flatnonzero(long[box])
        if not len(asked):
            return met, height
        box, cell = box[asked], cell[asked]
        middle, half = self.rectangles(cell)
        inside = np.ones(len(box), bool)
        for gap, width in self.beside(box, middle, half):
            inside &= gap <= width
        met[asked] = inside
        slopes, rest = self._slopes(*corners)
        bound = rest[box]
        for slope, at, reach in zip(slopes, middle, half, strict=True):
            bound += slope[box] * at + np.abs(slope[box]) * reach
        height[asked] = np.minimum(bound, height[asked])
        return met, height

    def _slopes(self, p: Array, q: Array, s: Array) -> tuple[tuple[Array, Array], Array]:
        """How s of each caster changes with p and q, (n,) each, and the most that is left of it.

        A plane's s is linear in p and q; what lies between corners is no farther from any linear
        function than they are.
        """
        (p0, q0, s0), (p1, q1, s1) = (
            [v[:, 2] - v[:, 0] for v in (p, q, s)], [v[:, 3] - v[:, 1] for v in (p, q, s)],
        )  # fmt: skip
        with np.errstate(divide="ignore", invalid="ignore"):
            area = p0 * q1 - p1 * q0
            along = (s0 * q1 - s1 * q0) / area, (s1 * p0 - s0 * p1) / area
            rest = s - along[0][:, None] * p - along[1][:, None] * q
            most = rest.max(axis=1)
            scale = np.abs(along[0][:, None] * p).max(axis=1)
            scale += np.abs(along[1][:, None] * q).max(axis=1)
        sound = np.isfinite(most)
        most = np.where(
            sound, most + 1e-9 * np.where(sound, scale + self.highest, 0.0), self.highest
        )
        return (np.where(sound, along[0], 0.0), np.where(sound, along[1], 0.0)), most

    def _unmapped(self, values: Array) -> Array:
        """The inverse of `_mapped`."""
        if self.view.lamp.far:
            return values
        return np.clip(values / np.maximum(1.0 - np.abs(values), 1e-150), -1e150, 1e150)

    def _window(self, reach: Reach, top: Array) -> tuple[Numbers, Numbers]:
        """Cells (2, n) from first to last that receivers look at for casters up to s = ``top``."""
        rise = np.clip(top - reach.s[0], 0.0, 1e150)
        first, last = np.empty((2, 2, len(rise)), np.int64)
        for axis, own in enumerate((reach.p, reach.q)):
            span = rise * self.view.half[axis]
            limit = int(self.shape[1 - axis])
            low = self._mapped(own[0] - span)
            low -= self.origin[axis]
            low /= self.size[axis]
            high = self._mapped(own[1] + span)
            high -= self.origin[axis]
            high /= self.size[axis]
            # just outside the grid on an empty side: such windows are empty
            first[axis] = np.clip(np.floor(low, out=low), 0, limit, out=low)
            last[axis] = np.clip(np.floor(high, out=high), -1, limit - 1, out=high)
        return first, last

    def _highest(self, first: Numbers, last: Numbers) -> Array:
        """An upper bound of s over windows of cells; -inf where they are empty."""
        span = np.maximum(np.maximum(last[0] - first[0], last[1] - first[1]), 0) + 1
        # the level at which a window has two cells at most either way
        level = np.minimum(np.frexp(span - 0.5)[1], len(self.level) - 1).astype(np.int64)
        rows, columns = self.rows[level] - 1, self.columns[level]
        left, right = (np.minimum(end[0] >> level, columns - 1) for end in (first, last))
        start = self.level[level]
        above, below = (
            start + np.minimum(end[1] >> level, rows) * columns for end in (first, last)
        )
        result: Array = self.pyramid[above + left]
        for place in (above + right, below + left, below + right):
            np.maximum(result, self.pyramid[np.maximum(place, 0)], out=result)
        result[(last[0] < first[0]) | (last[1] < first[1])] = -np.inf
        return result

    def top(self, reach: Reach) -> Array:
        """An upper bound of s of the casters that may hide the lamp; -inf where there are none."""
        top = np.full(reach.s.shape[1], -np.inf)
        left = np.flatnonzero(np.isfinite(reach.s[0]))
        own, most = reach[left], np.full(len(left), self.pyramid[-1])
        for _ in range(3):  # the wider one looks, the nearer to the lamp things may be
            found = self._highest(*self._window(own, most))
            some = np.flatnonzero(found > own.s[0])
            left, own, most = left[some], own[some], np.minimum(found, most)[some]
        top[left] = self._lowered(own, most)
        return top

    def _lowered(self, reach: Reach, most: Array) -> Array:
        """The same bound ``most`` for receivers, lower where they look at many cells.

        A face that runs past the lamp, as a wall does, is high somewhere: cells of the pyramid that
        hold a wide window hold that as well, and the window stays wide.
        """
        first, last = self._window(reach, most)
        rows = np.flatnonzero((last - first).max(axis=0, initial=0) >= WIDE)
        for _ in range(ROUNDS):
            if not len(rows):
                break
            own, before = reach[rows], most[rows]
            found = self._windows.highest(*self._window(own, before))
            most[rows] = np.where(found > own.s[0], np.minimum(found, before), -np.inf)
            rows = rows[(found < before) & (found > own.s[0])]
        return most

    @cached_property
    def _windows(self) -> Windows:
        """The highest s of nothing but the cells of windows."""
        return Windows(self.pyramid[: int(self.shape.prod())].reshape(self.shape))

    def may_hide(self, reach: Reach) -> Flags:
        """(n,) whether a caster may lie between the lamp and receivers in boxes; never misses."""
        if not self.count:
            return np.zeros(reach.s.shape[1], bool)
        return np.asarray(self.top(reach) > -np.inf)

    def asked(self, reach: Reach, top: Array | None = None) -> int:
        """Entries of the cells that receivers in boxes look at, before their s is ``top`` (n,)."""
        if not self.count:
            return 0
        usable = np.flatnonzero(np.isfinite(reach.s[0]))
        if len(usable) < reach.s.shape[1]:
            reach, top = reach[usable], None if top is None else top[usable]
        first, last = self.window(reach, top)
        some = np.flatnonzero((last >= first).all(axis=0))
        (left, top), (right, bottom) = first[:, some], last[:, some] + 1
        sums = np.zeros(self.shape + 1, np.int64)
        sums[1:, 1:] = np.diff(self.start).reshape(self.shape).cumsum(axis=0).cumsum(axis=1)
        every = sums[bottom, right] - sums[top, right] - sums[bottom, left] + sums[top, left]
        return int(every.sum())

    def _one_by_one(self, reach: Reach, box: Numbers) -> tuple[Numbers, Numbers]:
        """`candidates` among the boxes ``box``, caster by caster: where these fill many cells."""
        own = reach[box]
        boxes, casters = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
        for caster in range(self.count):
            rise = np.clip(self.highest[caster] - own.s[0], 0.0, 1e150)
            keep = (rise > 0.0) & overlap(
                self.view.half, own, slice(None), self.reach, caster, rise
            )
            boxes.append(box[keep])
            casters.append(np.full(len(boxes[-1]), caster))
        return np.concatenate(boxes), np.concatenate(casters)

    def candidates(self, reach: Reach) -> tuple[Numbers, Numbers]:
        """Pairs (box, caster of this grid) that may hide the lamp from a receiver in the box."""
        if not self.count:
            return np.zeros(0, np.int64), np.zeros(0, np.int64)
        first, last = self.window(reach)
        # the casters of a row of cells lie side by side
        run, row = expand(np.where(last[0] < first[0], 0, np.maximum(last[1] - first[1] + 1, 0)))
        row += first[1][run]
        cell = row * self.shape[1]
        start = self.start[cell + first[0][run]]
        stop = self.start[cell + last[0][run] + 1]
        filled = np.flatnonzero(stop > start)
        run, row, start, stop = run[filled], row[filled], start[filled], stop[filled]
        if self.count * len(reach.s[0]) < EACH * int((stop - start).sum()):
            return self._one_by_one(reach, np.flatnonzero((last >= first).all(axis=0)))
        several = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
        for part in batches(stop - start, TOGETHER):
            found = self._in_runs(reach, first, run[part], row[part], start[part], stop[part])
            for all_found, own in zip(several, found, strict=True):
                all_found.append(own)
        return np.concatenate(several[0]), np.concatenate(several[1])

    def _in_runs(
        self, reach: Reach, first: Numbers, run: Numbers, row: Numbers, start: Numbers,
        stop: Numbers,
    ) -> tuple[Numbers, Numbers]:  # fmt: skip
        """`candidates` in runs of cells: each box's ``run`` (n,) of entries from ``start`` to
        ``stop`` in a ``row`` of the window whose ``first`` cell (2, boxes) is known."""
        which, offset = expand(stop - start)
        offset += start[which]
        box, caster = run[which], self.entry[offset]
        rise = self.highest[caster] - reach.s[0][box]
        kept = np.flatnonzero(rise > 0.0)
        box, caster, rise = box[kept], caster[kept], rise[kept]
        which, offset = which[kept], offset[kept]
        # a caster in several cells of a window counts in the first of them
        keep = np.maximum(self.first[1][caster], first[1][box]) == row[which]
        keep &= np.maximum(self.first[0][caster], first[0][box]) == self.column[offset]
        kept = np.flatnonzero(keep)
        box, caster, rise = box[kept], caster[kept], np.minimum(rise[kept], 1e150)
        kept = np.flatnonzero(overlap(self.view.half, reach, box, self.reach, caster, rise))
        return box[kept], caster[kept]
