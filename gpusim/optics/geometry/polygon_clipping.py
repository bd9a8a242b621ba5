"""Convex polygons inside a pixel: half planes, clipping, moments (float64, vectorised).

Twin of ``shaders/lib/raster/polygon_clipping.wgsl``. Polygons are (n, 8, 2) arrays relative to the
pixel's centre, with ``count`` (n,) corners each; the others repeat the last corner, which adds no
area.

What is made here lies corner by corner in memory (in Fortran's order), as passes along short axes
take many times as long; `pick` keeps it so. Any order is taken.

Exact areas of half planes, quadrants and discs inside convex polygons: twin of
``shaders/lib/paint/area_integrals.wgsl``. Green's theorem turns each area into a sum over the
polygon's edges; the forms are chosen so that nothing large cancels. All of these broadcast; their
polygons are (…, V, 2) arrays, padded by repeating their last vertex (which adds nothing), and areas
carry the polygon's orientation as their sign.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Bool, Float, Long

T = TypeVar("T", bound=np.generic)

MAX_CORNERS = 8
"""Corners that a polygon may have."""

MIN_AREA = 1e-9
"""px^2; what is smaller isn't drawn."""

ON, ROUNDING = 1e-12, 1e-15
"""px, and share of a plane's offset, by which corners lie on the plane."""

_PLACE = np.arange(MAX_CORNERS)[:, None]


def pick(array: npt.NDArray[T], index: Long | Bool) -> npt.NDArray[T]:
    """``array[index]`` for an index (m,) into the first axis, in Fortran's order."""
    if index.dtype == bool:
        index = np.flatnonzero(index)
    result: npt.NDArray[T] = np.take(array.T, index, axis=-1).T
    return result


def half_planes(corners: Float) -> Float:
    """(n, 3, 3): a x + b y + c >= 0 inside the triangles (n, 3, 2), of either orientation."""
    x, y = np.asfortranarray(corners).T
    planes = np.empty((3, 3, len(corners)))
    for k, after in ((0, 1), (1, 2), (2, 0)):
        np.subtract(y[k], y[after], out=planes[0, k])
        np.subtract(x[after], x[k], out=planes[1, k])
        np.subtract(x[k] * y[after], y[k] * x[after], out=planes[2, k])
    planes *= np.where(planes[2, 0] + planes[2, 1] + planes[2, 2] > 0.0, 1.0, -1.0)
    return planes.T


def beyond(planes: Float, corners: Float, slack: float) -> Bool:
    """Whether all ``corners`` (n, V, 2) lie outside one of the half planes (n, K, 3), or no more
    than ``slack`` px inside it."""
    x, y = np.asfortranarray(corners).T
    a, b, c = np.asfortranarray(planes).T
    result = np.zeros(len(planes), bool)
    for k in range(len(a)):
        inside = (a[k] * x + b[k] * y).max(axis=0) + c[k]
        result |= ~(inside > slack * np.hypot(a[k], b[k]))
    return result


def clip(polygon: Float, count: Long, plane: Float) -> tuple[Float, Long]:
    """The parts of polygons where a x + b y + c >= 0, ``plane`` (n, 3), and their corners (n,).

    As Sutherland and Hodgman, "Reentrant polygon clipping", CACM 1974; but all corners that stay
    follow each other, so that two crossings and a turn of the numbers are all that it takes.
    """
    corners = np.asfortranarray(polygon).T
    height = plane[:, 0] * corners[0]
    height += plane[:, 1] * corners[1]
    height += plane[:, 2]
    # from rounding, corners that are nearly one could lie in and out by turns
    flat = ON * (np.abs(plane[:, 0]) + np.abs(plane[:, 1])) + ROUNDING * np.abs(plane[:, 2])
    height[np.abs(height) <= flat] = 0.0
    # what follows the corners repeats the last one
    out = (height < 0.0).view(np.uint8).sum(axis=0, dtype=np.uint8)
    within = out == 0
    clipped, size = corners * within, count * within
    some = np.flatnonzero((out > 0) & (out < MAX_CORNERS) & (count > 0))
    if len(some):
        part, number = _crossed(corners[:, :, some], count[some], height[:, some])
        clipped[:, :, some], size[some] = part, number
    return clipped.T, size


def _crossed(corners: Float, count: Long, height: Float) -> tuple[Float, Long]:
    """`clip` for polygons (2, 8, n) that a plane crosses, by their corners' heights (8, n)."""
    column = np.arange(len(count))
    inside = height >= 0.0
    # before the first corner comes the last one, which the padding repeats
    rises = inside & ~np.concatenate([inside[-1:], inside[:-1]])
    first = rises.argmax(axis=0)
    kept = (inside & (_PLACE < count)).view(np.uint8).sum(axis=0, dtype=np.int64)

    def cut(start: Long, end: Long) -> Float:
        """Where the side between two corners (n,) is crossed, (2, n)."""
        below, above = height[start, column], height[end, column]
        a, b = corners[:, start, column], corners[:, end, column]
        # where rounding makes a sliver's corners go in and out again, both may lie on one side
        span = below - above
        share = np.clip(below / np.where(span != 0.0, span, 1.0), 0.0, 1.0)
        result: Float = a + share * (b - a)
        return result

    def turned(number: Long) -> Long:
        return number - count * (number >= count)

    enters = cut(np.where(first == 0, count, first) - 1, first)
    leaves = cut(turned(first + kept - 1), turned(first + kept))
    # in the order of the corners' numbers, as the shader finds them: what both make of a polygon
    # may depend on its first corner
    size = kept + 2
    step = np.minimum(_PLACE, size - 1)
    step += np.where((first > 0) & (first + kept >= count), 1 + count - first, 0)
    step -= size * (step >= size)
    place = turned(first + np.clip(step - 1, 0, kept - 1))
    clipped = np.take_along_axis(corners, place[None], axis=1)
    np.copyto(clipped, enters[:, None], where=step == 0)
    np.copyto(clipped, leaves[:, None], where=step > kept)
    return clipped, np.minimum(size, MAX_CORNERS)


def clip_square(planes: Float) -> tuple[Float, Long]:
    """The pixel's square cut by half planes (n, K, 3), and its corners (n,)."""
    square = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
    n = len(planes)
    corners = np.concatenate([square, np.repeat(square[-1:], MAX_CORNERS - 4, axis=0)])
    polygon: Float = np.repeat(corners.T[:, :, None], n, axis=2).T
    count = np.full(n, 4)
    for k in range(planes.shape[1]):
        polygon, count = clip(polygon, count, planes[:, k])
    return polygon, count


def moments(polygon: Float) -> tuple[Float, Float]:
    """Signed area (n,) and centroid (n, 2)."""
    corners = np.asfortranarray(polygon).T
    away = corners[:, 1:] - corners[:, :1]
    (ax, ay), (bx, by) = away[:, :-1], away[:, 1:]
    twice = ax * by - ay * bx
    total = twice.sum(axis=0)
    safe = np.where(total != 0.0, 3.0 * total, 1.0)
    centroid = np.stack([(twice * (ax + bx)).sum(axis=0), (twice * (ay + by)).sum(axis=0)])
    return 0.5 * total, (corners[:, 0] + centroid / safe).T


def second_moments(polygon: Float) -> Float:
    """(n, 3): integrals of x x, x y and y y over polygons, about the pixel's centre."""
    ax, ay = np.asfortranarray(polygon).T
    bx, by = np.roll(ax, -1, axis=0), np.roll(ay, -1, axis=0)
    twice = ax * by - ay * bx
    return np.stack(
        [
            np.sum(twice * (ax * ax + bx * bx + ax * bx), axis=0) / 12.0,
            np.sum(twice * (2.0 * (ax * ay + bx * by) + ax * by + ay * bx), axis=0) / 24.0,
            np.sum(twice * (ay * ay + by * by + ay * by), axis=0) / 12.0,
        ]
    ).T


def rectangles(area: Float, centroid: Float, second: Float) -> Float:
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


def _edges(polygon: Float) -> tuple[Float, Float]:
    return polygon, np.roll(polygon, -1, axis=-2)


def polygon_area(polygon: Float) -> Float:
    """Signed area of polygons, (…, V, 2) -> (…)."""
    p, q = _edges(polygon - polygon[..., :1, :])
    result: Float = 0.5 * np.sum(p[..., 0] * q[..., 1] - p[..., 1] * q[..., 0], axis=-1)
    return result


def relu_mean(a: Float, b: Float) -> Float:
    """Mean of max(x, 0) over the segment from a to b."""
    high, low = np.maximum(a, b), np.minimum(a, b)
    width = np.where(high > low, high - low, 1.0)
    crossing = 0.5 * high * (high / width)
    result: Float = np.where(low >= 0.0, 0.5 * (a + b), np.where(high <= 0.0, 0.0, crossing))
    return result


def half_plane_area(polygon: Float) -> Float:
    """Area of {x > 0} inside polygons."""
    p, q = _edges(polygon)
    result: Float = np.sum(relu_mean(p[..., 0], q[..., 0]) * (q[..., 1] - p[..., 1]), axis=-1)
    return result


def quadrant_area(polygon: Float) -> Float:
    """Area of {x > 0, y > 0} inside polygons."""
    p, q = _edges(polygon)
    px, py, qx, qy = p[..., 0], p[..., 1], q[..., 0], q[..., 1]
    rise = np.where(qy != py, qy - py, 1.0)
    at = np.clip(-py / rise, 0.0, 1.0)
    x0 = np.where(py < 0.0, px + at * (qx - px), px)
    x1 = np.where(qy < 0.0, px + at * (qx - px), qx)
    height = np.maximum(qy, 0.0) - np.maximum(py, 0.0)
    result: Float = np.sum(relu_mean(x0, x1) * height, axis=-1)
    return result


def half_plane_share(d: Float, gx: Float, gy: Float) -> Float:
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
    result: Float = np.where(x >= far, step, np.where(x <= 0.5 * (a - b), linear, corner))
    return result


def disc_area(polygon: Float, radius: Float) -> Float:
    """Area inside the circle of ``radius`` (…,) about the origin, within polygons.

    Each edge adds the triangle with the centre where it runs inside the circle and the circular
    sector where it runs outside.
    """
    return swept_area(*_edges(polygon), radius)


def swept_area(p: Float, q: Float, radius: Float) -> Float:
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
    result: Float = np.sum(np.where(a > 0.0, inner + outer, 0.0), axis=-1)
    return result


def _angle(p: Float, q: Float) -> Float:
    cross = p[..., 0] * q[..., 1] - p[..., 1] * q[..., 0]
    result: Float = np.arctan2(cross, np.sum(p * q, axis=-1))
    return result
