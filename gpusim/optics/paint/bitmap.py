"""The mean of a bitmap's spline surface over what a pixel sees of it.

Twin of ``shaders/lib/paint/bitmap.wgsl``. Positions are in texels from the bitmap's upper left
corner. A footprint of about a texel is cut into parallelograms; over each, the surface is
integrated in closed form over the axis-parallel rectangle of equal second moments, and the mixed
moment enters through the mixed derivative. That is exact for footprints along the texels' axes;
others are cut finer the farther they are turned. Where that takes more than 16 pieces, every
coefficient is weighed by the footprint's sides instead, on a coarser level from 32 texels on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float, Int, Long, Single
from gpusim.optics.geometry import polygon_clipping
from gpusim.optics.geometry.pixel_footprint import RegionPaint, piece_of_pixel
from gpusim.surface.bitmap import MARGIN, Image, Level

BITMAP = 4
"""Value of a paint record's ``featured`` for bitmaps."""
WIDEST = 2.9
"""Cells of a level that one piece of a footprint may span."""
NARROWEST = 1.0 / 32.0
"""Cells below which a piece is widened: in float32 the integral over less would be rounding."""
TURNED = 0.1
"""Largest width^4 (cells) x sin^2 of twice the turn of a piece: 1e-3 of white noise is off."""
PIECES = 16
POLYGON, CUTS = 1.2, 8
"""Texels that a triangle of a clipped polygon may span before it is cut, and into how many parts a
side: larger ones are weighed by their sides."""
WINDOW = 32.0
"""Cells that a footprint may span before the next coarser level is taken."""
TINY = 1e-6
"""Smallest weight of a mean."""
ALIGNMENT = 4096
"""Texels of the device's texture in a row; every level starts a row."""


@dataclass(frozen=True, eq=False)
class BitmapTable:
    """The bitmaps of a view, by number of the paint, and where the levels lie on the device.

    ``bands``: the same of each band of the spectrum, if there are several.
    """

    images: dict[int, Image]
    bands: tuple[BitmapTable, ...] = ()

    @staticmethod
    def build(regions: Sequence[RegionPaint], paints: npt.NDArray[np.void]) -> BitmapTable:
        """Find the bitmaps, and mark their records in ``paints``."""
        images = {k: r.paint for k, r in enumerate(regions) if isinstance(r.paint, Image)}
        header = 0
        for number, image in images.items():
            record = paints[number]
            record["featured"], record["cell"], record["first"] = BITMAP, 1.0, header
            record["rows"], record["columns"] = image.pixels.shape
            record["i0"] = len(image.levels) - 1
            header += len(image.levels)
        return BitmapTable(images)

    def texel_positions(self, paint: Int, st: Float) -> Float:
        """Paint coordinates (n, …, 2), of bitmap regions turned into texels."""
        for number, image in self.images.items():
            rows = paint == number
            st = st.copy()
            st[rows] = image.texel_position(st[rows])
        return st

    def texels(self) -> Single:
        """(n, 4) float32: per level (first row, texels a row, texels a band, -), then the
        coefficients.

        A level's coefficients lie four to a texel, row by row, one band after the other.
        """
        each = [
            [level for image in table.images.values() for level in image.levels]
            for table in self.bands or (self,)
        ]
        levels = each[0]
        width = [-(-level.coefficients.shape[1] // 4) for level in levels]
        need = [w * level.coefficients.shape[0] for w, level in zip(width, levels, strict=True)]
        rows = [-(-len(levels) // ALIGNMENT), *(-(-len(each) * n // ALIGNMENT) for n in need)]
        first = np.cumsum(rows)
        table = np.zeros((max(int(first[-1]), 1) * ALIGNMENT, 4), np.float32)
        for k, level in enumerate(levels):
            table[k, :3] = first[k], width[k], need[k]
            wide = np.zeros((level.coefficients.shape[0], 4 * width[k]), np.float32)
            start = int(first[k]) * ALIGNMENT
            for band in each:
                wide[:, : level.coefficients.shape[1]] = band[k].coefficients
                table[start : start + need[k]] = wide.reshape(-1, 4)
                start += need[k]
        return table


def pieces_needed(ex: Float, ey: Float) -> float:
    """The largest number of pieces that any of the footprints (n, 2) takes, not rounded up."""
    turn = np.maximum(_turn(ex), _turn(ey))
    width = np.minimum(WIDEST, np.sqrt(np.sqrt(TURNED / np.maximum(turn, 1e-8))))
    sides = [np.maximum(np.linalg.norm(e, axis=1) / width, 1.0) for e in (ex, ey)]
    return float((sides[0] * sides[1]).max(initial=0.0))


def mean_over_pixels(
    image: Image, ground: float, cell: Long, at: Float, ex: Float, ey: Float, q: Float
) -> Float:
    """Mean albedo (n,) over whole pixels.

    Parameters
    ----------
    cell, at : (n, 2) texel position of the pixels' centres, as a whole number and the rest.
    ex, ey : (n, 2) its change per column and per row.
    q : (n, 2) relative change of 1 / z per column and row.
    """
    turn = np.maximum(_turn(ex), _turn(ey))
    width = np.minimum(WIDEST, np.sqrt(np.sqrt(TURNED / np.maximum(turn, 1e-8))))
    nx, ny = (_pieces(np.linalg.norm(e, axis=1) / width) for e in (ex, ey))
    wide = nx * ny > PIECES
    value = np.zeros(len(at))
    for key in np.unique(np.stack([nx, ny], axis=1)[~wide], axis=0):
        rows = np.flatnonzero(~wide & (nx == key[0]) & (ny == key[1]))
        value[rows] = _in_pieces(
            image, key.tolist(), cell[rows], at[rows], ex[rows], ey[rows], q[rows]
        )
    rows = np.flatnonzero(wide)
    if len(rows):
        corners = _parallelogram(ex[rows], ey[rows])
        bend = (ex[rows] * q[rows, :1] + ey[rows] * q[rows, 1:]) / 12.0
        value[rows] = _in_window(image, cell[rows], at[rows] - bend, corners)
    seen = np.clip(value, 0.0, 1.0)  # where the spline swings over, black or white
    return ground + (seen - ground) * _share_of_pixel(image, cell, at, ex, ey)


def mean_over_polygons(
    image: Image, ground: float, cell: Long, at: Float, polygon: Float, weight: Float
) -> Float:
    """Mean albedo (n,) over convex polygons (n, V, 2) in texels relative to ``cell`` + ``at``.

    ``weight`` (n, V) is 1 / z at the corners relative to that at ``at``.
    """
    extent = np.max(polygon.max(axis=1) - polygon.min(axis=1), axis=1)
    value = np.zeros(len(at))
    wide = extent > POLYGON * CUTS
    for rows, method in (
        (np.flatnonzero(~wide), _in_triangles),
        (np.flatnonzero(wide), _in_window),
    ):
        if len(rows):
            value[rows] = method(image, cell[rows], at[rows], polygon[rows])
    share = np.zeros(len(at))
    size = np.array([image.pixels.shape[1], image.pixels.shape[0]])
    for i, j, sign in ((0, 0, 1.0), (1, 0, -1.0), (0, 1, -1.0), (1, 1, 1.0)):
        corner = [i, j] * size - cell - at
        seen = (polygon - corner[:, None]) * weight[..., None]
        area = polygon_clipping.polygon_area(seen)
        share += sign * polygon_clipping.quadrant_area(seen) / np.where(area != 0.0, area, 1.0)
    result: Float = ground + (np.clip(value, 0.0, 1.0) - ground) * np.clip(share, 0.0, 1.0)
    return result


def _in_pieces(
    image: Image, count: list[int], cell: Long, at: Float, ex: Float, ey: Float, q: Float
) -> Float:
    """Mean over parallelograms cut into ``count`` (columns, rows) pieces."""
    nx, ny = count
    total, weight = np.zeros(len(at)), np.zeros(len(at))
    for j in range(ny):
        for i in range(nx):
            x, y = (i + 0.5) / nx - 0.5, (j + 0.5) / ny - 0.5
            _, move, fx, fy = piece_of_pixel(ex, ey, q, (x, y), (nx, ny))
            bend = (fx * q[:, :1] / nx + fy * q[:, 1:] / ny) / 12.0
            square = fx**2 + fy**2
            mixed = (fx[:, 0] * fx[:, 1] + fy[:, 0] * fy[:, 1]) / 12.0
            part = _piece(image.levels[0], cell, at + move - bend, square, mixed)
            total += part[0]
            weight += part[1]
    return total / np.maximum(weight, TINY)


def _in_triangles(image: Image, cell: Long, at: Float, polygon: Float) -> Float:
    """Mean over polygons, by the triangles of a fan, each cut into equal smaller ones."""
    total, area = np.zeros(len(at)), np.zeros(len(at))
    first = polygon[:, 0]
    for k in range(1, polygon.shape[1] - 1):
        a, b = polygon[:, k] - first, polygon[:, k + 1] - first
        twice_area = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
        reach = np.max(np.maximum(np.maximum(np.abs(a), np.abs(b)), np.abs(a - b)), axis=1)
        cuts = np.maximum(np.ceil(reach / POLYGON), 1.0).astype(np.int64)
        arm = np.stack([a + b, b - 2.0 * a, a - 2.0 * b], axis=1) / (3.0 * cuts[:, None, None])
        square, mixed = np.sum(arm**2, axis=1), np.sum(arm[..., 0] * arm[..., 1], axis=1) / 12.0
        for n in np.unique(cuts):
            rows = np.flatnonzero((cuts == n) & (twice_area > 0.0))
            for i, j, third in _small_triangles(int(n)):
                place = ((i + third) * a[rows] + (j + third) * b[rows]) / n
                value, weight = _piece(
                    image.levels[0], cell[rows], at[rows] + first[rows] + place, square[rows],
                    mixed[rows],
                )  # fmt: skip
                total[rows] += twice_area[rows] / n**2 * value
                area[rows] += twice_area[rows] / n**2 * weight
    return total / np.maximum(area, TINY)


def _small_triangles(n: int) -> list[tuple[int, int, float]]:
    """Where the n^2 parts of a triangle lie: column, row, and 1/3 if upright, 2/3 if not."""
    upright = [(i, j, 1.0 / 3.0) for j in range(n) for i in range(n - j)]
    return upright + [(i, j, 2.0 / 3.0) for j in range(n) for i in range(n - j - 1)]


def _in_window(image: Image, cell: Long, at: Float, polygon: Float) -> Float:
    """Mean over convex polygons (n, V, 2) about ``cell`` + ``at`` that span many texels.

    A coefficient's weight is the integral of its spline over the polygon, taken as the product over
    the polygon's sides of the spline's integral up to the side: the spline's profile is nearly the
    same in all directions.
    """
    low, high = polygon.min(axis=1), polygon.max(axis=1)
    extent = np.max(high - low, axis=1)
    number = np.maximum(np.ceil(np.log2(np.maximum(extent / WINDOW, 1e-9))), 0.0).astype(np.int64)
    number = np.minimum(number, len(image.levels) - 1)
    value = np.zeros(len(at))
    twice = polygon_clipping.polygon_area(polygon)
    for k in np.unique(number):
        rows = np.flatnonzero(number == k)
        level, scale = image.levels[k], 0.5 ** int(k)
        base = cell[rows] >> k
        p = _on_level(level, base, (at[rows] + (cell[rows] - (base << k))) * scale)
        first = np.maximum(np.floor(p + low[rows] * scale).astype(np.int64) - 2, -base - MARGIN)
        last = np.floor(p + high[rows] * scale).astype(np.int64) + 3
        size = np.array([level.columns, level.rows]) + MARGIN - 1
        last = np.minimum(last, size - base)
        corners = polygon[rows] * scale
        side = np.roll(corners, -1, axis=1) - corners
        length = np.sqrt(np.sum(side**2, axis=2))
        normal = np.stack([-side[..., 1], side[..., 0]], axis=2)
        normal /= np.where(length > 0.0, length * np.sign(twice[rows])[:, None], 1.0)[..., None]
        inner = np.sum(normal * (p[:, None] + corners), axis=2)
        border = -base - 0.5, np.array([level.columns, level.rows]) - base - 0.5
        flat = level.coefficients.reshape(-1)
        total, weights = np.zeros(len(rows)), np.zeros(len(rows))
        many = np.maximum(last - first + 1, 0).max(axis=0, initial=0)
        for j in range(int(many[1])):
            for i in range(int(many[0])):
                polygons = np.flatnonzero(
                    (first[:, 0] + i <= last[:, 0]) & (first[:, 1] + j <= last[:, 1])
                )
                place = first[polygons] + [i, j]
                depth = (
                    np.einsum("nvk,nk->nv", normal[polygons], place.astype(np.float64))
                    - inner[polygons]
                )
                weight = np.where(length[polygons] > 0.0, cumulative(depth), 1.0).prod(axis=1)
                for depth in (place - border[0][polygons], border[1][polygons] - place):
                    weight *= cumulative(depth.astype(np.float64)).prod(axis=1)
                at_level = place + base[polygons] + MARGIN
                at_flat = at_level[:, 1] * level.coefficients.shape[1] + at_level[:, 0]
                total[polygons] += weight * flat[at_flat]
                weights[polygons] += weight
        value[rows] = total / np.maximum(weights, TINY)
    return value


def _parallelogram(ex: Float, ey: Float) -> Float:
    return np.stack([-ex - ey, ex - ey, ex + ey, ey - ex], axis=1) * 0.5


def _turn(e: Float) -> Float:
    """Squared sine of twice the angle between vectors (n, 2) and the nearest axis."""
    square = np.sum(e * e, axis=1)
    sine = 2.0 * e[:, 0] * e[:, 1] / np.where(square > 0.0, square, 1.0)
    result: Float = sine * sine
    return result


def _pieces(reach: Float) -> Long:
    result: Long = np.maximum(np.ceil(np.minimum(reach, 1e6)), 1.0).astype(np.int64)
    return result


def _on_level(level: Level, base: Long, p: Float) -> Float:
    """Positions (n, 2) from ``base`` relative to the coefficients, kept near the bitmap.

    Mirrored as it is, the surface beyond the border is much like the nearest place on it.
    """
    limit = np.array([level.columns, level.rows]) - base
    result: Float = np.clip(p, -base - 1.0, limit + 1.0) - 0.5
    return result


def _share_of_pixel(image: Image, cell: Long, at: Float, ex: Float, ey: Float) -> Float:
    """Share of pixels that lies on the bitmap; at its corners the product of both sides' shares."""
    share = np.ones(len(at))
    for axis, length in ((0, image.pixels.shape[1]), (1, image.pixels.shape[0])):
        low = at[:, axis] + cell[:, axis]
        high = length - cell[:, axis] - at[:, axis]
        inside = polygon_clipping.half_plane_share(low, ex[:, axis], ey[:, axis])
        inside = inside + polygon_clipping.half_plane_share(high, ex[:, axis], ey[:, axis]) - 1.0
        share = share * np.maximum(inside, 0.0)
    return share


def _piece(level: Level, cell: Long, at: Float, square: Float, mixed: Float) -> tuple[Float, Float]:
    """Integral (n,) of level 0 over pieces at ``cell`` + ``at`` (texels), each of area 1 if it lies
    on the bitmap, and the area that does.

    ``square`` (n, 2): twelve times the variances along both axes; ``mixed`` (n,): the covariance.
    """
    p = _on_level(level, cell, at)
    width = np.clip(np.sqrt(square), NARROWEST, WIDEST)
    border = -cell - 0.5, np.array([level.columns, level.rows]) - cell - 0.5
    # what only just misses the border takes the bitmap's value there
    low = np.clip(p - 0.5 * width, border[0], border[1] - NARROWEST)
    high = np.clip(p + 0.5 * width, border[0] + NARROWEST, border[1])
    first = np.floor(low).astype(np.int64) - 2
    count = int((np.floor(high).astype(np.int64) + 4 - first).max(initial=0))
    taps = []
    for axis in (0, 1):
        place = first[:, axis, None] + np.arange(count)
        stop, start, w = (a[:, axis, None] for a in (high, low, width))
        mean = (cumulative(stop - place) - cumulative(start - place)) / w
        slope = (quintic(stop - place) - quintic(start - place)) / w
        taps.append((mean, slope))
    # beyond the taps of their own, short pieces meet zeros: any coefficient will do there
    texel = first + cell + MARGIN
    flat = level.coefficients.reshape(-1)
    rows, columns = level.coefficients.shape
    total = np.zeros(len(at))
    for j in range(count):
        along, bent = np.zeros(len(at)), np.zeros(len(at))
        start = np.minimum(texel[:, 1] + j, rows - 1) * columns
        for i in range(count):
            value = flat[start + np.minimum(texel[:, 0] + i, columns - 1)]
            along += taps[0][0][:, i] * value
            bent += taps[0][1][:, i] * value
        total += taps[1][0][:, j] * along + mixed * taps[1][1][:, j] * bent
    return total, ((high - low) / width).prod(axis=1)


def cumulative(y: Float) -> Float:
    """Integral of the quintic B-spline from -3 to y."""
    z = 3.0 - np.minimum(np.abs(y), 3.0)
    a, b = np.maximum(z - 1.0, 0.0), np.maximum(z - 2.0, 0.0)
    tail = (z**6 - 6.0 * a**6 + 15.0 * b**6) / 720.0
    result: Float = np.where(y > 0.0, 1.0 - tail, tail)
    return result


def quintic(y: Float) -> Float:
    """The quintic B-spline."""
    z = 3.0 - np.minimum(np.abs(y), 3.0)
    a, b = np.maximum(z - 1.0, 0.0), np.maximum(z - 2.0, 0.0)
    result: Float = (z**5 - 6.0 * a**5 + 15.0 * b**5) / 120.0
    return result
