"""Flat parts of a mesh as fewer, larger quadrilaterals.

A finite element mesh divides flat sides into many faces; for what they hide only their common
outline counts. Neighbours in a row are joined in pairs, again and again, while the corners between
them stay within a tolerance of the straight sides. Rows of faces, each beside the next, run across
edges that are opposite in every face; they depend on which faces are neighbours alone, and are
found once for all frames.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.optics.geometry.triangle_corners import CHUNK, products
from gpusim.surface.topology import sorted_keys


@dataclass(frozen=True, eq=False)
class QuadStrips:
    """``face`` (n,): row by row, those without neighbours left out; ``start`` (R,): where each row
    begins; ``linked`` (n,): whether the next one is beside it, of a row's last its first one."""

    face: Long
    start: Long
    linked: Bool

    @staticmethod
    def of(link: Long) -> QuadStrips:
        """``link`` (F,): the face that follows each one, no other's, or -1."""
        before = np.full(len(link), -1)
        followed = np.flatnonzero(link >= 0)
        before[link[followed]] = followed
        linked = (link >= 0) | (before >= 0)
        head, place = _ahead(before)
        ring = place[head] > 0
        if ring.any():
            before[_lowest(before, ring)] = -1
            head, place = _ahead(before)
        member = np.flatnonzero(linked)
        count = np.bincount(head[member], minlength=len(link))
        face = np.empty(len(member), np.int64)
        face[(np.cumsum(count) - count)[head[member]] + place[member]] = member
        count = count[count > 0]
        return QuadStrips(face, np.cumsum(count) - count, link[face] >= 0)

    def among(self, number: Long, link: Long) -> QuadStrips:
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
    def after(self) -> Long:
        """(n,): the place of the next one in a row; of the last, that of the first."""
        result = np.arange(1, len(self.face) + 1)
        if len(self.start):
            result[np.append(self.start[1:], len(result)) - 1] = self.start
        return result

    def every_second(self, good: Bool) -> Long:
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

    def some(self, kept: Long) -> QuadStrips:
        """Those at some places (n,), ascending, one of each row at least."""
        start = np.searchsorted(kept, self.start)
        return QuadStrips(np.take(self.face, kept), start, np.take(self.linked, kept))


def links(corner: list[Long], ahead: Long, back: Long, k: int) -> Long:
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


def _ahead(before: Long) -> tuple[Long, Long]:
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


def _lowest(before: Long, ring: Bool) -> Long:
    """The lowest number of each ring."""
    low = np.arange(len(before))
    ahead = np.where(ring, before, low)
    for _ in range(len(before).bit_length()):
        low = np.minimum(low, low[ahead])
        ahead = ahead[ahead]
    return np.flatnonzero(ring & (low == np.arange(len(before))))


ROUNDS = 6
"""At most 2^6 faces of a row become one."""


def merge_flat(
    points: Float,
    faces: Long,
    tolerance: float,
    beside: Long,
    rows: tuple[QuadStrips, QuadStrips],
) -> Long:
    """Join faces (F, 4) of ``points`` (N, 3); triangles, with a corner twice, stay: (M, 4).

    Parameters
    ----------
    tolerance : how far from a vertex the joined side may pass.
    beside : (F, 4) the faces across which others may be joined, as `neighbours` finds them.
    rows : what `rows_of` finds.
    """
    count = len(faces)
    at = np.ascontiguousarray(points.T)
    corner = _columns(faces)
    # across edges 1 and 3, then of what is left across 2 and 0
    sides = {k: np.array(beside[:, k]) for k in (0, 2)}
    owner = _joined(at, tolerance, corner, rows[0], 1, sides)
    name = np.flatnonzero(owner[:count] == np.arange(count))
    along = rows[1]
    if len(name) < count:
        # -1 is the last one
        number = np.full(count + 2, -1)
        number[name] = np.arange(len(name))
        corner = [np.take(column, name) for column in corner]
        across = {k: number[owner[side[name]]] for k, side in sides.items()}
        along = along.among(number, links(corner, across[2], across[0], 2))
    into = _joined(at, tolerance, corner, along, 2)[: len(name)]
    remaining = np.flatnonzero(into == np.arange(len(name)))
    return np.stack([np.take(column, remaining) for column in corner], axis=1)


def rows_of(faces: Long, beside: Long) -> tuple[QuadStrips, QuadStrips]:
    """The rows of faces (F, 4) across edges 1 and 3, and across 2 and 0: see `merge_flat`."""
    corner, (first, second, third, fourth) = _columns(faces), _columns(beside)
    return QuadStrips.of(links(corner, second, fourth, 1)), QuadStrips.of(
        links(corner, third, first, 2)
    )


def _columns(values: Long) -> list[Long]:
    return [np.array(column) for column in values.T]


def _joined(
    points: Float,
    tolerance: float,
    corner: list[Long],
    rows: QuadStrips,
    k: int,
    sides: dict[int, Long] | None = None,
) -> Long:
    """Join faces of ``rows`` across their edges ``k``: which one (F + 2,) each has gone into, and
    -2 and -1 where they are looked up. ``corner``: columns (F,), those of the joined ones are
    changed; so is what is across their ``sides``, one face or none, level by level."""
    into = np.append(np.arange(len(corner[0])), [-2, -1])
    vertices = [np.take(corner[(j + k) % 4], rows.face) for j in range(4)]
    good, asked = np.zeros(len(rows.face), bool), rows.linked
    for level in range(ROUNDS):
        after = rows.after
        ask = np.flatnonzero(asked & rows.linked)
        good[ask] = _suit(points, tolerance, vertices, ask, after[ask])
        first = rows.every_second(good)
        if not len(first):
            break
        second = after[first]
        one, other = rows.face[first], rows.face[second]
        into[other] = one
        for side in (sides or {}).values():
            a, b = side[one], side[other]
            for _ in range(level + 1):
                a, b = into[a], into[b]
            # on a long side is one face, or none
            side[one] = np.where((a >= 0) & (a == b), a, -1)
        for column in vertices[:2]:
            column[first] = column[second]
        linked = rows.linked.copy()
        linked[first] = linked[second]
        # others are asked no more than once
        asked = np.zeros(len(good), bool)
        asked[first] = True
        asked |= asked[after]
        good &= ~asked
        remaining = np.ones(len(good), bool)
        remaining[second] = False
        kept = np.flatnonzero(remaining)
        rows = replace(rows, linked=linked).some(kept)
        vertices = [_taken(column, kept) for column in vertices]
        good, asked = _taken(good, kept), _taken(asked, kept)
    for j in range(2):
        corner[(j + k) % 4][rows.face] = vertices[j]
    for _ in range(ROUNDS.bit_length()):
        into = into[into]
    return into


def _suit(
    points: Float,
    tolerance: float,
    corner: list[Long],
    first: Long,
    second: Long,
) -> Bool:
    """Whether pairs of faces of a row may be joined; ``corner``: columns of vertices, those that
    the next face shares first."""
    result = np.zeros(len(first), bool)
    for begin in range(0, len(first), CHUNK):
        row = np.arange(begin, min(begin + CHUNK, len(first)))
        a, b = first[row], second[row]
        for front, back in ((0, 3), (1, 2)):
            middle, start = _taken(corner[front], a), _taken(corner[back], a)
            on = _on_segment(points, middle, start, _taken(corner[front], b), tolerance)
            row, a, b = _some(on, row, a, b)
        one, other = (_taken(corner[j], a) for j in (3, 2))
        quad = one, _taken(corner[0], b), _taken(corner[1], b), other
        (row,) = _some(_flat(points, quad, tolerance), row)
        result[row] = True
    return result


def _taken(values: npt.NDArray[Any], rows: Long) -> npt.NDArray[Any]:
    """Those of a column; NumPy looks at numbers that may be out of range one by one."""
    return np.take(values, rows, axis=-1, mode="clip")


def _some(good: Bool, *columns: Long) -> list[Long]:
    """The good ones of columns."""
    if good.all():
        return list(columns)
    kept = np.flatnonzero(good)
    return [_taken(column, kept) for column in columns]


def _on_segment(points: Float, middle: Long, start: Long, end: Long, tolerance: float) -> Bool:
    """Whether vertices lie on the way from ``start`` to ``end``, within the tolerance, and it
    doesn't turn a corner there: the side of a thin plate is shorter than any tolerance."""
    origin = _taken(points, start)
    way, to = _taken(points, end) - origin, _taken(points, middle) - origin
    length = products(way, way)
    share = products(to, way) / np.where(length > 0.0, length, 1.0)
    rest = to - share * way
    gap = np.sqrt(products(rest, rest))
    near = np.minimum(tolerance, share * (1.0 - share) * np.sqrt(length))
    return np.asarray((share > 0.0) & (share < 1.0) & (gap <= near))


def _flat(points: Float, quad: tuple[Long, Long, Long, Long], tolerance: float) -> Bool:
    """Whether the diagonals of quadrilaterals meet, within the tolerance."""
    P = [_taken(points, v) for v in quad]
    (ux, uy, uz), (vx, vy, vz) = P[2] - P[0], P[3] - P[1]
    normal = np.stack([uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx])
    size = np.sqrt(products(normal, normal))
    gap = np.abs(products(normal, P[1] - P[0])) / np.where(size > 0.0, size, 1.0)
    return np.asarray((gap <= tolerance) & (size > 0.0))


def neighbours(faces: Long) -> tuple[Long, bool]:
    """Across each edge of (F, 4) faces: -1 none or several, -2 no edge. Whether all have one."""
    count = len(faces)
    a, b = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    owner = np.repeat(np.arange(count), 4)
    result = np.full(4 * count, -1, np.int64)
    result[a == b] = -2
    real = np.flatnonzero(a != b)
    low, high = np.minimum(a, b)[real], np.maximum(a, b)[real]
    key = low * (int(faces.max(initial=0)) + 1) + high
    order, key = sorted_keys(key)
    slot = real[order]
    first = np.flatnonzero(np.r_[True, key[1:] != key[:-1]]) if len(key) else np.zeros(0, int)
    uses = np.diff(np.r_[first, len(key)])
    pair = first[uses == 2]
    result[slot[pair]] = owner[slot[pair + 1]]
    result[slot[pair + 1]] = owner[slot[pair]]
    return result.reshape(-1, 4), bool((uses == 2).all())
