"""Faces of a mesh in rows: each beside the next, across edges that are opposite in every face.

They depend on which faces are neighbours alone: those of a surface are found once for all frames.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

__all__ = ["QuadStrips", "links"]

Numbers = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class QuadStrips:
    """``face`` (n,): row by row, those without neighbours left out; ``start`` (R,): where each row
    begins; ``linked`` (n,): whether the next one is beside it, of a row's last its first one."""

    face: Numbers
    start: Numbers
    linked: Flags

    @staticmethod
    def of(link: Numbers) -> QuadStrips:
        """``link`` (F,): the face that follows each one, no other's, or -1."""
        before = np.full(len(link), -1)
        followed = np.flatnonzero(link >= 0)
        before[link[followed]] = followed
        some = (link >= 0) | (before >= 0)
        head, place = _ahead(before)
        ring = place[head] > 0
        if ring.any():
            before[_lowest(before, ring)] = -1
            head, place = _ahead(before)
        member = np.flatnonzero(some)
        count = np.bincount(head[member], minlength=len(link))
        face = np.empty(len(member), np.int64)
        face[(np.cumsum(count) - count)[head[member]] + place[member]] = member
        count = count[count > 0]
        return QuadStrips(face, np.cumsum(count) - count, link[face] >= 0)

    def among(self, number: Numbers, link: Numbers) -> QuadStrips:
        """Rows of faces joined from these: ``number`` (F,) those that the first of them got, -1 of
        the others; ``link``: as in `of`."""
        number = number[self.face]
        kept = number >= 0
        before = np.append(0, np.cumsum(kept))
        start, end = before[self.start], before[np.append(self.start[1:], len(kept))]
        face = number[kept]
        rows = QuadStrips(face, start[start < end], np.zeros(len(face), bool))
        linked = (link[face] >= 0) & (link[face] == face[rows.after])
        if np.count_nonzero(linked) < np.count_nonzero(link >= 0):
            return QuadStrips.of(link)
        return QuadStrips(face, rows.start, linked)

    @property
    def after(self) -> Numbers:
        """(n,): the place of the next one in a row; of the last, that of the first."""
        result = np.arange(1, len(self.face) + 1)
        if len(self.start):
            result[np.append(self.start[1:], len(result)) - 1] = self.start
        return result

    def every_second(self, good: Flags) -> Numbers:
        """The places of pairs, each one with the next, that share none: of those that follow each
        other and are ``good`` (n,) the first, the third and so on. None of rings of good ones."""
        place = np.arange(len(good))
        bad = np.where(good, -1, place)
        bad[self.start] = np.maximum(bad[self.start], self.start - 1)
        run = place - np.maximum.accumulate(bad) - 1
        last = np.append(self.start[1:], len(good))[: len(self.start)] - 1
        chosen = good & (run % 2 == 0)
        round_ = np.flatnonzero(good[last])
        if len(round_):
            # rings: what leads their row continues what ends it
            tail = np.zeros(len(self.start), np.int64)
            tail[round_] = run[last[round_]] + 1
            first = np.repeat(self.start, last - self.start + 1)
            more = np.repeat(tail, last - self.start + 1)
            whole = np.repeat(tail == last - self.start + 1, last - self.start + 1)
            run += np.where(run == place - first, more, 0)
            chosen = good & (run % 2 == 0) & ~whole
        return np.flatnonzero(chosen)

    def some(self, kept: Numbers) -> QuadStrips:
        """Those at some places (n,), ascending, one of each row at least."""
        start = np.searchsorted(kept, self.start)
        return QuadStrips(np.take(self.face, kept), start, np.take(self.linked, kept))


def links(corner: list[Numbers], ahead: Numbers, back: Numbers, k: int) -> Numbers:
    """(F,) the quadrilateral across edge ``k`` of each one, its own edge opposite there; or -1.

    ``corner``: columns (F,) of vertices; ``ahead`` and ``back`` (F,): what is across edge ``k`` and
    the opposite one.
    """
    quad = np.ones(len(corner[0]), bool)
    for j in range(4):
        quad &= corner[j] != corner[j - 1]
    known = np.flatnonzero((ahead >= 0) & quad)
    partner = ahead[known]
    good = (back[partner] == known) & quad[partner]
    # the common edge runs one way in the one, the other way in the other
    good &= corner[k][known] == corner[(k + 3) % 4][partner]
    good &= corner[(k + 1) % 4][known] == corner[(k + 2) % 4][partner]
    result = np.full(len(quad), -1)
    result[known[good]] = partner[good]
    return result


def _ahead(before: Numbers) -> tuple[Numbers, Numbers]:
    """Of faces (F,) with another ``before`` them, or -1: the first of their row, and how many are
    before them. Those of rings end somewhere."""
    place = (before >= 0).astype(np.int64)
    head = np.where(before >= 0, before, np.arange(len(before)))
    for _ in range(len(before).bit_length()):
        step = place[head]
        if not step.any():
            break
        place += step
        head = head[head]
    return head, place


def _lowest(before: Numbers, ring: Flags) -> Numbers:
    """The lowest number of each ring."""
    low = np.arange(len(before))
    ahead = np.where(ring, before, low)
    for _ in range(len(before).bit_length()):
        low = np.minimum(low, low[ahead])
        ahead = ahead[ahead]
    return np.flatnonzero(ring & (low == np.arange(len(before))))
