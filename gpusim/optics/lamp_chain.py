"""Closed chains of edges in a lamp's view, filed by their rows, and as coarse as is good enough."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import numpy.typing as npt

from gpusim.optics.loops import Loops
from gpusim.optics.ragged import expand

__all__ = ["Chain"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

BANDS = 512
"""In which edges are filed."""


class Chain:
    """``vertex`` (2, E): where edges begin and end; ``start`` and ``end`` (3, E): p, q, s of these
    (`gpusim.optics.lamp_view`)."""

    def __init__(self, vertex: Numbers, places: Array) -> None:
        """``places`` (3, P): of all vertices."""
        self.vertex = vertex
        self.start, self.end = (places[:, own] for own in vertex)

    @staticmethod
    def of(loops: Loops, places: Array, across: float, tolerance: float) -> Chain:
        """Those of ``loops`` with vertices left out from which the chords are no farther away than
        ``tolerance`` in p and q, seen from about anywhere on a lamp ``across`` half its larger
        side."""
        kept = np.ones(len(loops.vertex), bool)
        if tolerance > 0.0:
            at = places[:, loops.vertex]
            at[2] *= across
            for first, stop in zip(loops.start, [*loops.start[1:], len(kept)], strict=True):
                kept[first:stop] = _kept(at[:, first:stop], tolerance)
        own = np.flatnonzero(kept)
        loop = np.searchsorted(loops.start, own, side="right")
        after = np.arange(1, len(own) + 1)
        begins = np.flatnonzero(np.diff(loop, prepend=-1))
        after[np.append(begins[1:], len(own)) - 1] = begins
        vertex = loops.vertex[own]
        return Chain(np.stack([vertex, vertex[after]]), places)

    @cached_property
    def _bands(self) -> tuple[float, float, Numbers, Numbers, Numbers]:
        """Where bands of q begin, how wide they are, the first one of each edge, the edges band by
        band, and where each band's begin."""
        low, high = np.sort([self.start[1], self.end[1]], axis=0)
        origin = float(low.min())
        size = max((float(high.max()) - origin) / BANDS, 1e-300)
        first = np.minimum((low - origin) / size, BANDS - 1).astype(np.int64)
        last = np.minimum((high - origin) / size, BANDS - 1).astype(np.int64)
        edge, step = expand(last - first + 1)
        band = first[edge] + step
        order = np.argsort(band, kind="stable")
        start = np.searchsorted(band[order], np.arange(BANDS + 1))
        return origin, size, first, edge[order], start

    def rightwards(self, window: Array) -> tuple[Numbers, Numbers]:
        """Pairs of windows (2, 2, n), first and last p, and q, and edges in them, or in their rows
        to the right (of larger p)."""
        origin, size, begins, filed, start = self._bands
        first = np.clip((window[1, 0] - origin) / size, 0, BANDS).astype(np.int64)
        last = np.clip(np.floor((window[1, 1] - origin) / size), -1, BANDS - 1).astype(np.int64)
        box, step = expand(np.maximum(last - first + 1, 0))
        band = first[box] + step
        pair, step = expand(start[band + 1] - start[band])
        edge = filed[start[band[pair]] + step]
        box, band = box[pair], band[pair]
        # an edge in several bands counts in the first of them
        keep = np.maximum(begins[edge], first[box]) == band
        box, edge = box[keep], edge[keep]
        low, high = np.sort([self.start[1], self.end[1]], axis=0)
        right = np.maximum(self.start[0], self.end[0])
        keep = (high[edge] >= window[1, 0, box]) & (low[edge] <= window[1, 1, box])
        keep &= right[edge] >= window[0, 0, box]
        return box[keep], edge[keep]


def _kept(at: Array, tolerance: float) -> Flags:
    """(n,) which of the places (3, n) of a closed chain stay: runs of 2, 4, 8 … edges become one
    where none of the places between is farther from it than ``tolerance``."""
    count = at.shape[1]
    result = np.ones(count, bool)
    many = 2
    while 2 * many <= count:
        runs = count // many
        own = at[:, : runs * many].reshape(3, runs, many)
        begin = own[:, :, :1]
        end = at[:, (np.arange(1, runs + 1) * many) % count][:, :, None]
        way = end - begin
        length = np.maximum(np.sum(way * way, axis=0), 1e-300)
        share = np.clip(np.sum((own - begin) * way, axis=0) / length, 0.0, 1.0)
        off = own - begin - share * way
        straight = (np.sum(off * off, axis=0) <= tolerance**2).all(axis=1)
        if not straight.any():
            break
        inside = np.zeros((runs, many), bool)
        inside[straight, 1:] = True
        result[: runs * many][inside.reshape(-1)] = False
        many *= 2
    return result
