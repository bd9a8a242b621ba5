"""Lamps seen from points, ray by ray: what shadows are judged by."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

import gpusim as gs
from gpusim.optics.emitters import Lamp
from gpusim.surface.surface import triangulate

Array = npt.NDArray[np.float64]


def triangles_of(surfaces: list[gs.Surface]) -> Array:
    return np.concatenate([s.points[triangulate(s.faces)[0]] for s in surfaces])


def hits(origin: Array, way: Array, triangles: Array) -> npt.NDArray[np.bool_]:
    """Whether the segments origin + t way, 1e-6 < t < 1, meet a triangle (Moeller-Trumbore)."""
    found = np.zeros(len(origin), bool)
    for a, b, c in triangles:
        p = np.cross(way, c - a)
        determinant = p @ (b - a)
        safe = np.where(determinant != 0.0, determinant, np.inf)
        s = origin - a
        u = np.sum(s * p, axis=1) / safe
        q = np.cross(s, b - a)
        v = np.sum(way * q, axis=1) / safe
        t = (q @ (c - a)) / safe
        found |= (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 1e-6) & (t < 1)
    return found


def lamp_samples(lamp: Lamp, n: int) -> Array:
    g = 2.0 * (np.arange(n) + 0.5) / n - 1.0
    a, b = (v.reshape(-1) for v in np.meshgrid(g, g))
    keep = a * a + b * b <= 1.0 if lamp.round else np.ones(len(a), bool)
    return lamp.centre + a[keep, None] * lamp.u + b[keep, None] * lamp.v


def brute_share(lamp: Lamp, points: Array, triangles: Array, n: int = 24) -> Array:
    """Share of the lamp that each point (P, 3) sees, by n x n rays."""
    samples = lamp_samples(lamp, n if lamp.extended else 1)
    origin = np.repeat(points, len(samples), axis=0)
    way = np.tile(samples, (len(points), 1)) - (0.0 if lamp.far else 1.0) * origin
    if lamp.far:
        way *= 10.0
    return 1.0 - hits(origin, way, triangles).reshape(len(points), -1).mean(axis=1)
