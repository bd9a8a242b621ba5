"""Triangles cut to what a camera sees and to what float32 and a bent lens allow.

All of it is float64. Whether and where an edge is cut depends on its two ends alone, to the last
bit whichever way round it is given, so that neighbours cut it at the same points and no cracks
open. A bent lens makes curves of edges: those that show are cut until their chords leave the
curves by less than 0.0004 px. The others separate triangles that continue each other; what they
miss is covered by the neighbour, whose paint is evaluated exactly there, so that only depth and
smooth shading are concerned, and 0.02 px will do. Beside the image nothing has to be exact.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.errors import InputError
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.camera.undistortion_table import distortion_map

MAX_EDGE = 512.0
"""px; longer edges are split so that float32 offsets from the anchor stay exact enough."""

SURELY_SHORT = 0.7 * MAX_EDGE
"""px; no edge of a triangle within a box of this side is longer."""

MAX_BENT_EDGE = 256.0
"""px; the same with a bent lens, so that the tests of an edge see all of its bends."""

CHORD, CHORD_INSIDE, CHORD_BESIDE = 0.0004, 0.02, 0.5
"""px between a chord and its curve: for edges that show, for others, and beside the image."""

MARGIN = 2.0
"""px around the image within which something counts as in view; above what chords are off by."""

GUARD, GUARD_BENT = 1024.0, 32.0
"""px around what is in view to which triangles are clipped; with a bent lens few, because edges
out there would be split in vain.

Clipping is where vertices lie beyond: an edge between two others is left to both its neighbours.
"""

MAX_ROUNDS, MAX_PIECES = 96, 4_000_000
"""Halvings of one triangle, and triangles made by splitting, that no usable camera needs."""


@dataclass(frozen=True, eq=False)
class ClippedTriangles:
    """Triangles: ``corners`` (n, 3, k), of which the first three are the camera-space position.

    ``shows`` (n, 3): whether the edge from corner j to the next one shows; ``source`` (n,): the
    triangle that each comes from.
    """

    corners: Float
    shows: Bool
    source: Long

    def __getitem__(self, rows: Bool) -> ClippedTriangles:
        if rows.all():
            return self
        return ClippedTriangles(self.corners[rows], self.shows[rows], self.source[rows])

    @staticmethod
    def joined(parts: list[ClippedTriangles]) -> ClippedTriangles:
        """Several in one, in order."""
        parts = [p for p in parts if len(p.source)] or parts[:1]
        if len(parts) == 1:
            return parts[0]
        return ClippedTriangles(
            np.concatenate([p.corners for p in parts]),
            np.concatenate([p.shows for p in parts]),
            np.concatenate([p.source for p in parts]),
        )


class ImagePlane:
    """Where camera-space points fall on the image, and which part of the ideal image is in view.

    ``straight``: px, the length up to which no edge rises more than 1 px over its chord.
    """

    def __init__(self, camera: Camera) -> None:
        self.camera = camera
        bends = distortion_map(camera)
        self.straight = np.inf if bends is None else 2.0 / np.sqrt(max(bends.bend, 1e-30))
        width, height = camera.width, camera.height
        self.image = np.full(2, -0.5 - MARGIN), np.array([width, height]) - 0.5 + MARGIN
        self.low, self.high = np.full(2, -1.0), np.array([width, height], np.float64)
        self.guard = GUARD if bends is None else GUARD_BENT
        if bends is not None:
            t = np.linspace(0.0, 1.0, 129)
            x, y = t * width - 0.5, t * height - 0.5
            border = [np.stack([x, np.full(129, v)], axis=1) for v in (-0.5, height - 0.5)]
            border += [np.stack([np.full(129, v), y], axis=1) for v in (-0.5, width - 0.5)]
            ideal = camera.undistort(np.concatenate(border))
            self.low, self.high = ideal.min(axis=0) - MARGIN, ideal.max(axis=0) + MARGIN

    def ideal(self, points: Float) -> Float:
        """Camera-space points (…, 3) with z > 0 to pixels (…, 2) of the ideal lens."""
        K, z = self.camera.K, points[..., 2]
        x, y = points[..., 0] / z, points[..., 1] / z
        columns = np.stack([K[0, 0] * x + K[0, 1] * y + K[0, 2], K[1, 1] * y + K[1, 2]])
        return np.moveaxis(columns, 0, -1)

    def bent(self, ideal: Float) -> Float:
        """Ideal pixels to those of the lens, continued smoothly beyond the image."""
        return self.camera.distort(ideal, beyond=True)

    def inside(self, ideal: Float) -> Bool:
        """Which triangles (n, 3, 2) of the ideal image may be in view."""
        return _overlaps(ideal, self.low, self.high)

    def beside(self, ideal: Float, place: Float) -> Bool:
        """Which edges from a corner of a triangle to the next (n, 3) lie wholly out of view."""
        result = np.zeros(ideal.shape[:2], bool)
        for at, (low, high) in ((ideal, (self.low, self.high)), (place, self.image)):
            for out in (at < low, at > high):
                result |= (out & out[:, [1, 2, 0]]).any(axis=2)
        return result

    def beyond(self, ideal: Float) -> Bool:
        """Which points (n, 2) of the ideal image lie beyond the guard band."""
        x, y = ideal[:, 0], ideal[:, 1]
        (left, top), (right, bottom) = self.low - self.guard, self.high + self.guard
        return np.asarray(~((x >= left) & (x <= right) & (y >= top) & (y <= bottom)))

    def guards(self) -> Float:
        """(4, 3) camera-space normals: n . X > 0 inside the guard band."""
        K = self.camera.K
        low, high = self.low - self.guard, self.high + self.guard
        return np.array(
            [
                [K[0, 0], K[0, 1], K[0, 2] - low[0]],
                [-K[0, 0], -K[0, 1], high[0] - K[0, 2]],
                [0.0, K[1, 1], K[1, 2] - low[1]],
                [0.0, -K[1, 1], high[1] - K[1, 2]],
            ]
        )


def clip(pieces: ClippedTriangles, normal: Float, offset: float) -> ClippedTriangles:
    """The parts of triangles where normal . X > offset, X their position in camera space."""
    corners, shows = pieces.corners, pieces.shows
    # no matrix product: its rounding depends on where in the array a corner is
    height = corners[..., 0] * normal[0] + corners[..., 1] * normal[1]
    height = height + corners[..., 2] * normal[2] - offset
    ahead = height > 0.0
    count = ahead.sum(axis=1)
    parts = [pieces[count == 3]]

    def cut(rows: Long, i: int, j: int) -> Float:
        """Where the edge from corner i (ahead) to corner j (not) meets the plane."""
        a, b = corners[rows, i], corners[rows, j]
        t = height[rows, i] / (height[rows, i] - height[rows, j])
        result: Float = a + t[:, None] * (b - a)
        return result

    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        one = np.flatnonzero((count == 1) & ahead[:, k])
        if len(one):
            new = np.stack([corners[one, k], cut(one, k, i), cut(one, k, j)], axis=1)
            flags = np.stack([shows[one, k], np.zeros(len(one), bool), shows[one, j]], axis=1)
            parts.append(ClippedTriangles(new, flags, pieces.source[one]))
        two = np.flatnonzero((count == 2) & ~ahead[:, k])
        if len(two):
            a, b = corners[two, i], corners[two, j]
            on_b, on_a = cut(two, j, k), cut(two, i, k)
            none = np.zeros(len(two), bool)
            source = pieces.source[two]
            flags = np.stack([shows[two, i], shows[two, j], none], axis=1)
            parts.append(ClippedTriangles(np.stack([a, b, on_b], axis=1), flags, source))
            flags = np.stack([none, none, shows[two, k]], axis=1)
            parts.append(ClippedTriangles(np.stack([a, on_b, on_a], axis=1), flags, source))
    return ClippedTriangles.joined(parts)


def split(pieces: ClippedTriangles, screen: ImagePlane) -> tuple[ClippedTriangles, Float]:
    """Halve edges until all are short and straight enough; drop what lies outside the image.

    Returns the triangles and their positions (n, 3, 2) on the image.

    Raises
    ------
    InputError
        A lens that bends edges in view so strongly that halving them doesn't end in good time.
    """
    done: list[ClippedTriangles] = []
    places: list[Float] = []
    most = len(pieces.source) + MAX_PIECES
    for _ in range(MAX_ROUNDS):
        ideal = screen.ideal(pieces.corners[:, :, :3])
        keep = screen.inside(ideal) & ~without_area(*_columns(ideal))
        if not keep.all():
            pieces, ideal = pieces[keep], ideal[keep]
        if screen.camera.lens is None:
            place, good = ideal, np.ones(len(ideal), bool)
            if extent(ideal) <= SURELY_SHORT:
                return ClippedTriangles.joined([*done, pieces]), joined([*places, place])
        else:
            place = screen.bent(ideal)
            # what a lens turns over is a sliver within the tolerance, or beyond the lens's domain
            good = twice_area(*_columns(place)) * twice_area(*_columns(ideal)) > 0.0
        above = edge_excess(ideal, place, pieces.shows, screen)
        long = (above[:, 0] > 1.0) | (above[:, 1] > 1.0) | (above[:, 2] > 1.0)
        good &= ~long
        if screen.camera.lens is not None:
            good &= _overlaps(place, *screen.image)
        done.append(pieces[good])
        places.append(place if good.all() else place[good])
        if not long.any():
            return ClippedTriangles.joined(done), joined(places)
        pieces = _halved(pieces[long], np.argmax(above[long], axis=1))
        if len(pieces.source) > most:
            break
    lens = screen.camera.lens
    raise InputError(
        f"Camera {screen.camera.name!r} distortion; got "
        f"{None if lens is None else lens.coefficients.tolist()}, "
        f"which bends edges that are in view so strongly that {len(pieces.source)} triangles are "
        "still not straight; expected a lens that stays clear of folding at the image's border"
    )


def edge_excess(ideal: Float, place: Float, shows: Bool, screen: ImagePlane) -> Float:
    """(n, 3): above 1 where the edge from a corner of a triangle to the next must be halved."""
    side = place[:, [1, 2, 0]] - place
    length = np.sqrt(side[..., 0] ** 2 + side[..., 1] ** 2)
    if screen.camera.lens is None:
        return length / MAX_EDGE
    limit = np.where(shows, CHORD, CHORD_INSIDE)
    limit[screen.beside(ideal, place)] = CHORD_BESIDE
    # the longest first, before any that is merely bent: nothing else keeps needles from forming
    long = length > MAX_BENT_EDGE
    excess = np.where(long, 1e6 * length, 0.0)
    # shorter ones are straight enough for certain
    rows, k = np.nonzero((length > np.sqrt(limit) * screen.straight) & ~long)
    after = (k + 1) % 3
    # always from the same end, so that both neighbours find the same
    ahead = ideal[rows, k] - ideal[rows, after]
    back = np.where(ahead[:, 0] == 0.0, ahead[:, 1], ahead[:, 0]) > 0.0
    first, last = np.where(back, after, k), np.where(back, k, after)
    a, b, start = ideal[rows, first], ideal[rows, last], place[rows, first]
    along = place[rows, last] - start
    # second differences over thirds, not the rise alone: an S would hide what its parts then show,
    # and halving wouldn't end. Of a parabola they are 8/9 of the rise.
    rise = [0.0 * along[:, 0]]
    for share in (1.0 / 3.0, 2.0 / 3.0):
        at = screen.bent(a + share * (b - a)) - start
        rise.append(_cross(along, at) / length[rows, k])
    second = np.abs(rise[2] - 2.0 * rise[1]), np.abs(rise[1] - 2.0 * rise[2])
    excess[rows, k] = np.sqrt(1.125 * np.maximum(*second) / limit[rows, k])
    return excess


def _halved(pieces: ClippedTriangles, k: Long) -> ClippedTriangles:
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
    return ClippedTriangles(
        np.concatenate(halves), np.concatenate(flags), np.concatenate([pieces.source] * 2)
    )


def joined(parts: list[Float]) -> Float:
    """Several arrays in one, in order; a single one that isn't empty as it is."""
    parts = [part for part in parts if len(part)] or parts[:1]
    return np.concatenate(parts) if len(parts) > 1 else parts[0]


def _columns(triangles: Float) -> tuple[list[Float], list[Float]]:
    """x and y of the three corners (n, 3, 2), each contiguous: strided passes take many times."""
    x, y = ([np.ascontiguousarray(triangles[:, k, axis]) for k in range(3)] for axis in (0, 1))
    return x, y


def extent(triangles: Float) -> float:
    """The longest side of a box round any of triangles (n, 3, 2)."""
    most = 0.0
    for a, b, c in _columns(triangles):
        size = np.maximum(np.maximum(a, b), c) - np.minimum(np.minimum(a, b), c)
        most = max(most, float(size.max(initial=0.0)))
    return most


def without_area(x: list[Float], y: list[Float]) -> Bool:
    """Which triangles with corners at x and y, three arrays (n,) each, are lines but for
    rounding."""
    return wound(x, y)[1]


def wound(x: list[Float], y: list[Float]) -> tuple[Bool, Bool]:
    """Which of these look at the camera, and which are `without_area`."""
    ux, uy, vx, vy = x[1] - x[0], y[1] - y[0], x[2] - x[0], y[2] - y[0]
    area = ux * vy
    area -= uy * vx
    front = area < 0.0
    np.abs(area, out=area)
    for side in (ux, uy, vx, vy):
        side *= side
    ux += uy
    ux += vx
    ux += vy
    ux *= 1e-13
    return front, area <= ux


def twice_area(x: list[Float], y: list[Float]) -> Float:
    """(n,) of triangles with corners at x and y, three arrays (n,) each; above 0 one way round."""
    result: Float = (x[1] - x[0]) * (y[2] - y[0]) - (y[1] - y[0]) * (x[2] - x[0])
    return result


def _overlaps(triangles: Float, low: Float, high: Float) -> Bool:
    """Which triangles (n, 3, 2) aren't wholly beside a box."""
    result = np.ones(len(triangles), bool)
    for (a, b, c), least, most in zip(_columns(triangles), low, high, strict=True):
        result &= np.maximum(np.maximum(a, b), c) > least
        result &= np.minimum(np.minimum(a, b), c) < most
    return result


def _cross(a: Float, b: Float) -> Float:
    result: Float = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return result
