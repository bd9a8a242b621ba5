"""Triangles that turn their front to a lamp: to all of its face, to none of it, or to some."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.optics.corners import CHUNK
from gpusim.optics.lamp_view import LampView

__all__ = ["SURE", "Turned", "areas", "turned_to"]

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Numbers = npt.NDArray[np.int64]

SURE = 1e-13
"""Of the extent in a lamp's view, squared: areas that rounding may turn over; and of a cosine."""


@dataclass(frozen=True, eq=False)
class Turned:
    """``front`` (T,): triangles that turn their front to all of a lamp. ``edge_on`` (n,): those
    that don't to all, nor their back. ``least``: areas up to this may be rounding."""

    front: Flags
    edge_on: Numbers
    least: float


def turned_to(
    view: LampView, places: Array, triangles: npt.NDArray[np.int64], both: bool
) -> Turned | None:
    """Which triangles turn their front to a lamp; None where, unless they may do ``both``, one is
    seen edge-on from some of it, or some turn their front and some their back.

    ``places`` (3, P): p, q and s of their corners.
    """
    least = SURE * float(np.ptp(places[:2], axis=1).max(initial=0.0)) ** 2
    front = np.empty(len(triangles), bool)
    numbers = [np.zeros(0, np.int64)]
    for first in range(0, len(triangles), CHUNK):
        part = slice(first, first + CHUNK)
        area, *change = areas(view, places, triangles[part])
        sweep = np.full(len(area), least)
        for own in change:
            sweep += np.abs(own)
        ahead = area > sweep
        doubt = np.flatnonzero(~(ahead | (area < -sweep)))
        if len(doubt) and not both:
            return None
        numbers.append(first + doubt)
        front[part] = ahead
        if not both and (not ahead.all() or first) and (ahead != front[0]).any():
            return None
    return Turned(front, np.concatenate(numbers), least)


def areas(view: LampView, places: Array, triangles: npt.NDArray[np.int64]) -> list[Array]:
    """Twice the area of triangles as seen from the middle of a lamp, below 0 where they show their
    back; and what it grows by towards the ends of the lamp's two half sides, if it has a size."""
    turn = -np.sign(np.linalg.det([view.across, view.along, view.axis]))
    corner = [np.ascontiguousarray(triangles[:, k]) for k in range(3)]
    p, q = (_sides(values, corner) for values in places[:2])
    area = p[0] * q[1]
    area -= p[1] * q[0]
    area *= turn
    if not view.lamp.extended:
        return [area]
    s = _sides(places[2], corner)
    across, along = (-turn * size for size in view.half)
    return [area, across * (s[0] * q[1] - s[1] * q[0]), along * (p[0] * s[1] - p[1] * s[0])]


def _sides(values: Array, corner: list[npt.NDArray[np.int64]]) -> tuple[Array, Array]:
    """How ``values`` (P,) change from the first corner to the others."""
    own = [np.take(values, numbers, mode="clip") for numbers in corner]
    return own[1] - own[0], own[2] - own[0]
