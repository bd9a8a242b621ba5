"""Pieces of edge pixels in NumPy: what shows of each triangle, its paint's mean, its light.

The float64 form of what ``shaders/optics/edge_pixels/resolve.wgsl`` does; the host resolves those
pixels by it that the device leaves.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.optics.camera.undistortion_table import distortion_map
from gpusim.optics.edge_pixels.background_moments import backdrops, fills, left_open
from gpusim.optics.edge_pixels.fragment_lists import EdgePixels
from gpusim.optics.edge_pixels.visible_polygons import (
    SLIVER,
    Cutting,
    depth_planes,
    visible_polygons,
)
from gpusim.optics.geometry.polygon_clipping import (
    clip_square,
    half_planes,
    moments,
    pick,
    rectangles,
    second_moments,
)
from gpusim.optics.geometry.view import FIXED
from gpusim.optics.paint.bitmap import BITMAP, mean_over_polygons
from gpusim.optics.paint.footprint_mean import mean_albedo
from gpusim.optics.shading.lighting import SharesOf
from gpusim.optics.shading.setup import Setup, radiance_of

__all__ = ["THIN", "corners_over", "resolve_on_host"]

Array = npt.NDArray[np.float64]
THIN = 5e-4
"""Area, px^2, that no triangle takes; less of it is a seam between neighbours."""


def corners_over(
    setup: Setup, edges: EdgePixels, rows: npt.NDArray[np.int64] | None = None
) -> tuple[npt.NDArray[np.int64], Array, Array]:
    """Of triangles over edge pixels, or some ``rows`` of them: the pixel (n,) of each, where that
    is (n, 2), and the corners (n, 3, 2) from there, in sides of its sensitive square."""
    view, width = setup.view, setup.view.camera.width
    pixel = np.repeat(np.arange(len(edges.pixel)), edges.depth)
    triangle = edges.triangle[: len(pixel)]
    if rows is not None:
        pixel, triangle = pixel[rows], triangle[rows]
    number = edges.pixel[pixel]
    at = np.stack([number % width, number // width], axis=1).astype(np.float64)
    corners = np.rint(view.screen_of(triangle) * FIXED) / FIXED
    corners -= at[:, None]
    return pixel, at, corners / view.camera.pixel_side


def resolve_on_host(setup: Setup, edges: EdgePixels, shares: SharesOf | None = None) -> Array:
    """Radiance of the edge pixels; ``shares`` tells what is seen of lamps."""
    if not len(edges.pixel):
        return np.zeros(0)
    view, count = setup.view, len(edges.pixel)
    pixel, at, corners = corners_over(setup, edges)
    first = np.repeat(edges.start[:-1], edges.depth)
    triangle = edges.triangle[: len(pixel)]
    planes = half_planes(corners)
    pierced = edges.pierced[pixel] if edges.pierced.any() else None
    cutting = None
    if pierced is not None:
        last = np.repeat(edges.start[1:], edges.depth)
        from_centre = (view.screen[triangle] - at[:, None]) / view.camera.pixel_side
        depth = depth_planes(from_centre, view.inverse_depth(triangle))
        cutting = Cutting(pierced, last, depth)
    polygon, sides_left = clip_square(planes)
    behind = backdrops(setup, edges, fills(planes), corners)
    row, piece = visible_polygons(polygon, sides_left, planes, corners, first, cutting, behind)
    size, middle = moments(piece)
    solid = np.flatnonzero(size > 0.0)
    row, size, middle, piece = row[solid], size[solid], middle[solid], pick(piece, solid)
    shadowed = setup.lighting.shadows is not None
    walls = bool(behind.any())
    second = second_moments(piece) if shadowed or walls else np.zeros((len(size), 3))
    if walls:
        wall = np.flatnonzero(behind)
        number = np.full(count, -1)
        number[pixel[wall]] = np.arange(len(wall))
        left = left_open(number[pixel[row]], len(wall), size, middle, second)
        open_ = np.flatnonzero(left[0] > SLIVER)
        wall = wall[open_]
        row = np.concatenate([row, wall])
        size, middle, second = (
            np.concatenate([own, more[open_]])
            for own, more in zip((size, middle, second), left, strict=True)
        )
        piece = np.concatenate([piece, pick(polygon, wall)])
    albedo, printed = _mean_albedo(setup, triangle[row], at[row], piece, middle)
    sides: Array | None = None
    if shadowed:
        # each piece by itself: the middle of those round a corner may lie under what hides it
        sides = rectangles(size, middle, second)
    else:
        area: Array = np.bincount(row, size, len(pixel)).astype(np.float64)
        some = np.flatnonzero(area > 0.0)
        albedo, printed, *places = (
            np.bincount(row, size * values, len(pixel))[some] / area[some]
            for values in (albedo, printed, *middle.T)
        )
        row, size, middle = some, area[some], np.stack(places, axis=1)
    x, y = (at[row] + view.camera.pixel_side * middle).T
    light = radiance_of(setup, triangle[row], x, y, albedo, printed, sides, shares)
    seen = np.bincount(pixel[row], size, count)
    value = np.bincount(pixel[row], size * light, count)
    opened = 1.0 - seen
    result: Array = np.where(
        opened > THIN, value + opened * setup.background, value / np.maximum(seen, 1.0 - THIN)
    )
    return result


def _mean_albedo(
    setup: Setup, triangle: npt.NDArray[np.int64], at: Array, polygon: Array, centroid: Array
) -> tuple[Array, Array]:
    """Mean albedo (n,) of polygons (n, 8, 2) in pixels ``at``, and the share that is printed."""
    side = setup.view.camera.pixel_side
    paint = setup.view.paint[triangle]
    albedo = setup.table.paints["ground"][paint].astype(np.float64)
    featured = setup.table.paints["featured"][paint]
    # all of a polygon through the cubic of its pixel
    within = side * np.concatenate([centroid[:, None], polygon], axis=1)
    ideal = _undistorted(setup, at, at[:, None] + within)
    rows = np.flatnonzero((featured > 0) & (featured < BITMAP))
    if len(rows):
        own = triangle[rows]
        middle, w0 = _paint_positions(setup, own, ideal[rows, :1])
        corners, w = _paint_positions(setup, own, ideal[rows, 1:])
        albedo[rows] = mean_albedo(
            setup.table, paint[rows], setup.of(own).cell, middle[:, 0], corners - middle, w / w0
        )
    for number, image in setup.bitmaps.images.items():
        rows = np.flatnonzero(paint == number)
        own = triangle[rows]
        middle, w0 = _paint_positions(setup, own, ideal[rows, :1])
        corners, w = _paint_positions(setup, own, ideal[rows, 1:])
        albedo[rows] = mean_over_polygons(
            image, image.ground, setup.of(own).cell, middle[:, 0], corners - middle, w / w0
        )
    printed = np.zeros(len(albedo))
    rows = np.flatnonzero((featured == 1) & setup.shiny[triangle])
    if len(rows):
        own = triangle[rows]
        middle, w0 = _paint_positions(setup, own, ideal[rows, :1])
        corners, w = _paint_positions(setup, own, ideal[rows, 1:])
        printed[rows] = mean_albedo(
            setup.table.mask(),
            paint[rows],
            setup.of(own).cell,
            middle[:, 0],
            corners - middle,
            w / w0,
        )
    return albedo, printed


def _undistorted(setup: Setup, pixel: Array, at: Array) -> Array:
    """Ideal positions of image positions (n, V, 2) in pixels (n, 2)."""
    bends = distortion_map(setup.view.camera)
    if bends is None:
        return at
    owner = np.repeat(pixel.astype(np.int64), at.shape[1], axis=0)
    flat = at.reshape(-1, 2)
    return (flat + bends.evaluate(owner, flat - owner)[0]).reshape(at.shape)


def _paint_positions(
    setup: Setup, triangle: npt.NDArray[np.int64], pixels: Array
) -> tuple[Array, Array]:
    """Paint positions (n, V, 2) of ideal positions (n, V, 2), and 1 / z (n, V) to scale."""
    own = setup.of(triangle)
    d, planes = pixels - own.anchor[:, None], own.planes[:, :3]
    values = d @ np.swapaxes(planes[:, :, :2], 1, 2) + planes[:, None, :, 2]
    return values[..., :2] / values[..., 2:], values[..., 2]
