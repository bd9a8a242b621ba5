"""Pieces of edge pixels in NumPy: what shows of each triangle, its paint's mean, its light.

The float64 form of what ``shaders/optics/edge_pixels/resolve.wgsl`` does; the host resolves those
pixels by it that the device leaves.
"""

from __future__ import annotations

import numpy as np

from gpusim.arrays.array_types import Float, Long
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.camera.undistortion_table import distortion_map
from gpusim.optics.edge_pixels.fragment_lists import EdgePixels
from gpusim.optics.edge_pixels.visible_polygons import Cutting, visible_polygons
from gpusim.optics.geometry.polygon_clipping import (
    clip_square,
    half_planes,
    moments,
    pick,
    rectangles,
    second_moments,
)
from gpusim.optics.geometry.view import FIXED, View
from gpusim.optics.paint.bitmap import BITMAP, mean_over_polygons
from gpusim.optics.paint.footprint_mean import mean_albedo
from gpusim.optics.shading.coefficients import PerTriangle
from gpusim.optics.shading.lighting import SharesOf
from gpusim.optics.shading.radiance import radiance_of
from gpusim.optics.shading.setup import Setup
from gpusim.optics.visibility_buffer import depth_planes
from gpusim.surface.color import grey

THIN = 5e-4
"""Area, px^2, that no triangle takes; less of it is a seam between neighbours."""


def _corners_over(view: View, edges: EdgePixels) -> tuple[Long, Float, Float]:
    """Of triangles over edge pixels: the pixel (n,) of each, where that is (n, 2), and the corners
    (n, 3, 2) from there, in sides of its sensitive square."""
    pixel = np.repeat(np.arange(len(edges.pixel)), edges.depth)
    row, column = np.divmod(edges.pixel[pixel], view.camera.width)
    at = np.stack([column, row], axis=1).astype(np.float64)
    corners = np.rint(view.screen_of(edges.triangle[: len(pixel)]) * FIXED) / FIXED
    corners -= at[:, None]
    return pixel, at, corners / view.camera.pixel_side


def _cutting(view: View, edges: EdgePixels, pixel: Long, at: Float) -> Cutting:
    """Which of two triangles over a pixel, that is ``at`` (n, 2), is in front where."""
    triangle = edges.triangle[: len(pixel)]
    last = np.repeat(edges.start[1:], edges.depth)
    from_centre = (view.screen[triangle] - at[:, None]) / view.camera.pixel_side
    depth = depth_planes(from_centre, view.inverse_depth(triangle))
    return Cutting(edges.pierced[pixel], last, depth)


def resolve_on_host(setup: Setup, edges: EdgePixels, shares: SharesOf | None = None) -> Float:
    """Radiance (bands, n) of the edge pixels; ``shares`` tells what is seen of lamps."""
    if not len(edges.pixel):
        return np.zeros((len(setup.bands), 0))
    view, count = setup.view, len(edges.pixel)
    pixel, at, corners = _corners_over(view, edges)
    first = np.repeat(edges.start[:-1], edges.depth)
    triangle = edges.triangle[: len(pixel)]
    planes = half_planes(corners)
    cutting = _cutting(view, edges, pixel, at) if edges.pierced.any() else None
    polygon, sides_left = clip_square(planes)
    row, piece = visible_polygons(polygon, sides_left, planes, corners, first, cutting)
    size, middle = moments(piece)
    solid = np.flatnonzero(size > 0.0)
    row, size, middle, piece = row[solid], size[solid], middle[solid], pick(piece, solid)
    albedo, printed = _mean_albedo(setup, triangle[row], at[row], piece, middle)
    sides: Float | None = None
    if setup.lighting.shadows is not None:
        # each piece by itself: the middle of those round a corner may lie under what hides it
        sides = rectangles(size, middle, second_moments(piece))
    else:
        area: Float = np.bincount(row, size, len(pixel)).astype(np.float64)
        covered = np.flatnonzero(area > 0.0)
        printed, x, y, *albedos = (
            np.bincount(row, size * values, len(pixel))[covered] / area[covered]
            for values in (printed, *middle.T, *albedo)
        )
        row, size = covered, area[covered]
        middle, albedo = np.stack([x, y], axis=1), np.stack(albedos)
    x, y = (at[row] + view.camera.pixel_side * middle).T
    light = radiance_of(setup, triangle[row], x, y, albedo, printed, sides, shares)
    seen = np.bincount(pixel[row], size, count)
    opened = 1.0 - seen
    result = np.empty((len(setup.bands), count))
    for k, band in enumerate(setup.bands):
        value = np.bincount(pixel[row], size * light[k], count)
        behind = value + opened * band.background
        result[k] = np.where(opened > THIN, behind, value / np.maximum(seen, 1.0 - THIN))
    return result


def _mean_albedo(
    setup: Setup, triangle: Long, at: Float, polygon: Float, centroid: Float
) -> tuple[Float, Float]:
    """Mean albedo (bands, n) of polygons (n, 8, 2) in pixels ``at``, and the share (n,) that is
    printed."""
    side = setup.view.camera.pixel_side
    paint = setup.view.paint[triangle]
    albedo = np.stack([band.table.paints["ground"][paint] for band in setup.bands]).astype(float)
    featured = setup.table.paints["featured"][paint]
    # all of a polygon through the cubic of its pixel
    within = side * np.concatenate([centroid[:, None], polygon], axis=1)
    ideal = _undistorted(setup.view.camera, at, at[:, None] + within)

    def seen(rows: Long) -> tuple[Long, Float, Float, Float]:
        """Cell, place, polygons and weights of some rows, on their paint."""
        records = setup.coefficients.of(triangle[rows])
        middle, w0 = _paint_positions(records, ideal[rows, :1])
        corners, w = _paint_positions(records, ideal[rows, 1:])
        return records.cell, middle[:, 0], corners - middle, w / w0

    rows = np.flatnonzero((featured > 0) & (featured < BITMAP))
    if len(rows):
        footprints = seen(rows)
        for values, band in zip(albedo, setup.bands, strict=True):
            values[rows] = mean_albedo(band.table, paint[rows], *footprints)
    for number in setup.bitmaps.images:
        rows = np.flatnonzero(paint == number)
        footprints = seen(rows)
        for values, band in zip(albedo, setup.bands, strict=True):
            image = band.bitmaps.images[number]
            values[rows] = mean_over_polygons(image, grey(image.ground), *footprints)
    printed = np.zeros(len(paint))
    rows = np.flatnonzero((featured == 1) & setup.traits.shiny[triangle])
    if len(rows):
        printed[rows] = mean_albedo(setup.table.mask(), paint[rows], *seen(rows))
    return albedo, printed


def _undistorted(camera: Camera, pixel: Float, at: Float) -> Float:
    """Ideal positions of image positions (n, V, 2) in pixels (n, 2)."""
    bends = distortion_map(camera)
    if bends is None:
        return at
    owner = np.repeat(pixel.astype(np.int64), at.shape[1], axis=0)
    flat = at.reshape(-1, 2)
    return (flat + bends.evaluate(owner, flat - owner)[0]).reshape(at.shape)


def _paint_positions(records: PerTriangle, pixels: Float) -> tuple[Float, Float]:
    """Paint positions (n, V, 2) of ideal positions (n, V, 2), and 1 / z (n, V) to scale."""
    d, planes = pixels - records.anchor[:, None], records.planes[:, :3]
    values = d @ np.swapaxes(planes[:, :, :2], 1, 2) + planes[:, None, :, 2]
    return values[..., :2] / values[..., 2:], values[..., 2]
