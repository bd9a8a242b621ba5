"""Pieces of edge pixels in NumPy: what shows of each triangle, its paint's mean, its light.

The float64 form of what ``shaders/optics/edge_pixels/resolve.wgsl`` does; the host resolves those
pixels by it that the device leaves.

Where the outline of a fine mesh crosses a pixel before a wall, what is left of the wall has as many
sides as there are triangles along it, and would be cut by one after the other. But the area, the
centroid and the second moments of what is left are those of the pixel less those of what is seen of
the triangles in front; plain paint and light don't ask for more. That holds as long as its shadows
don't end where it does: what stands on the wall is followed piece by piece.
"""

from __future__ import annotations

import numpy as np

from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.camera.undistortion_table import distortion_map
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
from gpusim.optics.geometry.triangle_corners import corner_range
from gpusim.optics.geometry.view import FIXED, View
from gpusim.optics.paint.bitmap import BITMAP, mean_over_polygons
from gpusim.optics.paint.footprint_mean import mean_albedo
from gpusim.optics.shading.coefficients import PerTriangle
from gpusim.optics.shading.lighting import SharesOf
from gpusim.optics.shading.radiance import radiance_of
from gpusim.optics.shading.setup import Setup
from gpusim.surface.color import grey

CONTACT = 8.0
"""Pixels' sides, at its depth, from a backdrop to what is before it, where lamps cast shadows."""

SEVERAL = 6
"""Triangles before it that are worth it where lamps cast shadows: what is left beside fewer may be
in pieces apart from each other, as beside a thin bar, and a shadow end in one of them."""

PIXEL = (1.0, 0.0, 0.0, 1.0 / 12.0, 0.0, 1.0 / 12.0)
"""Area, first and second moments."""


def fills(planes: Float) -> Bool:
    """(n,) which triangles fill their pixel, by their half planes (n, 3, 3) from its centre."""
    least = planes[..., 2] - 0.5 * (np.abs(planes[..., 0]) + np.abs(planes[..., 1]))
    return np.asarray(np.all(least >= 0.0, axis=1))


def backdrops(setup: Setup, edges: EdgePixels, full: Bool, corners: Float) -> Bool:
    """(n,) which of the triangles over edge pixels are such: those of ``full`` ones (n,), which
    fill their pixel, with ``corners`` (n, 3, 2) relative to its centre."""
    count, depth = len(edges.pixel), edges.depth
    result = np.zeros(len(full), bool)
    pixel = np.repeat(np.arange(count), depth)
    row = np.flatnonzero(full)
    # the nearest that fills each pixel, behind others
    row = row[np.flatnonzero(np.diff(pixel[row], prepend=-1))]
    pixel_of = pixel[row]
    suits = (row > edges.start[pixel_of]) & ~edges.pierced[pixel_of]
    triangle = edges.triangle[: len(full)]
    suits &= (setup.traits.groups[triangle[row]] == 0) & ~setup.traits.bumpy[triangle[row]]
    row, pixel_of = row[suits], pixel_of[suits]
    if setup.lighting.shadows is not None and len(row):
        several = row - edges.start[pixel_of] >= SEVERAL
        row, pixel_of = row[several], pixel_of[several]
        last = np.full(count, -1)
        last[pixel_of] = row
        front = np.flatnonzero(np.arange(len(full)) < last[pixel])
        farthest = np.full(count, np.inf)
        inverse = corner_range(setup.view.inverse_depth(triangle[front]))[0]
        np.minimum.at(farthest, pixel[front], inverse)
        a, b, c = depth_planes(corners[row], setup.view.inverse_depth(triangle[row])).T
        nearest = 1.0 / (c + 0.5 * (np.abs(a) + np.abs(b)))
        side = float(np.linalg.norm(setup.view.rays()[:, 0]))
        gap = nearest - 1.0 / farthest[pixel_of]
        row = row[gap > CONTACT * side * nearest]
    result[row] = True
    return result


def left_open(
    number: Long, count: int, size: Float, middle: Float, second: Float
) -> tuple[Float, Float, Float]:
    """What pieces leave of ``count`` pixels: area (m,), centroid (m, 2) and second moments (m, 3)
    about the pixel's centre, of which pieces have ``size`` (n,), ``middle`` (n, 2) and ``second``
    (n, 3). ``number`` (n,): the pixel of each piece, -1 for none."""
    inside = np.flatnonzero(number >= 0)
    values = np.column_stack([size, size[:, None] * middle, second])[inside]
    rest = np.stack([
        total - np.bincount(number[inside], column, count)
        for total, column in zip(PIXEL, values.T, strict=True)
    ], axis=1)  # fmt: skip
    area = np.maximum(rest[:, 0], 0.0)
    return area, rest[:, 1:3] / np.where(area > 0.0, area, 1.0)[:, None], rest[:, 3:]


THIN = 5e-4
"""Area, px^2, that no triangle takes; less of it is a seam between neighbours."""


def corners_over(
    view: View, edges: EdgePixels, rows: Long | None = None
) -> tuple[Long, Float, Float]:
    """Of triangles over edge pixels, or some ``rows`` of them: the pixel (n,) of each, where that
    is (n, 2), and the corners (n, 3, 2) from there, in sides of its sensitive square."""
    width = view.camera.width
    pixel = np.repeat(np.arange(len(edges.pixel)), edges.depth)
    triangle = edges.triangle[: len(pixel)]
    if rows is not None:
        pixel, triangle = pixel[rows], triangle[rows]
    number = edges.pixel[pixel]
    at = np.stack([number % width, number // width], axis=1).astype(np.float64)
    corners = np.rint(view.screen_of(triangle) * FIXED) / FIXED
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
    pixel, at, corners = corners_over(view, edges)
    first = np.repeat(edges.start[:-1], edges.depth)
    triangle = edges.triangle[: len(pixel)]
    planes = half_planes(corners)
    cutting = _cutting(view, edges, pixel, at) if edges.pierced.any() else None
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
        gaps = left_open(number[pixel[row]], len(wall), size, middle, second)
        open_ = np.flatnonzero(gaps[0] > SLIVER)
        wall = wall[open_]
        row = np.concatenate([row, wall])
        size, middle, second = (
            np.concatenate([of_pieces, of_gaps[open_]])
            for of_pieces, of_gaps in zip((size, middle, second), gaps, strict=True)
        )
        piece = np.concatenate([piece, pick(polygon, wall)])
    albedo, printed = _mean_albedo(setup, triangle[row], at[row], piece, middle)
    sides: Float | None = None
    if shadowed:
        # each piece by itself: the middle of those round a corner may lie under what hides it
        sides = rectangles(size, middle, second)
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
