"""Casters filed by where a lamp sees them, so that a receiver finds those that may hide the lamp.

In the frame of a lamp, p = x / w and q = y / w across its axis and s = 1 / w along it, the lamp's
plane lies at infinity: a ray from a receiver X to the lamp's point l runs along
p = p_X + l (s - s_X). So a face reaches, beyond its own box in p and q, half the lamp's size times
the difference in s, and a receiver looks only under its own p and q. The sun's frame is the same
with s the distance towards it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.optics.casters import Casters, LampFaces
from gpusim.optics.emitters import Lamp

__all__ = ["LampGrid", "LampView", "Reach"]

Array = npt.NDArray[np.float64]
MOST_CELLS = 1 << 20


@dataclass(frozen=True, eq=False)
class Reach:
    """Boxes (n, 2) each in p, q and s of a lamp's view: low and high ends."""

    p: Array
    q: Array
    s: Array

    def __getitem__(self, index: npt.NDArray[np.int64] | npt.NDArray[np.bool_]) -> Reach:
        return Reach(self.p[index], self.q[index], self.s[index])


@dataclass(frozen=True, eq=False)
class LampView:
    """One half space before a lamp: its frame, and half the lamp's size in it."""

    lamp: Lamp
    across: Array
    along: Array
    axis: Array
    half: tuple[float, float]

    @staticmethod
    def of(lamp: Lamp) -> list[LampView]:
        """Both half spaces of a lamp that shines all round, one of any other."""
        if lamp.extended:
            size = float(np.linalg.norm(lamp.u)), float(np.linalg.norm(lamp.v))
            return [LampView(lamp, lamp.u / size[0], lamp.v / size[1], lamp.axis, size)]
        axes = [lamp.axis]
        if not np.any(lamp.axis):
            axes = [np.array([0.0, 1.0, 0.0]), np.array([0.0, -1.0, 0.0])]
        result = []
        for axis in axes:
            helper = np.eye(3)[int(np.argmin(np.abs(axis)))]
            across = np.cross(axis, helper)
            across /= np.linalg.norm(across)
            result.append(LampView(lamp, across, np.cross(axis, across), axis, (0.0, 0.0)))
        return result

    def place(self, points: Array) -> tuple[Array, Array, Array]:
        """p, q, s of world points (…, 3); behind the lamp all are NaN."""
        if self.lamp.far:
            return points @ self.across, points @ self.along, -(points @ self.axis)
        relative = points - self.lamp.centre
        w = relative @ self.axis
        w = np.where(w > 1e-9 * np.abs(relative).max(initial=1e-300), w, np.nan)
        return (relative @ self.across) / w, (relative @ self.along) / w, 1.0 / w

    def reach(self, points: Array) -> Reach:
        """Boxes around groups of points (n, k, 3): unlimited where some lie behind the lamp.

        Where all do, s is -inf: nothing there can be lit, and nothing hides the lamp.
        """
        p, q, s = self.place(points)
        behind = np.isnan(s).any(axis=1)
        none = np.isnan(s).all(axis=1)
        p, q = np.where(np.isnan(p), 0.0, p), np.where(np.isnan(q), 0.0, q)

        def box(values: Array) -> Array:
            low = np.where(behind, -np.inf, values.min(axis=1))
            return np.stack([low, np.where(behind, np.inf, values.max(axis=1))], axis=1)

        low = np.where(np.isnan(s), np.inf, s).min(axis=1)
        high = np.where(behind, np.inf, np.where(np.isnan(s), 0.0, s).max(axis=1))
        low, high = np.where(none, -np.inf, low), np.where(none, -np.inf, high)
        return Reach(box(p), box(q), np.stack([low, high], axis=1))


class LampGrid:
    """Casters of one view of a lamp, in square cells of p and q, each with its highest s."""

    def __init__(self, view: LampView, casters: Casters, faces: LampFaces, lowest: float) -> None:
        """``lowest``: the smallest s of any receiver."""
        self.view = view
        reach = view.reach(casters.corners[faces.face])
        ahead = np.flatnonzero(reach.s[:, 1] > max(lowest, -1e300))
        self.face, self.rim = faces.face[ahead], faces.rim[ahead]
        self.side, self.reach = faces.side[ahead], reach[ahead]
        low, high = self._dilated(self.reach, np.full(len(ahead), lowest))
        low, high = self._mapped(low), self._mapped(high)
        self.count = len(ahead)
        self.origin = low.min(axis=0, initial=np.inf) if self.count else np.zeros(2)
        extent = high.max(axis=0, initial=-np.inf) - self.origin if self.count else np.ones(2)
        extent = np.maximum(extent, 1e-12)
        size = float(np.median((high - low).max(axis=1))) if self.count else 1.0
        size = max(size, float(np.sqrt(extent.prod() / MOST_CELLS)), float(extent.max()) / 2048)
        self.size = size
        self.shape = (np.floor(extent / size).astype(np.int64) + 1)[::-1]
        first = np.floor((low - self.origin) / size).astype(np.int64)
        last = np.floor((high - self.origin) / size).astype(np.int64)
        box, cell = self._cells(first, last)
        order = np.argsort(cell, kind="stable")
        self.entry = box[order]
        self.start = np.searchsorted(cell[order], np.arange(self.shape.prod() + 1))
        top = np.full(self.shape, -np.inf)
        np.maximum.at(top.reshape(-1), cell, self.reach.s[box, 1])
        self.pyramid = [top]
        while max(self.pyramid[-1].shape) > 1:
            top = self.pyramid[-1]
            top = np.pad(top, [(0, n % 2) for n in top.shape], constant_values=-np.inf)
            self.pyramid.append(
                top.reshape(top.shape[0] // 2, 2, top.shape[1] // 2, 2).max(axis=(1, 3))
            )

    def _dilated(self, reach: Reach, lowest: Array) -> tuple[Array, Array]:
        """Where (n, 2) receivers at s = ``lowest`` or above may be hidden by the boxes."""
        high = np.where(np.isfinite(reach.s[:, 1]), reach.s[:, 1], 1e300)
        span = np.maximum(high - lowest, 0.0)[:, None] * self.view.half
        low = np.stack([reach.p[:, 0], reach.q[:, 0]], axis=1)
        return low - span, np.stack([reach.p[:, 1], reach.q[:, 1]], axis=1) + span

    def _mapped(self, values: Array) -> Array:
        """Finite coordinates of the grid: p and q of half a space reach to infinity."""
        values = np.clip(values, -1e150, 1e150)
        if self.view.lamp.far:
            return values
        return values / (1.0 + np.abs(values))

    def _cells(
        self, first: npt.NDArray[np.int64], last: npt.NDArray[np.int64]
    ) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """Number of the box and of the cell for every cell of the boxes first … last (n, 2)."""
        wide, tall = (np.maximum(last - first + 1, 0)).T
        per = wide * tall
        box = np.repeat(np.arange(len(per)), per)
        offset = np.arange(len(box)) - np.repeat(np.cumsum(per) - per, per)
        column = first[box, 0] + offset % np.maximum(wide[box], 1)
        row = first[box, 1] + offset // np.maximum(wide[box], 1)
        return box, row * self.shape[1] + column

    def _window(self, reach: Reach) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        low = self._mapped(np.stack([reach.p[:, 0], reach.q[:, 0]], axis=1))
        high = self._mapped(np.stack([reach.p[:, 1], reach.q[:, 1]], axis=1))
        limit = self.shape[::-1]
        # just outside the grid on an empty side: such windows are empty
        first = np.clip(np.floor((low - self.origin) / self.size), 0, limit).astype(np.int64)
        last = np.clip(np.floor((high - self.origin) / self.size), -1, limit - 1).astype(np.int64)
        return first, last

    def may_hide(self, reach: Reach) -> npt.NDArray[np.bool_]:
        """(n,) whether a caster may lie between the lamp and receivers in boxes; never misses."""
        if not self.count:
            return np.zeros(len(reach.s), bool)
        first, last = self._window(reach)
        filled = (last >= first).all(axis=1) & np.isfinite(reach.s[:, 0])
        span = np.maximum(last - first, 0).max(axis=1) + 1
        level = np.ceil(np.log2(span)).astype(np.int64)
        top = np.full(len(reach.s), -np.inf)
        for k in np.unique(level[filled]):
            rows = np.flatnonzero(filled & (level == k))
            grid = self.pyramid[min(int(k), len(self.pyramid) - 1)]
            a, b = first[rows] >> k, last[rows] >> k
            for i in (a[:, 0], b[:, 0]):
                for j in (a[:, 1], b[:, 1]):
                    i, j = np.minimum(i, grid.shape[1] - 1), np.minimum(j, grid.shape[0] - 1)
                    top[rows] = np.maximum(top[rows], grid[j, i])
        return np.asarray(filled & (top > reach.s[:, 0]))

    def candidates(
        self, reach: Reach
    ) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """Pairs (box, caster of this grid) that may hide the lamp from a receiver in the box."""
        first, last = self._window(reach)
        box, cell = self._cells(first, last)
        count = self.start[cell + 1] - self.start[cell]
        box = np.repeat(box, count)
        offset = np.arange(len(box)) - np.repeat(np.cumsum(count) - count, count)
        caster = self.entry[np.repeat(self.start[cell], count) + offset]
        own, other = reach[box], self.reach[caster]
        low, high = self._dilated(other, own.s[:, 0])
        keep = (other.s[:, 1] > own.s[:, 0]) & (low[:, 0] <= own.p[:, 1])
        keep &= (high[:, 0] >= own.p[:, 0]) & (low[:, 1] <= own.q[:, 1])
        keep &= high[:, 1] >= own.q[:, 0]
        key = np.unique(box[keep] * np.int64(max(self.count, 1)) + caster[keep])
        return key // max(self.count, 1), key % max(self.count, 1)
