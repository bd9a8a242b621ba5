"""Convex polygons inside a pixel: half planes, clipping, moments (float64, vectorised).

Twin of ``shaders/common/polygon.wgsl``. Polygons are (n, 8, 2) arrays relative to the pixel's
centre, with ``count`` (n,) corners each; the others repeat the last corner, which adds no area.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = [
    "MOST",
    "SMALLEST",
    "beyond",
    "clip",
    "clip_square",
    "half_planes",
    "moments",
    "rectangles",
    "second_moments",
]

Array = npt.NDArray[np.float64]
Long = npt.NDArray[np.int64]

MOST = 8
"""Corners that a polygon may have."""

SMALLEST = 1e-9
"""px^2; what is smaller isn't drawn."""


def half_planes(corners: Array) -> Array:
    """(n, 3, 3): a x + b y + c >= 0 inside the triangles (n, 3, 2), of either orientation."""
    v, w = corners, np.roll(corners, -1, axis=1)
    planes = np.stack(
        [v[..., 1] - w[..., 1], w[..., 0] - v[..., 0],
         v[..., 0] * w[..., 1] - v[..., 1] * w[..., 0]], axis=-1
    )  # fmt: skip
    result: Array = planes * np.where(planes[..., 2].sum(axis=1) > 0.0, 1.0, -1.0)[:, None, None]
    return result


def beyond(planes: Array, corners: Array, slack: float) -> npt.NDArray[np.bool_]:
    """Whether all ``corners`` (n, V, 2) lie outside one of the half planes (n, K, 3), or no more
    than ``slack`` px inside it."""
    inside = np.einsum("nkd,nvd->nkv", planes[..., :2], corners).max(axis=2) + planes[..., 2]
    length = np.hypot(planes[..., 0], planes[..., 1])
    return np.asarray(~(inside > slack * length).all(axis=1))


def clip(polygon: Array, count: Long, plane: Array) -> tuple[Array, Long]:
    """The parts of polygons where a x + b y + c >= 0, ``plane`` (n, 3), and their corners (n,).

    Sutherland and Hodgman, "Reentrant polygon clipping", CACM 1974.
    """
    x, y = (np.ascontiguousarray(polygon[:, :, axis]) for axis in range(2))
    height = plane[:, :1] * x
    height += plane[:, 1:2] * y
    height += plane[:, 2:]
    # what follows the corners repeats the last one
    out = (height < 0.0).sum(axis=1)
    clipped = np.where((out == 0)[:, None, None], polygon, 0.0)
    size = np.where(out == 0, count, 0)
    some = np.flatnonzero((out > 0) & (out < MOST) & (count > 0))
    clipped[some], size[some] = _crossed(polygon[some], count[some], height[some])
    return clipped, size


def _crossed(polygon: Array, count: Long, height: Array) -> tuple[Array, Long]:
    """`clip` for polygons that a plane crosses, by the corners' heights (n, 8) over it."""
    n = len(polygon)
    rows = np.arange(n)
    clipped, size = np.zeros_like(polygon), np.zeros(n, np.int64)
    a, da = polygon[rows, count - 1], height[rows, count - 1]
    for i in range(int(count.max(initial=0))):
        active = i < count
        b, db = polygon[:, i], height[:, i]
        crossing = np.flatnonzero(active & ((da < 0.0) != (db < 0.0)) & (size < MOST))
        start, end = a[crossing], b[crossing]
        t = da[crossing] / (da[crossing] - db[crossing])
        clipped[crossing, size[crossing]] = start + t[:, None] * (end - start)
        size[crossing] += 1
        inside = np.flatnonzero(active & (db >= 0.0) & (size < MOST))
        clipped[inside, size[inside]] = b[inside]
        size[inside] += 1
        a, da = np.where(active[:, None], b, a), np.where(active, db, da)
    last = clipped[rows, np.maximum(size - 1, 0)]
    padding = np.arange(MOST) >= size[:, None]
    clipped[padding] = np.broadcast_to(last[:, None], clipped.shape)[padding]
    return clipped, size


def clip_square(planes: Array) -> tuple[Array, Long]:
    """The pixel's square cut by half planes (n, K, 3), and its corners (n,)."""
    square = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
    n = len(planes)
    polygon = np.concatenate([square, np.repeat(square[-1:], MOST - 4, axis=0)])
    polygon, count = np.tile(polygon, (n, 1, 1)), np.full(n, 4)
    for k in range(planes.shape[1]):
        polygon, count = clip(polygon, count, planes[:, k])
    return polygon, count


def moments(polygon: Array) -> tuple[Array, Array]:
    """Signed area (n,) and centroid (n, 2)."""
    origin = polygon[:, :1]
    a, b = polygon[:, 1:-1] - origin, polygon[:, 2:] - origin
    twice = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    total = twice.sum(axis=1)
    safe = np.where(total != 0.0, 3.0 * total, 1.0)[:, None]
    centroid = origin[:, 0] + np.sum(twice[..., None] * (a + b), axis=1) / safe
    return 0.5 * total, centroid


def second_moments(polygon: Array) -> Array:
    """(n, 3): integrals of x x, x y and y y over polygons, about the pixel's centre."""
    a, b = polygon, np.roll(polygon, -1, axis=1)
    ax, ay, bx, by = a[..., 0], a[..., 1], b[..., 0], b[..., 1]
    twice = ax * by - ay * bx
    return np.stack(
        [
            np.sum(twice * (ax * ax + bx * bx + ax * bx), axis=1) / 12.0,
            np.sum(twice * (2.0 * (ax * ay + bx * by) + ax * by + ay * bx), axis=1) / 24.0,
            np.sum(twice * (ay * ay + by * by + ay * by), axis=1) / 12.0,
        ],
        axis=1,
    )


def rectangles(area: Array, centroid: Array, second: Array) -> Array:
    """(n, 2, 2): sides, as columns, of the rectangles with the same area's second moments.

    ``second`` (n, 3) as `second_moments` has them. The first side is the one nearer to the rows.
    """
    x, y = centroid.T
    xx, xy, yy = 12.0 * (second.T / area - np.stack([x * x, x * y, y * y]))
    xx, yy = np.maximum(xx, 0.0), np.maximum(yy, 0.0)
    middle, off = 0.5 * (xx + yy), 0.5 * (xx - yy)
    spread = np.hypot(off, xy)
    # what is nearly as long as it is wide keeps to rows and columns
    turned = spread > 1e-3 * middle
    spread = np.where(turned, spread, 0.0)
    angle = np.where(turned, 0.5 * np.arctan2(xy, off), 0.0)
    c, s = np.cos(angle), np.sin(angle)
    long, short = np.sqrt(middle + spread), np.sqrt(np.maximum(middle - spread, 0.0))
    along = np.stack([c * long, s * long], axis=1)
    across = np.stack([-s * short, c * short], axis=1)
    flat = (np.abs(c) >= np.abs(s))[:, None]
    up = np.sign(s)[:, None]
    first, last = np.where(flat, along, -across * up), np.where(flat, across, along * up)
    return np.stack([first, last], axis=2)
