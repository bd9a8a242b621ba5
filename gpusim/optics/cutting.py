"""Triangles cut to what a camera sees and to what float32 and a bent lens allow.

All of it is float64. A cut of an edge depends on that edge alone, so that neighbours cut it at the
same point and no cracks open. A bent lens makes curves of edges: those that show are cut until
their chords leave the curves by less than 0.0004 px. The others separate triangles that continue
each other; what they miss is covered by the neighbour, whose paint is evaluated exactly there, so
that only depth and smooth shading are concerned, and 0.02 px will do.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.optics.camera import Camera
from gpusim.optics.distortion_map import distortion_map

__all__ = ["LONGEST_EDGE", "Pieces", "Screen", "clip", "split"]

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

LONGEST_EDGE = 512.0
"""px; longer edges are split so that float32 offsets from the anchor stay exact enough."""

LONGEST_BENT = 256.0
"""px; the same with a bent lens, so that the tests of an edge see all of its bends."""

CHORD, CHORD_INSIDE = 0.0004, 0.02
"""px between a chord and its curve: for edges that show, and for others."""

GUARD = 8.0
"""px around what is in view to which triangles are clipped that reach far beyond."""

FAR_OUT, FAR_OUT_BENT = 4096.0, 32.0
"""px that is far; with a bent lens little, because edges out there would be split in vain."""


@dataclass(frozen=True, eq=False)
class Pieces:
    """Triangles: ``corners`` (n, 3, k), of which the first three are the camera-space position.

    ``shows`` (n, 3): whether the edge from corner j to the next one shows; ``source`` (n,): the
    triangle that each comes from.
    """

    corners: Array
    shows: Flags
    source: npt.NDArray[np.int64]

    def __getitem__(self, rows: Flags) -> Pieces:
        if rows.all():
            return self
        return Pieces(self.corners[rows], self.shows[rows], self.source[rows])

    @staticmethod
    def joined(parts: list[Pieces]) -> Pieces:
        """Several in one, in order."""
        parts = [p for p in parts if len(p.source)] or parts[:1]
        if len(parts) == 1:
            return parts[0]
        return Pieces(
            np.concatenate([p.corners for p in parts]),
            np.concatenate([p.shows for p in parts]),
            np.concatenate([p.source for p in parts]),
        )


class Screen:
    """Where camera-space points fall on the image, and which part of the ideal image is in view.

    ``straight``: px, the length up to which no edge rises more than 1 px over its chord.
    """

    def __init__(self, camera: Camera) -> None:
        self.camera = camera
        bends = distortion_map(camera)
        self.straight = np.inf if bends is None else 2.0 / np.sqrt(max(bends.bend, 1e-30))
        width, height = camera.width, camera.height
        self.low, self.high = np.full(2, -1.0), np.array([width, height], np.float64)
        if bends is not None:
            t = np.linspace(0.0, 1.0, 129)
            x, y = t * width - 0.5, t * height - 0.5
            border = [np.stack([x, np.full(129, v)], axis=1) for v in (-0.5, height - 0.5)]
            border += [np.stack([np.full(129, v), y], axis=1) for v in (-0.5, width - 0.5)]
            ideal = camera.undistort(np.concatenate(border))
            self.low, self.high = ideal.min(axis=0) - 2.0, ideal.max(axis=0) + 2.0

    def ideal(self, points: Array) -> Array:
        """Camera-space points (…, 3) with z > 0 to pixels (…, 2) of the ideal lens."""
        K, z = self.camera.K, points[..., 2]
        x, y = points[..., 0] / z, points[..., 1] / z
        return np.stack([K[0, 0] * x + K[0, 1] * y + K[0, 2], K[1, 1] * y + K[1, 2]], axis=-1)

    def bent(self, ideal: Array) -> Array:
        """Ideal pixels to those of the lens, continued smoothly beyond the image."""
        return self.camera.distort(ideal, beyond=True)

    def inside(self, ideal: Array) -> Flags:
        """Which triangles (n, 3, 2) of the ideal image may be in view."""
        result = np.ones(len(ideal), bool)
        for axis in (0, 1):
            a, b, c = (ideal[:, k, axis] for k in range(3))
            result &= np.maximum(np.maximum(a, b), c) > self.low[axis]
            result &= np.minimum(np.minimum(a, b), c) < self.high[axis]
        return result

    def reaches_far(self, ideal: Array) -> Flags:
        """Which triangles (n, 3, 2) reach far beyond what is in view."""
        reach = FAR_OUT if self.camera.lens is None else FAR_OUT_BENT
        far = (ideal < self.low - reach) | (ideal > self.high + reach)
        return np.asarray(far.reshape(-1, 6).any(axis=1)) if far.any() else far[:, 0, 0]

    def guards(self) -> Array:
        """(4, 3) camera-space normals: n . X > 0 inside the guard band."""
        K = self.camera.K
        low, high = self.low - GUARD, self.high + GUARD
        return np.array(
            [
                [K[0, 0], K[0, 1], K[0, 2] - low[0]],
                [-K[0, 0], -K[0, 1], high[0] - K[0, 2]],
                [0.0, K[1, 1], K[1, 2] - low[1]],
                [0.0, -K[1, 1], high[1] - K[1, 2]],
            ]
        )


def clip(pieces: Pieces, normal: Array, offset: float) -> Pieces:
    """The parts of triangles where normal . X > offset, X their position in camera space."""
    corners, shows = pieces.corners, pieces.shows
    height = corners[:, :, :3] @ normal - offset
    ahead = height > 0.0
    count = ahead.sum(axis=1)
    parts = [pieces[count == 3]]

    def cut(rows: npt.NDArray[np.int64], i: int, j: int) -> Array:
        """Where the edge from corner i (ahead) to corner j (not) meets the plane."""
        a, b = corners[rows, i], corners[rows, j]
        t = height[rows, i] / (height[rows, i] - height[rows, j])
        result: Array = a + t[:, None] * (b - a)
        return result

    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        one = np.flatnonzero((count == 1) & ahead[:, k])
        if len(one):
            new = np.stack([corners[one, k], cut(one, k, i), cut(one, k, j)], axis=1)
            flags = np.stack([shows[one, k], np.zeros(len(one), bool), shows[one, j]], axis=1)
            parts.append(Pieces(new, flags, pieces.source[one]))
        two = np.flatnonzero((count == 2) & ~ahead[:, k])
        if len(two):
            a, b = corners[two, i], corners[two, j]
            on_b, on_a = cut(two, j, k), cut(two, i, k)
            none = np.zeros(len(two), bool)
            source = pieces.source[two]
            flags = np.stack([shows[two, i], shows[two, j], none], axis=1)
            parts.append(Pieces(np.stack([a, b, on_b], axis=1), flags, source))
            flags = np.stack([none, none, shows[two, k]], axis=1)
            parts.append(Pieces(np.stack([a, on_b, on_a], axis=1), flags, source))
    return Pieces.joined(parts)


def split(pieces: Pieces, screen: Screen) -> tuple[Pieces, Array]:
    """Halve edges until all are short and straight enough; drop what lies outside the image.

    Returns the triangles and their positions (n, 3, 2) on the image.
    """
    done: list[Pieces] = []
    places: list[Array] = []
    while True:
        ideal = screen.ideal(pieces.corners[:, :, :3])
        keep = screen.inside(ideal) & ~_without_area(ideal)
        if not keep.all():
            pieces, ideal = pieces[keep], ideal[keep]
        place = ideal if screen.camera.lens is None else screen.bent(ideal)
        excess = edge_excess(ideal, place, pieces.shows, screen)
        above = excess > 1.0
        long = above[:, 0] | above[:, 1] | above[:, 2]
        area = _cross(place[:, 1] - place[:, 0], place[:, 2] - place[:, 0])
        good = ~long & (area != 0.0)
        done.append(pieces[good])
        places.append(place if good.all() else place[good])
        if not long.any():
            return Pieces.joined(done), np.concatenate(places) if len(places) > 1 else place[good]
        pieces = _halved(pieces[long], np.argmax(excess[long], axis=1))


def edge_excess(ideal: Array, place: Array, shows: Flags, screen: Screen) -> Array:
    """(n, 3): above 1 where the edge from a corner of a triangle to the next must be halved."""
    side = place[:, [1, 2, 0]] - place
    length = np.sqrt(side[..., 0] ** 2 + side[..., 1] ** 2)
    if screen.camera.lens is None:
        return length / LONGEST_EDGE
    excess = length / LONGEST_BENT
    # shorter ones are straight enough for certain
    limit = np.where(shows, CHORD, CHORD_INSIDE)
    # and what lies wholly beside the image needn't be
    ends = np.stack([ideal, np.roll(ideal, -1, axis=1)])
    beside = (ends.max(axis=0) < screen.low) | (ends.min(axis=0) > screen.high)
    test = (length > np.sqrt(limit) * screen.straight) & (excess <= 1.0) & ~beside.any(axis=2)
    rows, k = np.nonzero(test)
    a, b = ideal[rows, k], ideal[rows, (k + 1) % 3]
    start, along = place[rows, k], side[rows, k]
    # second differences over thirds, not the rise alone: an S would hide what its parts then show,
    # and halving wouldn't end. Of a parabola they are 8/9 of the rise.
    rise = [0.0 * along[:, 0]]
    for share in (1.0 / 3.0, 2.0 / 3.0):
        at = screen.bent(a + share * (b - a)) - start
        rise.append(_cross(along, at) / length[rows, k])
    first, second = np.abs(rise[2] - 2.0 * rise[1]), np.abs(rise[1] - 2.0 * rise[2])
    off = 1.125 * np.maximum(first, second)
    excess[rows, k] = np.maximum(excess[rows, k], np.sqrt(off / limit[rows, k]))
    return excess


def _halved(pieces: Pieces, k: npt.NDArray[np.int64]) -> Pieces:
    """Each triangle cut in two at the middle of its edge k."""
    rows = np.arange(len(k))
    i, j = (k + 1) % 3, (k + 2) % 3
    corners, shows = pieces.corners, pieces.shows
    a, b, c = corners[rows, k], corners[rows, i], corners[rows, j]
    middle = 0.5 * (a + b)
    none = np.zeros(len(k), bool)
    flags = [
        np.stack([shows[rows, k], none, shows[rows, j]], axis=1),
        np.stack([shows[rows, k], shows[rows, i], none], axis=1),
    ]
    halves = [np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)]
    return Pieces(
        np.concatenate(halves), np.concatenate(flags), np.concatenate([pieces.source] * 2)
    )


def _without_area(triangles: Array) -> Flags:
    """Which triangles (n, 3, 2) are lines but for rounding."""
    a, b, c = (triangles[:, k] for k in range(3))
    u, v = b - a, c - a
    square = u[:, 0] ** 2 + u[:, 1] ** 2 + v[:, 0] ** 2 + v[:, 1] ** 2
    return np.asarray(np.abs(_cross(u, v)) <= 1e-13 * square)


def _cross(a: Array, b: Array) -> Array:
    result: Array = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return result
