"""Closed chains of edges in a lamp's view: whether they cross, and how they wind."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.optics.lamp_view import seen_from
from gpusim.optics.ragged import expand

__all__ = ["Loops"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]
Half = tuple[float, float]

MOST, MOST_LOOPS = 20_000, 200
"""Edges, and chains of them, that are looked at."""

BLOCK = 32
"""Edges that are taken together first."""

MOST_PAIRS = 4_000_000
"""Of edges near each other, that are looked at one by one."""

ZIGZAG = 8
"""Edges of a chain that may cross others of these; so few that they don't wind round anything more
than `gpusim.optics.tile_edges.MOST_TURNS` times."""

APART = 1e-12
"""Of the extent, that counts as a gap."""


@dataclass(frozen=True, eq=False)
class Loops:
    """``vertex`` (n,) at which each edge begins, chain by chain; ``after`` (n,): the next edge;
    ``start`` (L,): each chain's first one."""

    vertex: Numbers
    after: Numbers
    start: Numbers

    @staticmethod
    def of(starts: Numbers, ends: Numbers) -> Loops | None:
        """The chains of edges between vertices (n,) each; None where they part, are too many, or
        there are none."""
        if not 0 < len(starts) <= MOST or len(np.unique(starts)) < len(starts):
            return None
        if not np.array_equal(np.sort(starts), np.sort(ends)):
            return None
        following = dict(zip(starts.tolist(), ends.tolist(), strict=True))
        vertex: list[int] = []
        start: list[int] = []
        while following:
            begin, end = following.popitem()
            start.append(len(vertex))
            vertex.append(begin)
            while end != begin:
                vertex.append(end)
                end = following.pop(end)
        if len(start) > MOST_LOOPS:
            return None
        after = np.arange(1, len(vertex) + 1)
        after[np.array([*start[1:], len(vertex)]) - 1] = start
        return Loops(np.array(vertex), after, np.array(start))

    def wind_once(self, places: Array, half: Half) -> bool:
        """Whether no edges cross and none winds round what another one does, all the same way,
        seen from any point of a lamp with ``half`` its size; ``places`` (3, P): p, q and s, see
        `gpusim.optics.lamp_view`."""
        at = places[:, self.vertex]
        if self._folded(at, half):
            return False
        meets = self._meets(at, half)
        return meets is not None and not len(meets[0]) and self._nested(at)

    def folds(self, places: Array, half: Half) -> float | None:
        """The same of chains that zigzag, so that edges cross the next ones but few: how far these
        reach, in p and q; None where edges cross otherwise."""
        at = places[:, self.vertex]
        meets = self._meets(at, half)
        if meets is None or not self._nested(at):
            return None
        a, b = meets
        owner = np.searchsorted(self.start, a, side="right")
        length = np.diff(np.append(self.start, len(self.vertex)))[owner - 1]
        same = owner == np.searchsorted(self.start, b, side="right")
        over = same & (2 * (b - a) > length)
        # in the order of the chain
        a, b = np.where(over, b, a), np.where(over, a, b)
        count = np.where(over, b - a + length, b - a)
        if not (same & (count <= ZIGZAG)).all():
            return None
        reach = 0.0
        for corner in _corners_of(half):
            x, vertex = seen_from(at, *corner)[:2], a
            for k in range(int(count.max(initial=0))):
                vertex = self.after[vertex]
                # the end of the first edge is on that, the start of the second one on the other
                first = np.where(k == 0, np.inf, _distance(x, vertex, a, self.after[a]))
                second = np.where(k == count - 1, np.inf, _distance(x, vertex, b, self.after[b]))
                away = np.where(k < count, np.minimum(first, second), 0.0)
                reach = max(reach, float(away.max(initial=0.0)))
        return reach

    def _nested(self, at: Array) -> bool:
        """Whether chains wind once at most, all the same way, as far as none crosses another."""
        # chains that don't cross: each is inside or outside of another one as a whole
        x, y = at[:2] - at[:2].mean(axis=1, keepdims=True)
        area = np.add.reduceat(x * y[self.after] - x[self.after] * y, self.start)
        way, total = np.sign(area), np.zeros(len(self.start))
        owner = np.repeat(np.arange(len(self.start)), np.diff(np.append(self.start, len(x))))
        for number, first in enumerate(self.start):
            crossed = (y <= y[first]) != (y[self.after] <= y[first])
            edge = np.flatnonzero(crossed & (owner != number))
            share = (y[first] - y[edge]) / (y[self.after[edge]] - y[edge])
            beyond = x[edge] + share * (x[self.after[edge]] - x[edge]) > x[first]
            rising = np.where(y[self.after[edge]] > y[edge], 1.0, -1.0)
            total[number] = rising[beyond].sum()
        both = np.concatenate([total, total + way])
        return bool((way != 0.0).all() and (((both == 0) | (both == 1)).all()
                                            or ((both == 0) | (both == -1)).all()))  # fmt: skip

    def _folded(self, at: Array, half: Half) -> bool:
        """Whether an edge may run back along the one before it."""
        way = at[:, self.after] - at
        other = way[:, self.after]
        # by how much a way may differ from one point of the lamp to another
        e, f = (np.hypot(*half) * np.abs(v[2]) for v in (way, other))
        size, next_size = np.hypot(*way[:2]), np.hypot(*other[:2])
        slack = size * f + next_size * e + e * f + 1e-9 * size * next_size
        turn = np.abs(way[0] * other[1] - way[1] * other[0])
        on = way[0] * other[0] + way[1] * other[1]
        return not bool(((turn > slack) | (on > slack)).all())

    def _meets(self, at: Array, half: Half) -> tuple[Numbers, Numbers] | None:
        """Pairs of edges that don't follow each other and may meet from some point of the lamp;
        None where too many are near each other."""
        gap = APART * float(np.ptp(at[:2], axis=1).max())
        ends = at[:, self.after]
        low, high = np.minimum(at, ends), np.maximum(at, ends)
        begin = np.arange(0, low.shape[1], BLOCK)
        box = np.minimum.reduceat(low, begin, axis=1), np.maximum.reduceat(high, begin, axis=1)
        one, other = np.triu_indices(len(begin))
        near = _near(box, one, other, half, gap)
        one, other = one[near], other[near]
        size = np.minimum(begin + BLOCK, low.shape[1]) - begin
        if (size[one] * size[other]).sum() > MOST_PAIRS:
            return None
        pair, offset = expand(size[one] * size[other])
        wide = size[other[pair]]
        a, b = begin[one[pair]] + offset // wide, begin[other[pair]] + offset % wide
        kept = (a < b) & (self.after[a] != b) & (self.after[b] != a)
        a, b = a[kept], b[kept]
        near = _near((low, high), a, b, half, gap)
        a, b = a[near], b[near]
        apart = _beside(at, ends, a, b, half, gap) | _beside(at, ends, b, a, half, gap)
        return a[~apart], b[~apart]


def _corners_of(half: Half) -> list[Half]:
    """Those of a lamp's face with ``half`` its size, from its middle: one if it has none."""
    if not any(half):
        return [half]
    return [(i * half[0], j * half[1]) for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1))]


def _distance(at: Array, point: Numbers, start: Numbers, end: Numbers) -> Array:
    """(n,) how far points are from segments between others, of places (2, N)."""
    way, to = at[:, end] - at[:, start], at[:, point] - at[:, start]
    length = np.maximum(np.sum(way * way, axis=0), 1e-300)
    off = to - np.clip(np.sum(to * way, axis=0) / length, 0.0, 1.0) * way
    return np.asarray(np.hypot(*off))


def _near(box: tuple[Array, Array], a: Numbers, b: Numbers, half: Half, gap: float) -> Flags:
    """Which boxes ``a`` and ``b`` (n,) in p, q, s may meet from some point of the lamp."""
    (low, high), result = box, np.ones(len(a), bool)
    rise = np.maximum(high[2][a] - low[2][b], high[2][b] - low[2][a])
    for axis, size in enumerate(half):
        reach = size * rise + gap
        result &= low[axis][a] - reach <= high[axis][b]
        result &= low[axis][b] - reach <= high[axis][a]
    return result


def _beside(at: Array, ends: Array, a: Numbers, b: Numbers, half: Half, gap: float) -> Flags:
    """Which edges ``b`` lie on one side of the lines through edges ``a`` (n,)."""
    way = ends[:2, a] - at[:2, a]
    length = np.hypot(*way)
    normal = np.stack([way[1], -way[0]]) / np.where(length > 0.0, length, 1.0)
    s = np.stack([at[2, a], ends[2, a]]), np.stack([at[2, b], ends[2, b]])
    rise = np.maximum(s[0].max(axis=0) - s[1].min(axis=0), s[1].max(axis=0) - s[0].min(axis=0))
    reach = (np.abs(normal[0]) * half[0] + np.abs(normal[1]) * half[1]) * rise + gap
    line = np.sum(normal * at[:2, a], axis=0)
    height = np.stack([np.sum(normal * own[:2, b], axis=0) - line for own in (at, ends)])
    return np.asarray((height.min(axis=0) > reach) | (height.max(axis=0) < -reach))
