"""Exact areas of half planes, quadrants and discs inside convex polygons (float64).

Twin of ``shaders/lib/paint/area_integrals.wgsl``. Green's theorem turns each area into a sum over
the polygon's edges; the forms are chosen so that nothing large cancels. All functions broadcast;
polygons are (…, V, 2) arrays, padded by repeating their last vertex (which adds nothing), and areas
carry the polygon's orientation as their sign.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = [
    "disc_area",
    "half_plane_area",
    "half_plane_share",
    "polygon_area",
    "quadrant_area",
    "swept_area",
]

Array = npt.NDArray[np.float64]


def _edges(polygon: Array) -> tuple[Array, Array]:
    return polygon, np.roll(polygon, -1, axis=-2)


def polygon_area(polygon: Array) -> Array:
    """Signed area of polygons, (…, V, 2) -> (…)."""
    p, q = _edges(polygon - polygon[..., :1, :])
    result: Array = 0.5 * np.sum(p[..., 0] * q[..., 1] - p[..., 1] * q[..., 0], axis=-1)
    return result


def relu_mean(a: Array, b: Array) -> Array:
    """Mean of max(x, 0) over the segment from a to b."""
    high, low = np.maximum(a, b), np.minimum(a, b)
    width = np.where(high > low, high - low, 1.0)
    crossing = 0.5 * high * (high / width)
    result: Array = np.where(low >= 0.0, 0.5 * (a + b), np.where(high <= 0.0, 0.0, crossing))
    return result


def half_plane_area(polygon: Array) -> Array:
    """Area of {x > 0} inside polygons."""
    p, q = _edges(polygon)
    result: Array = np.sum(relu_mean(p[..., 0], q[..., 0]) * (q[..., 1] - p[..., 1]), axis=-1)
    return result


def quadrant_area(polygon: Array) -> Array:
    """Area of {x > 0, y > 0} inside polygons."""
    p, q = _edges(polygon)
    px, py, qx, qy = p[..., 0], p[..., 1], q[..., 0], q[..., 1]
    rise = np.where(qy != py, qy - py, 1.0)
    at = np.clip(-py / rise, 0.0, 1.0)
    x0 = np.where(py < 0.0, px + at * (qx - px), px)
    x1 = np.where(qy < 0.0, px + at * (qx - px), qx)
    height = np.maximum(qy, 0.0) - np.maximum(py, 0.0)
    result: Array = np.sum(relu_mean(x0, x1) * height, axis=-1)
    return result


def half_plane_share(d: Array, gx: Array, gy: Array) -> Array:
    """Share of the unit pixel where d + gx x + gy y > 0, x and y in [-1/2, 1/2]."""
    a = np.maximum(np.abs(gx), np.abs(gy))
    b = np.minimum(np.abs(gx), np.abs(gy))
    x = np.abs(d)
    far = 0.5 * (a + b)
    product = np.where(a * b > 0.0, a * b, 1.0)
    rest = 0.5 * (far - x) * (far - x) / product
    linear = 0.5 + d / np.where(a > 0.0, a, 1.0)
    step = (d > 0.0).astype(np.float64)
    corner = np.where(d > 0.0, 1.0 - rest, rest)
    result: Array = np.where(x >= far, step, np.where(x <= 0.5 * (a - b), linear, corner))
    return result


def disc_area(polygon: Array, radius: Array) -> Array:
    """Area inside the circle of ``radius`` (…,) about the origin, within polygons.

    Each edge adds the triangle with the centre where it runs inside the circle and the circular
    sector where it runs outside.
    """
    return swept_area(*_edges(polygon), radius)


def swept_area(p: Array, q: Array, radius: Array) -> Array:
    """Area that edges (…, V, 2) from p to q sweep, seen from the centre, inside the circle."""
    r = np.broadcast_to(np.asarray(radius, np.float64)[..., None], p.shape[:-1])
    d = q - p
    a = np.sum(d * d, axis=-1)
    b = np.sum(p * d, axis=-1)
    c = np.sum(p * p, axis=-1) - r * r
    root = np.sqrt(np.maximum(b * b - a * c, 0.0))
    safe = np.where(a > 0.0, a, 1.0)
    t0 = np.clip((-b - root) / safe, 0.0, 1.0)
    t1 = np.clip((-b + root) / safe, 0.0, 1.0)
    u = p + t0[..., None] * d
    v = p + t1[..., None] * d
    inner = 0.5 * (u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0])
    outer = 0.5 * r * r * (_angle(p, u) + _angle(v, q))
    result: Array = np.sum(np.where(a > 0.0, inner + outer, 0.0), axis=-1)
    return result


def _angle(p: Array, q: Array) -> Array:
    cross = p[..., 0] * q[..., 1] - p[..., 1] * q[..., 0]
    result: Array = np.arctan2(cross, np.sum(p * q, axis=-1))
    return result
