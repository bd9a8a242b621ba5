"""Exposure in time: moments of the exposure, and rows that are exposed one after the other.

Under a rolling shutter every vertex is where it is when its own row is read: one rendering for all.
The motion during the read-out is interpolated by polynomials in time through Chebyshev points, in
camera coordinates, so that a moving camera is a moving scene; each vertex's time is the fixed point
of t = start + line_time x row(t). Inside a face times vary linearly, as rows do in the image of a
plane; faces for which that is off are divided. A point's time is that of its place, that of a pixel
its row's: edges along the rows are off by at most half of what moves during one line time.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import InputError
from gpusim.optics.camera.pinhole import Camera
from gpusim.surface.surface import Surface
from gpusim.validation import Finite, FromZero, checked, require, within

SurfacesAt = Callable[[float], Sequence[Surface]]
CameraAt = Callable[[float], Camera]

STILL = 0.02
"""px; a motion below this during the exposure is left out."""
LOOKS = (8, 21, 55, 144)
"""Moments at which a motion is looked at, until it is known."""
PAIR, KNOWN = 1e-5, 0.1
"""Of the exposure, between two moments that tell a speed; of its way, that speeds may miss."""
POINTS_PER_PX = 3.2
MAX_MOMENTS = 256
GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)


@checked
@dataclass(frozen=True)
class Shutter:
    """When the pixels collect light; times in s.

    Row r collects from time + r x ``line_time`` on for ``exposure_time``; a ``line_time`` of 0 is a
    global shutter, a negative one reads from the bottom up. ``samples``: moments that the exposure
    is averaged over, unless the motion decides.

    Examples
    --------
    >>> gs.Shutter(exposure_time=1e-3, line_time=5e-6).line_time
    5e-06
    """

    exposure_time: FromZero = 0.0
    line_time: Finite = 0.0
    samples: Annotated[int, within(1, 4096)] | None = None


def motion(surfaces: SurfacesAt, camera: CameraAt, start: float, length: float) -> float:
    """The longest way in px that a vertex in view goes on the image within a time.

    It is known where speeds lead from each moment to the next. A vibration of more periods than
    can be followed is known by its mean speed; moments are unevenly spaced, or what comes back in
    between would pass for still.
    """
    for count in LOOKS:
        way, by_speed, missed = _ways(surfaces, camera, start, length, count)
        if missed <= KNOWN * way + STILL:
            return way
    return max(way, by_speed)


def _ways(
    surfaces: SurfacesAt, camera: CameraAt, start: float, length: float, count: int
) -> tuple[float, float, float]:
    """The same by ``count`` moments, from one to the other and by the speeds there, and by how much
    the two differ."""
    shares = (np.arange(count) + np.random.default_rng(count).random(count)) / count
    shares[[0, -1]] = 0.0, 1.0
    steps, by_speed, missed = np.zeros((3, 1))
    before: tuple[Float, Float] | None = None
    for share, gap in zip((1.0 - PAIR) * shares, np.diff(shares, prepend=0.0), strict=True):
        time = start + length * float(share)
        lens, later = camera(time), camera(time + PAIR * length)
        pairs = zip(surfaces(time), surfaces(time + PAIR * length), strict=True)
        seen = [(lens.project(a.points), later.project(b.points)) for a, b in pairs]
        here, after = (np.concatenate([np.zeros((1, 2)), *one]) for one in zip(*seen, strict=True))
        with np.errstate(invalid="ignore"):
            speed = (after - here) / PAIR
            if before is not None:
                step, ends = here - before[0], (0.5 * gap * before[1], 0.5 * gap * speed)
                steps = steps + _length(step, lens)
                by_speed = by_speed + _length(ends[0], lens) + _length(ends[1], lens)
                missed = missed + _length(step - ends[0] - ends[1], lens)
        before = here, speed
    return float(steps.max()), float(by_speed.max()), float(missed.max())


def _length(step: Float, camera: Camera) -> Float:
    """Lengths (n,) of steps; 0 where a point isn't in front, and no more than the image's size."""
    length = np.nan_to_num(np.hypot(*step.T), nan=0.0)
    return np.asarray(np.minimum(length, camera.width + camera.height))


def moments_for(travel: float) -> int:
    """How many moments have gaps of half a pixel at most, for a motion of ``travel`` px."""
    return 1 if travel <= STILL else int(np.ceil(POINTS_PER_PX * travel)) + 2


def moments(shutter: Shutter, travel: float) -> tuple[Float, Float]:
    """Shares of the exposure (K,) and weights (K,) for a motion of ``travel`` px.

    Gauss-Legendre points, which integrate a motion's transfer function to 1e-6 up to the Nyquist
    frequency, and enough of them (`moments_for`) that edges show no steps. Where that is more than
    MAX_MOMENTS, and the shutter's ``samples`` don't say so, multiples of the golden ratio, which
    don't keep time with any vibration.
    """
    needed = shutter.samples or moments_for(travel)
    if shutter.samples is None and needed > MAX_MOMENTS:
        shares = np.sort(np.arange(0.5, MAX_MOMENTS) * GOLDEN % 1.0)
        return shares, np.full(MAX_MOMENTS, 1.0 / MAX_MOMENTS)
    count = needed if shutter.exposure_time else 1
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return 0.5 + 0.5 * nodes, 0.5 * weights


NODES = (5, 9, 17, 33)
TOLERANCE = 0.002
"""px; for the interpolation in time, for the fixed point, and inside faces."""
MAX_TURNS = 200
FASTEST = 0.9
MAX_DIVISIONS = 5

QUAD_PARTS = ((0, 4, 8, 7), (1, 5, 8, 4), (2, 6, 8, 5), (3, 7, 8, 6))
TRIANGLE_PARTS = ((0, 4, 6, 9), (1, 5, 4, 9), (2, 6, 5, 9), (4, 5, 6, 9))
"""Of a face that is divided: its corners are 0 to 3, the middles of its sides 4 to 7, its own one
is 8; 9 is none."""


def rolled(
    surfaces: Callable[[float], Sequence[Surface]],
    camera: Callable[[float], Camera],
    start: float,
    line_time: float,
) -> tuple[list[Surface], Camera]:
    """Surfaces as a shutter sees them that reads row r at ``start`` + r ``line_time``.

    The camera is that of the middle row.

    Raises
    ------
    InputError
        Surfaces whose vertices change in number, a motion that isn't smooth during the read-out,
        or one so fast that a row would see a point never or twice.
    """
    height = camera(start).height
    middle = camera(start + 0.5 * (height - 1) * line_time)
    at_middle = surfaces(start + 0.5 * (height - 1) * line_time)
    result = []
    for index, surface in enumerate(at_middle):
        where = f"rolling shutter, surface {surface.name!r}"
        rows = middle.project(surface.points)[:, 1]
        rows = rows[np.isfinite(rows)]
        low = max(float(min(rows.min(initial=0.0), 0.0)), -float(height))
        high = min(float(max(rows.max(initial=0.0), height - 1)), 2.0 * height)
        margin = 0.1 * (high - low) + 4.0
        times = (start + line_time * (low - margin), start + line_time * (high + margin))

        def seen(time: float, index: int = index, where: str = where) -> Float:
            points = surfaces(time)[index].points
            same, got = points.shape == at_middle[index].points.shape, f"{len(points)} vertices"
            expected = f"{len(at_middle[index].points)} at any time"
            require(same, where, f"{got} at {time:.6g} s", expected)
            return camera(time).to_camera(points)

        path = _Path.through(seen, times, middle, where)
        for division in range(MAX_DIVISIONS + 1):
            moved = path.rolled(start, line_time)
            if division == MAX_DIVISIONS:
                break
            finer, mean = divided(surface)
            inner = path.over(mean)
            if path.gap(mean(moved), inner.turn(mean(moved), start, line_time)) <= TOLERANCE:
                break
            surface, path = finer, inner
        T = middle.camera_from_world
        result.append(surface.moved((moved - T[:3, 3]) @ T[:3, :3]))
    return result, middle


class _Path:
    """Camera-space positions of a surface's vertices as polynomials in time."""

    def __init__(self, nodes: Float, positions: Float, camera: Camera, where: str) -> None:
        self.nodes, self.positions, self.camera, self.where = nodes, positions, camera, where
        sign = (-1.0) ** np.arange(len(nodes))
        sign[[0, -1]] *= 0.5  # barycentric weights of Chebyshev points (Berrut, Trefethen 2004)
        self.weights = sign

    @staticmethod
    def through(
        seen: Callable[[float], Float], times: tuple[float, float], camera: Camera, where: str
    ) -> _Path:
        span = times[1] - times[0]
        for count in NODES:
            x = 0.5 - 0.5 * np.cos(np.pi * np.arange(count) / (count - 1))
            nodes = times[0] + span * x
            path = _Path(nodes, np.stack([seen(float(t)) for t in nodes]), camera, where)
            worst = 0.0
            for share in (0.31, 0.55):
                time = times[0] + share * span
                got = path.at(np.full(path.positions.shape[1], time))
                worst = max(worst, path.gap(got, seen(time)))
            if worst <= TOLERANCE:
                return path
        raise InputError(
            f"{where}: its motion during the read-out; got {worst:.3g} px off a polynomial through "
            f"{NODES[-1]} moments; expected a smooth motion"
        )

    def over(self, mean: Callable[[Float], Float]) -> _Path:
        """The same for vertices that are means of these."""
        positions = np.stack([mean(p) for p in self.positions])
        return _Path(self.nodes, positions, self.camera, self.where)

    def at(self, times: Float) -> Float:
        """Positions (P, 3), each vertex at its own time (P,)."""
        difference = times[None, :] - self.nodes[:, None]
        hit = difference == 0.0
        factor = self.weights[:, None] / np.where(hit, 1.0, difference)
        factor = np.where(hit.any(axis=0), hit, factor)
        factor /= factor.sum(axis=0)
        return np.asarray(np.einsum("mp,mpa->pa", factor, self.positions))

    def project(self, positions: Float) -> Float:
        """Pixels (P, 2) of camera-space positions."""
        T = self.camera.camera_from_world
        return self.camera.project((positions - T[:3, 3]) @ T[:3, :3])

    def gap(self, a: Float, b: Float) -> float:
        """Largest distance in px between two sets of positions, of those in front."""
        with np.errstate(invalid="ignore"):
            distance = np.hypot(*(self.project(a) - self.project(b)).T)
        return float(np.nan_to_num(distance, nan=0.0).max(initial=0.0))

    def turn(self, positions: Float, start: float, line_time: float) -> Float:
        """Positions at the times of the rows that ``positions`` are in.

        A position that is off by e px is off by e times motion over rows read afterwards: less.
        """
        low, high = self.nodes.min(), self.nodes.max()
        row = self.project(positions)[:, 1]
        own = np.clip(start + line_time * row, low, high)
        return self.at(np.where(np.isfinite(row), own, 0.5 * (low + high)))

    def rolled(self, start: float, line_time: float) -> Float:
        """Positions (P, 3) of the vertices at their own times."""
        with np.errstate(invalid="ignore"):
            rows = np.stack([self.project(p)[:, 1] for p in self.positions])
            speed = np.abs(np.diff(rows, axis=0) / np.diff(self.nodes)[:, None] * line_time)
        fastest = float(np.nan_to_num(speed, nan=0.0).max(initial=0.0))
        got = f"{fastest:.3g} rows per line_time"
        expected = f"at most {FASTEST}: rows would see a point twice or never"
        require(fastest <= FASTEST, f"{self.where}: moves along the columns", got, expected)
        middle = 0.5 * (self.nodes.min() + self.nodes.max())
        positions = self.at(np.full(self.positions.shape[1], middle))
        for _ in range(MAX_TURNS):
            last = positions
            positions = self.turn(last, start, line_time)
            if self.gap(positions, last) <= 1e-6:
                break
        return positions


def divided(surface: Surface) -> tuple[Surface, Callable[[Float], Float]]:
    """Every face cut into four, and how values at vertices go over to the new ones.

    Vertices keep their numbers; middles of edges and of quadrilaterals follow.
    """
    faces = surface.faces
    quads = faces[:, 3] >= 0
    sides = [(0, 1), (1, 2), (2, 3), (3, 0)]
    pairs = np.stack([faces[:, list(side)] for side in sides], axis=1)
    pairs[~quads, 2, 1] = faces[~quads, 0]  # a triangle's third side ends at its first corner
    pairs[~quads, 3] = pairs[~quads, 2]
    ordered = np.sort(pairs.reshape(-1, 2), axis=1)
    edges, inverse = np.unique(ordered, axis=0, return_inverse=True)
    count = len(surface.points)
    middle = count + inverse.reshape(-1, 4)
    centre = count + len(edges) + np.cumsum(quads) - 1
    vertices = np.column_stack([faces, middle, centre, np.full(len(faces), -1)])
    parts = np.where(quads[:, None, None], vertices[:, QUAD_PARTS], vertices[:, TRIANGLE_PARTS])
    new = parts.reshape(-1, 4).astype(np.int32)

    def mean(values: Float) -> Float:
        at_edges = 0.5 * (values[edges[:, 0]] + values[edges[:, 1]])
        return np.concatenate([values, at_edges, values[faces[quads]].mean(axis=1)])

    finer = replace(
        surface,
        points=mean(surface.points),
        faces=new,
        region=np.repeat(surface.regions, 4),
        reference=mean(surface.rest),
        frames=surface._all_frames(),
    )
    return finer, mean
