"""Edges of borders that hide what they wind round of a lamp, tile by tile of a picture.

How often they wind round a sample of the lamp tell the edges of its row on the right of it, the
lamp's first direction. A tile looks through a window of the lamp's view: of edges on its right only
what begins and ends in its rows counts, or above them. Closed by edges to a point to the right and
below it winds as often round what is inside.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.optics.lamp_view import LampView

__all__ = ["MOST_TURNS", "Closing", "TileEdges", "most_turns"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

MOST_TURNS = 7
"""That are told from none (`gpusim.optics.occlusion`)."""


@dataclass(frozen=True, eq=False)
class TileEdges:
    """``tile`` (n,), linear, and ``ends`` (n, 2, 3) world: edges of borders that hide a
    lamp; ``cut`` (n, 4): normal of the plane beyond which they do, and its offset (world);
    ``last`` (n,): whether it is a border's last one in the tile."""

    tile: Numbers
    ends: Array
    cut: Array
    last: Flags

    @staticmethod
    def none() -> TileEdges:
        """No edge."""
        return TileEdges(
            np.zeros(0, np.int64), np.zeros((0, 2, 3)), np.zeros((0, 4)), np.zeros(0, bool)
        )

    def __getitem__(self, index: Numbers) -> TileEdges:
        return TileEdges(self.tile[index], self.ends[index], self.cut[index], self.last[index])

    @staticmethod
    def joined(parts: list[TileEdges]) -> TileEdges:
        """All in one, one part after the other."""
        parts = [TileEdges.none(), *parts]
        return TileEdges(
            np.concatenate([part.tile for part in parts]),
            np.concatenate([part.ends for part in parts]),
            np.concatenate([part.cut for part in parts]),
            np.concatenate([part.last for part in parts]),
        )


@dataclass(frozen=True, eq=False)
class Closing:
    """Edges to a point on the right of windows and below them: the ``border`` (n,) of each, and the
    ``vertex`` that it goes from, or the number of vertices for a point above; ``back`` (n,): the
    other way round. ``many`` (m,): borders that go so often to one of these that seven times one
    way can't be told from once the other way."""

    border: Numbers
    vertex: Numbers
    back: Flags
    many: Numbers

    @staticmethod
    def of(
        border: Numbers, first: Numbers, second: Numbers, q: Array, rows: tuple[Array, Array]
    ) -> Closing:
        """What takes the place of edges of borders (n,) from vertices ``first`` to ``second`` (n,)
        that lie on the right of windows with ``rows``, first and last q (n,); ``q`` (V,) of
        vertices."""
        above, below = len(q), len(q) + 1
        low, high = rows
        keys = []
        for vertex in (first, second):
            code = np.where(q[vertex] > high, above, vertex)
            keys.append(border * (below + 1) + np.where(q[vertex] < low, below, code))
        key, place = np.unique(np.concatenate(keys), return_inverse=True)
        sign = np.repeat([1.0, -1.0], len(border))
        # turns are counted up to 7: seven are one the other way
        net = np.bincount(place, sign, minlength=len(key)).astype(np.int64)
        own, code = np.divmod(key, below + 1)
        net[code == below] = 0
        many = np.unique(own[np.abs(net) > MOST_TURNS // 2])
        net %= 8
        times = np.minimum(net, 8 - net)
        back = np.repeat(net > 4, times)
        return Closing(np.repeat(own, times), np.repeat(code, times), back, many)

    def ends(self, points: Array, high: Array, low: Array) -> Array:
        """(n, 2, 3) where the edges begin and end: ``points`` (V, 3), and those above and below on
        the right (n, 3)."""
        own = self.vertex < len(points)
        begin = np.where(own[:, None], points[np.where(own, self.vertex, 0)], high)
        result = np.stack([begin, low], axis=1)
        result[self.back] = result[self.back, ::-1]
        return result


def most_turns(view: LampView, box: Numbers, ends: Array, count: int) -> Numbers:
    """(count,) an upper bound of how often the edges with ``ends`` (n, 2, 3), world, of each
    ``box`` (n,), ascending, wind round anything, seen from any point of the lamp.

    As many edges as go one way across a row: those whose rows overlap from some of its points. Not
    all of a border need be there.
    """
    if not len(box):
        return np.zeros(count, np.int64)
    _, q, s = (v.reshape(-1, 2) for v in view.place(*np.ascontiguousarray(ends.reshape(-1, 3).T)))
    first = np.flatnonzero(np.diff(box, prepend=-1))
    low, high = np.minimum.reduceat(s.min(axis=1), first), np.maximum.reduceat(s.max(axis=1), first)
    middle = np.repeat(0.5 * (low + high), np.diff(np.append(first, len(box))))
    shift, bend = (
        view.half[1] * np.abs(s - middle[:, None]),
        view.half[1] * np.abs(s[:, 1] - s[:, 0]),
    )
    least, most = (q - shift).min(axis=1), (q + shift).max(axis=1)
    rise = q[:, 1] - q[:, 0]
    turns = [_overlap(box[k], least[k], most[k], count) for k in (rise >= -bend, rise <= bend)]
    return np.maximum(*turns)


def _overlap(box: Numbers, low: Array, high: Array, count: int) -> Numbers:
    """(count,) how many of each ``box``'s (n,) intervals from ``low`` to ``high`` (n,) overlap at
    most."""
    result, box = np.zeros(count, np.int64), np.tile(box, 2)
    step = np.repeat([1, -1], len(low))
    # what begins where another one ends overlaps with it
    order = np.lexsort((-step, np.concatenate([low, high]), box))
    crossed, box = np.cumsum(step[order]), box[order]
    first = np.flatnonzero(np.diff(box, prepend=-1))
    if len(first):
        result[box[first]] = np.maximum.reduceat(crossed, first)
    return result
