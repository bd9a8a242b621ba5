"""A lamp's view of the scene: the frame in which what hides it is looked for.

In it, p = x / w and q = y / w across the lamp's axis and s = 1 / w along it, the lamp's plane lies
at infinity: a ray from a receiver X to the lamp's point l runs along p = p_X + l (s - s_X). The
sun's frame is the same with s the distance towards it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.optics.emitters import Lamp

__all__ = ["LampView", "Reach", "overlap", "seen_from"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]
Index = Numbers | int | slice

AROUND = 0.2
"""Cosine between directions to parts of a surface and to its middle that counts as ahead."""

TURNS, SAMPLE = 18, 4000
"""Ways round, within a right angle, that a lamp's view is tried on so many faces."""


@dataclass(frozen=True, eq=False)
class Reach:
    """Boxes in p, q and s of a lamp's view: low and high ends (2, n) of each."""

    p: Array
    q: Array
    s: Array

    def __getitem__(self, index: Numbers | Flags) -> Reach:
        places = np.flatnonzero(index) if index.dtype == bool else index
        return Reach(*(np.take(ends, places, axis=1) for ends in (self.p, self.q, self.s)))


@dataclass(frozen=True, eq=False)
class LampView:
    """One half space before a lamp: its frame, and half the lamp's size in it."""

    lamp: Lamp
    across: Array
    along: Array
    axis: Array
    half: tuple[float, float]

    @staticmethod
    def of(lamp: Lamp, faces: Array | None = None) -> list[LampView]:
        """Both half spaces of a lamp that shines all round, one of any other. Lamps without size
        look towards ``faces`` (3, n, 4), turned so that boxes around them are small."""
        if lamp.extended:
            size = float(np.linalg.norm(lamp.u)), float(np.linalg.norm(lamp.v))
            return [LampView(lamp, lamp.u / size[0], lamp.v / size[1], lamp.axis, size)]
        axes = [lamp.axis]
        if not np.any(lamp.axis):
            axis = _towards(lamp, faces)
            axes = [axis, -axis]
        result = []
        for axis in axes:
            across = _across(lamp, axis, faces)
            result.append(LampView(lamp, across, np.cross(axis, across), axis, (0.0, 0.0)))
        return result

    def place(self, x: Array, y: Array, z: Array) -> tuple[Array, Array, Array]:
        """p, q, s of world points; behind the lamp all are NaN."""
        if self.lamp.far:
            return (
                _along(self.across, x, y, z), _along(self.along, x, y, z),
                -_along(self.axis, x, y, z),
            )  # fmt: skip
        x, y, z = (v - own for v, own in zip((x, y, z), self.lamp.centre, strict=True))
        w = _along(self.axis, x, y, z)
        most = max(float(np.abs(v).max(initial=0.0)) for v in (x, y, z))
        w[~(w > 1e-9 * max(most, 1e-300))] = np.nan
        s = 1.0 / w
        return _along(self.across, x, y, z) * s, _along(self.along, x, y, z) * s, s

    def world(self, p: Array, q: Array, s: Array) -> Array:
        """Points (3, n) in the world whose p, q and s (n,) these are, as `place` has them."""
        beside = self.across[:, None] * p + self.along[:, None] * q
        if self.lamp.far:
            return np.asarray(beside - self.axis[:, None] * s)
        return np.asarray(self.lamp.centre[:, None] + (self.axis[:, None] + beside) / s)

    def planes(self, s: Array) -> Array:
        """(n, 4): normals, away from the lamp, and offsets of the planes of s (n,) in the world."""
        result = np.empty((len(s), 4))
        result[:, :3] = self.axis
        result[:, 3] = -s if self.lamp.far else 1.0 / s + float(self.axis @ self.lamp.centre)
        return result

    def reach(self, points: Array) -> Reach:
        """Boxes around groups of points (k, 3, n): unlimited where some lie behind the lamp.

        Where all do, s is -inf: nothing there can be lit, and nothing hides the lamp.
        """
        p, q, s = self.place(points[:, 0], points[:, 1], points[:, 2])
        unknown = np.isnan(s)
        if not unknown.any():
            return Reach(
                *(np.stack([_fold(np.minimum, v), _fold(np.maximum, v)]) for v in (p, q, s))
            )
        behind, none = _fold(np.logical_or, unknown), _fold(np.logical_and, unknown)

        def box(values: Array) -> Array:
            values = np.where(unknown, 0.0, values)
            low = np.where(behind, -np.inf, _fold(np.minimum, values))
            return np.stack([low, np.where(behind, np.inf, _fold(np.maximum, values))])

        low = _fold(np.minimum, np.where(unknown, np.inf, s))
        high = np.where(behind, np.inf, _fold(np.maximum, np.where(unknown, 0.0, s)))
        low, high = np.where(none, -np.inf, low), np.where(none, -np.inf, high)
        return Reach(box(p), box(q), np.stack([low, high]))


def _towards(lamp: Lamp, faces: Array | None) -> Array:
    """Unit: where most of ``faces`` (3, n, 4) are from a lamp that shines all round."""
    result = np.array([0.0, 1.0, 0.0])
    if faces is None or not faces.size:
        return result
    way = faces[:, :, 0] - lamp.centre[:, None]
    length = np.sqrt((way * way).sum(axis=0))
    mean = (way / np.where(length > 0.0, length, 1.0)).mean(axis=1)
    size = float(np.linalg.norm(mean))
    return np.asarray(mean / size) if size > AROUND else result


def _across(lamp: Lamp, axis: Array, faces: Array | None) -> Array:
    """Unit, across the ``axis``: the direction along which boxes around ``faces`` (3, n, 4) are
    smallest in a lamp's view."""
    helper = np.eye(3)[int(np.argmin(np.abs(axis)))]
    across = np.cross(axis, helper)
    across /= np.linalg.norm(across)
    if faces is None or not faces.size:
        return across
    along = np.cross(axis, across)
    way = faces[:, :: max(faces.shape[1] // SAMPLE, 1)]
    if not lamp.far:
        way = way - lamp.centre[:, None, None]
        ahead = np.tensordot(axis, way, 1)
        near = np.all(ahead > AROUND * np.sqrt((way * way).sum(axis=0)), axis=1)
        way = way[:, near] / ahead[near]
    p, q = np.tensordot(across, way, 1), np.tensordot(along, way, 1)

    def size(angle: float) -> float:
        c, s = np.cos(angle), np.sin(angle)
        return float(np.ptp(c * p + s * q, axis=1).sum() * np.ptp(c * q - s * p, axis=1).sum())

    best = min(np.arange(TURNS) * (0.5 * np.pi / TURNS), key=size)
    return np.asarray(np.cos(best) * across + np.sin(best) * along)


def seen_from(places: Array, a: float, b: float) -> Array:
    """``places`` (3, n), p, q and s, as a point of a lamp's face sees them: (``a``, ``b``) from its
    middle, in the length that p and q change by per s."""
    p, q, s = places
    return np.stack([p - a * s, q - b * s, s])


def overlap(
    half: tuple[float, float], own: Reach, box: Index, other: Reach, caster: Index, rise: Array
) -> Flags:
    """Whether receivers, boxes ``box`` of ``own``, look where boxes ``caster`` of ``other`` lie for
    what is ``rise`` (n,) above them at most, before a lamp with ``half`` its size; pair by pair."""
    result = np.ones(len(rise), bool)
    for size, ends, others in zip(half, (own.p, own.q), (other.p, other.q), strict=True):
        span = size * rise
        result &= others[0][caster] - span <= ends[1][box]
        result &= others[1][caster] + span >= ends[0][box]
    return result


def _along(axis: Array, x: Array, y: Array, z: Array) -> Array:
    """The component of vectors along an axis."""
    result: Array = axis[0] * x
    result += axis[1] * y
    result += axis[2] * z
    return result


def _fold(function: np.ufunc, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """``function`` over the first axis, which is short."""
    result: npt.NDArray[Any] = values[0]
    for row in values[1:]:
        result = function(result, row)
    return result
