"""Lamps seen from points, ray by ray: what shadows are judged by."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

import gpusim as gs
from gpusim.optics.light.quadrature import Lamp
from gpusim.surface.surface import triangulate

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

MOST = 1 << 20
"""Points and triangles, or triangles and rays, at a time."""

SPREAD = 1e-6
"""Sine by which a lamp without a size is taken to be larger, so that planes about it exist."""


def triangles_of(surfaces: list[gs.Surface]) -> Array:
    return np.concatenate([s.points[triangulate(s.faces)[0]] for s in surfaces])


def may_meet(lamp: Lamp, points: Array, reach: Array, triangles: Array) -> Flags:
    """(P, T): whether triangles (T, 3, 3) may meet rays to a lamp from within ``reach`` (P,) of
    points (P, 3): not where all of one lies beyond one of the four planes through the point and
    the lamp's sides."""
    to = lamp.centre - (0.0 if lamp.far else 1.0) * points
    u, v = lamp.u, lamp.v
    if not lamp.extended:
        width = SPREAD * np.abs(to).max(axis=1, keepdims=True)
        u, v = width * np.moveaxis(np.eye(3)[np.argsort(np.abs(to), axis=1)[:, :2]], 1, 0)
    ends = [to + a * u + b * v for a, b in ((-1, -1), (-1, 1), (1, 1), (1, -1))]
    corners = triangles.reshape(-1, 3)
    met = np.ones((len(points), len(triangles)), bool)
    for k in range(4):
        plane = np.cross(ends[k], ends[(k + 1) % 4])
        within = np.sum(plane * to, axis=1)
        size = np.linalg.norm(plane, axis=1)
        beside = plane @ corners.T - np.sum(plane * points, axis=1)[:, None]
        beside *= np.sign(within)[:, None]
        least = -reach * size - 1e-12 * np.abs(beside).max(axis=1)
        inside = (beside.reshape(*met.shape, 3) > least[:, None, None]).any(axis=2)
        # from within the lamp's plane all rays lie in that
        flat = np.abs(within) <= 1e-9 * size * np.linalg.norm(to, axis=1)
        met &= inside | flat[:, None]
    return met


def meets(origin: Array, ways: Array, triangles: Array) -> Flags:
    """(M, S): whether segments origin + t way, 1e-6 < t < 1, of ``ways`` (M, S, 3) from each
    ``origin`` (M, 3) meet its triangle (M, 3, 3)."""
    a, b, c = (triangles[:, k] - origin for k in range(3))
    normal = np.cross(b - a, c - a)
    fall = np.einsum("msi,mi->ms", ways, normal)
    sides = [np.einsum("msi,mi->ms", ways, np.cross(p, q)) for p, q in ((a, b), (b, c), (c, a))]
    t = np.sum(normal * a, axis=1)[:, None] / np.where(fall != 0.0, fall, np.inf)
    found = np.logical_and.reduce([v >= 0 for v in sides])
    found |= np.logical_and.reduce([v <= 0 for v in sides])
    found &= (t > 1e-6) & (t < 1)
    return found


def lamp_samples(lamp: Lamp, n: int) -> Array:
    g = 2.0 * (np.arange(n) + 0.5) / n - 1.0
    a, b = (v.reshape(-1) for v in np.meshgrid(g, g))
    keep = a * a + b * b <= 1.0 if lamp.round else np.ones(len(a), bool)
    return lamp.centre + a[keep, None] * lamp.u + b[keep, None] * lamp.v


def brute_share(lamp: Lamp, points: Array, triangles: Array, n: int = 24) -> Array:
    """Share of the lamp that each point (P, 3) sees, by n x n rays."""
    samples = lamp_samples(lamp, n if lamp.extended else 1)
    hidden = np.zeros((len(points), len(samples)), bool)
    for some in np.array_split(np.arange(len(points)), len(points) * len(triangles) // MOST + 1):
        met = may_meet(lamp, points[some], np.zeros(len(some)), triangles)
        for pairs in np.array_split(np.argwhere(met), met.sum() * len(samples) // MOST + 1):
            if not len(pairs):
                continue
            point, face = some[pairs[:, 0]], pairs[:, 1]
            ways = samples - (0.0 if lamp.far else 1.0) * points[point][:, None]
            ways = np.broadcast_to((10.0 if lamp.far else 1.0) * ways, (len(point), *samples.shape))
            found = meets(points[point], ways, triangles[face])
            first = np.flatnonzero(np.diff(point, prepend=-1))
            hidden[point[first]] |= np.logical_or.reduceat(found, first, axis=0)
    return np.asarray(1.0 - hidden.mean(axis=1))
