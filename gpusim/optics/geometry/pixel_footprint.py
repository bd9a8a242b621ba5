"""How large pixels are on painted regions.

Where a surface turns away from the camera, as at the rim of a tube, footprints grow without bound.
Tables of speckle that suited the longest would slow down every pixel. So they are made for
footprints up to about twice the median, and triangles with longer ones cut each pixel into pieces
along its footprint, which look up the cells that they lie in.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gpusim.arrays.array_types import Float, Int, Long
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.camera.undistortion_table import distortion_map
from gpusim.optics.geometry.triangle_corners import (
    POSITION,
    ST,
    at_corners,
    barycentric_planes,
    parts,
)
from gpusim.surface.frames import used_vertices
from gpusim.surface.paint import Paint
from gpusim.surface.speckle import Speckle
from gpusim.surface.surface import Surface

MAX_PIECES, MAX_SIDE_PIECES = 144, 12
"""Pieces of a footprint, and on its shorter side; a longer one gets the paint's mean."""

MAX_ROW_PIECES = (4, 8)
"""Pieces of a row of a clipped pixel, of soft and of hard speckle; longer rows are sampled."""

SAFETY = 4.0 / 3.0
"""How far a clipped pixel's corner may lie from its centroid, in half pixels."""

MAX_CUTS = 8
"""Cuts of a pixel a side that the usual tables stand for."""


@dataclass(frozen=True)
class Pieces:
    """Sides of the pieces of a footprint: usual ones and the longest allowed."""

    usual: float
    longest: float


def pieces_of(paint: Speckle) -> Pieces:
    """Pieces for which a disc's area is in closed form, or 3 x 3 points resolve its edge."""
    if paint.softness > 0.0:
        return Pieces(min(2.5 * paint.softness, 0.5 * paint.diameter), 0.5 * paint.diameter)
    # half the diagonal of any parallelogram then stays below 2/3 of the smallest radius, and
    # tables that reach as far as a piece don't cut the usual footprints
    side = 0.58 * paint.smallest
    return Pieces(side, 1.001 * side)


def may_graze(paint: Speckle, widest: float) -> bool:
    """Whether footprints up to a half width may be too large for usual tables."""
    return widest > max(0.75 * pieces_of(paint).longest, 0.375 * paint.diameter)


def grazing_reach(
    paint: Speckle, half: Float, sides: Float, screen: Float, image: tuple[int, int]
) -> float | None:
    """Half width of the footprints that a region's tables should suit; None: the widest one.

    Parameters
    ----------
    half : (n, 3) half width of the footprint at the corners of triangles, in paint coordinates.
    sides : (n, 3, 2, 2) its sides, one per column.
    screen : (n, 3, 2) px, the corners.
    image : width and height, px.
    """
    widest, least = float(half.max()), 0.75 * pieces_of(paint).longest
    if not may_graze(paint, widest):
        return None
    u, v = screen[:, 1] - screen[:, 0], screen[:, 2] - screen[:, 0]
    low, high = screen.min(axis=1), screen.max(axis=1)
    inside = np.clip(np.minimum(high, image) - np.maximum(low, -0.5), 0.0, None)
    share = (inside / np.maximum(high - low, 1e-300)).prod(axis=1)
    seen = np.repeat(np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) * share, 3)
    usual = _median(half.reshape(-1), seen)
    across = _median(0.5 * _lesser_axis(sides).reshape(-1), seen)
    if paint.softness == 0.0 and not across <= MAX_CUTS * paint.smallest / np.sqrt(4.5):
        return None  # pixels too large from any direction: refused where the table is made
    stretched = widest > paint.diameter and widest > 2.0 * across
    if not (widest > 2.0 * usual or stretched):
        return None
    result = float(np.clip(2.0 * usual, 1.01 * least, max(paint.diameter, 1.01 * least)))
    if paint.softness == 0.0:
        # the widest footprint for a number of cuts
        step = 0.95 * paint.smallest / np.sqrt(4.5)
        result = step * float(np.clip(np.round(result / step), 1.0, MAX_CUTS))
    return result if widest > result else None


def piece_of_pixel(
    ex: Float, ey: Float, q: Float, middle: tuple[float, float], count: tuple[int, int]
) -> tuple[Float, Float, Float, Float]:
    """One of ``count`` (columns, rows) pieces of footprints, its ``middle`` so far (of a pixel)
    from theirs: 1 / depth (n, 1), relative, where it moves to, and its sides, (n, 2) each.

    ``ex``, ``ey``: sides of the whole; ``q`` (n, 2): the relative change of 1 / z along them.
    """
    w = 1.0 / (1.0 + q @ np.array(middle))[:, None]
    move = (middle[0] * ex + middle[1] * ey) * w
    return w, move, (ex - move * q[:, :1]) * (w / count[0]), (ey - move * q[:, 1:]) * (w / count[1])


def _lesser_axis(sides: Float) -> Float:
    """The smaller singular value (…,) of 2 x 2 matrices (…, 2, 2)."""
    square = (sides**2).sum(axis=(-2, -1))
    area = np.abs(sides[..., 0, 0] * sides[..., 1, 1] - sides[..., 0, 1] * sides[..., 1, 0])
    root = np.sqrt(np.maximum(square**2 - 4.0 * area**2, 0.0))
    result: Float = area / np.sqrt(np.maximum(0.5 * (square + root), 1e-300))
    return result


def _median(values: Float, weights: Float) -> float:
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order[int(np.searchsorted(total, 0.5 * total[-1]))]])


MIN_TRIANGLES_FOR_BOUNDS = 2000
"""Triangles of a region from which on a quicker look tells which may have the largest pixel."""

ROUNDED = 1e-9
"""Of a size, by which two ways of finding it may differ."""


@dataclass(frozen=True, eq=False)
class RegionPaint:
    """A paint with the extent of its region in paint coordinates and the largest pixel there.

    ``reach``: no less than half of its size. ``seen`` (2, 2), of speckle: lowest and highest
    coordinates of what may be in the image; ``grazing``: some footprints are larger than ``reach``,
    which suits the usual ones.
    """

    paint: Paint
    low: Float
    high: Float
    reach: float
    seen: Float | None = None
    grazing: bool = False


def regions_of(surface: Surface) -> tuple[RegionPaint, ...]:
    """The paints of a surface, before it is known how large pixels are on them."""
    none = np.zeros(2), np.zeros(2)
    return tuple(
        RegionPaint(paint, *surface.extents.get(region, none), 0.0)
        for region, paint in enumerate(surface.paints.values())
    )


def with_reach(
    regions: Sequence[RegionPaint],
    vertices: Float,
    place: Float,
    ideal: Float,
    corner: Long,
    paint: Int,
    camera: Camera,
) -> tuple[tuple[RegionPaint, ...], Float]:
    """Half the largest pixel footprint of every patterned region and (T,) of every triangle.

    ``vertices`` (V, 11), ``place`` and ``ideal`` (V, 2), ``corner`` and ``paint`` (T, …) are those
    of `gpusim.optics.geometry.view.View`.
    """
    bends = distortion_map(camera)
    stretch = 1.0 if bends is None else bends.stretch
    result, widest = [], np.zeros(len(paint))
    columns = _footprint_columns(vertices, ideal)
    for number, region in enumerate(regions):
        extent = float((region.high - region.low).max())
        of_paint = paint == number
        count = int(np.count_nonzero(of_paint)) if extent > 0.0 else 0
        whole = count == len(paint)
        rows = np.flatnonzero(of_paint) if count and not whole else np.zeros(0, np.int64)
        if count and isinstance(region.paint, Speckle):
            own_corner = corner if whole else corner[rows]
            used = used_vertices(own_corner, len(place))
            # column by column: along an axis of two numbers NumPy takes thirty times as long
            st = [np.take(column, used) for column in columns[4:]]
            seen = np.array([[at.min() for at in st], [at.max() for at in st]])
            candidates = own_corner
            if count >= MIN_TRIANGLES_FOR_BOUNDS:
                candidates = own_corner[_maybe_largest(columns, own_corner)]
            half, slope = _at_corners_of(vertices, candidates, camera, stretch)
            limit = None
            if candidates is own_corner or may_graze(region.paint, float(half.max())):
                if candidates is not own_corner:
                    half, slope = _at_corners_of(vertices, own_corner, camera, stretch)
                widest[of_paint] = half.max(axis=1)
                image = (camera.width, camera.height)
                limit = grazing_reach(region.paint, half, slope, place[own_corner], image)
            reach = min(float(half.max()), extent) if limit is None else limit
            region = replace(region, reach=reach, seen=seen, grazing=limit is not None)
        elif count:
            some = (part if whole else rows[part] for part in parts(count))
            reach = stretch * max(float(_footprint_sizes(columns, corner[k]).max()) for k in some)
            region = replace(region, reach=min(reach, extent), seen=None, grazing=False)
        result.append(region)
    return tuple(result), widest


def _at_corners_of(
    vertices: Float, corner: Long, camera: Camera, stretch: float
) -> tuple[Float, Float]:
    """Half the size (n, 3) of pixels at the corners of triangles, and their sides (n, 3, 2, 2)."""
    footprints = (_of_corners(vertices, corner[part], camera) for part in parts(len(corner)))
    slope = stretch * np.concatenate([_footprints(*one) for one in footprints])
    return 0.5 * np.abs(slope).sum(axis=-1).max(axis=-1), slope


def _maybe_largest(columns: list[Float], corner: Long) -> Long:
    """Those (m,) of triangles (n, 3) that the largest of `_footprint_sizes` may be of."""
    sizes = np.concatenate([_footprint_sizes(columns, corner[part]) for part in parts(len(corner))])
    return np.flatnonzero(sizes >= (1.0 - ROUNDED) * sizes.max())


def _of_corners(vertices: Float, corner: Long, camera: Camera) -> tuple[Float, Float]:
    """Places and paint coordinates (n, 3, 5) at the corners of triangles, and their planes."""
    corners = at_corners(vertices[:, : ST.stop], list(corner.T))
    return corners, barycentric_planes(corners, camera)


def _footprints(corners: Float, planes: Float) -> Float:
    """(n, 3, 2, 2): change of s and t per column and row at the corners of triangles."""
    st = corners[:, :, ST]
    scaled = np.swapaxes(st, 1, 2) @ planes
    slope = scaled[:, None, :, :2] - st[..., None] * planes.sum(axis=1)[:, None, None, :2]
    result: Float = slope * corners[:, :, 2, None, None]
    return result


def _footprint_columns(vertices: Float, ideal: Float) -> list[Float]:
    """Of vertices (V, 11) at ``ideal`` (V, 2), (V,) each: x, y (px of the ideal image), depth, its
    inverse, s and t."""
    z = vertices[:, POSITION.stop - 1]
    return [np.ascontiguousarray(v) for v in (*ideal.T, z, 1.0 / z, *vertices[:, ST].T)]


def _footprint_sizes(columns: list[Float], corner: Long) -> Float:
    """Half the largest pixel in paint coordinates (n,) at the corners of each triangle (n, 3).

    ``columns``: of the vertices, as `_footprint_columns` says.
    """
    x, y, depth, inverse, *paint = (
        [np.take(column, corner[:, k], mode="clip") for k in range(3)] for column in columns
    )
    ux, uy, vx, vy = x[1] - x[0], y[1] - y[0], x[2] - x[0], y[2] - y[0]
    area = np.abs(ux * vy - uy * vx)

    def slope(value: list[Float]) -> tuple[Float, Float]:
        """How it changes per column and row, times the triangle's area, twice."""
        u, v = value[1] - value[0], value[2] - value[0]
        return u * vy - v * uy, v * ux - u * vx

    # s / z and 1 / z are affine in the image
    rate = slope(inverse)
    most = np.zeros(len(corner))
    for value in paint:
        change = slope([s * w for s, w in zip(value, inverse, strict=True)])
        for s, z in zip(value, depth, strict=True):
            size = np.abs(change[0] - s * rate[0])
            size += np.abs(change[1] - s * rate[1])
            size *= z
            np.maximum(most, size, out=most)
    result: Float = 0.5 * most / area
    return result
