"""The exact mean albedo of a pattern over what a pixel sees of it.

Twin of ``shaders/lib/paint/feature_grid.wgsl``, and of ``polygon_mean.wgsl`` beside it, the polygon
forms that edge pixels take.
"""

from __future__ import annotations

import numpy as np

from gpusim.arrays.array_types import Bool, Float, Int, Long
from gpusim.optics.geometry import polygon_clipping
from gpusim.optics.geometry.pixel_footprint import piece_of_pixel
from gpusim.optics.paint.disc_coverage import grazing_cover, polygon_cover, speckle_cover
from gpusim.optics.paint.feature_grid import FINEST, FeatureGrid

Pixel = tuple[Float, Float, Float]


def mean_albedo(
    table: FeatureGrid,
    paint: Int,
    cell: Long,
    st: Float,
    polygon: Float,
    weight: Float,
    pixel: Pixel | None = None,
    grazing: Bool | None = None,
) -> Float:
    """Mean albedo (n,) over footprints.

    Parameters
    ----------
    paint : (n,) paint index.
    cell : (n, 2) cell that ``st`` (n, 2) is relative to; the pixel looks up the cell of ``st``.
    polygon : (n, V, 2) the footprint relative to ``st``.
    weight : (n, V) 1 / z at its corners relative to that at ``st``. Scaled by it about any point,
        the polygon is an affine picture of what is seen, so that perspective is exact.
    pixel : given where the footprints are whole pixels, which are cut more cheaply: change of
        s, t per column and per row, (n, 2) each, and relative change (n, 2) of 1 / z.
    grazing : (n,) which whole pixels may have larger footprints than a speckle's table is made for.
    """
    records = table.paints[paint]
    albedo = records["ground"].astype(np.float64)
    for number in np.unique(paint[records["featured"] > 1]):
        pieces = np.flatnonzero(paint == number)
        large = None if grazing is None else grazing[pieces]
        albedo[pieces] = _speckle(
            table, int(number), cell[pieces], st[pieces], polygon[pieces], weight[pieces],
            _some(pixel, pieces), large,
        )  # fmt: skip
    size = records["cell"].astype(np.float64)
    step = np.floor(st / size[:, None])
    at = cell + step.astype(np.int64) - np.stack([records["i0"], records["j0"]], axis=1)
    shape = np.stack([records["columns"], records["rows"]], axis=1)
    rows = np.flatnonzero((records["featured"] == 1) & ((at >= 0) & (at < shape)).all(axis=1))
    slot = records["first"][rows] + at[rows, 1] * shape[rows, 0] + at[rows, 0]
    start, stop = table.cell_start[slot].astype(np.int64), table.cell_start[slot + 1]
    local = st[rows] - step[rows] * size[rows, None]
    for k in range(int((stop - start).max(initial=0)) if len(rows) else 0):
        listed = np.flatnonzero(start + k < stop)
        target = rows[listed]
        feature = table.features[start[listed] + k]
        relative = local[listed] - feature[:, 0:2]
        patch = feature[:, 10] == 0.0
        albedo_share = np.zeros(len(listed))
        share = np.zeros(len(listed))
        if patch.any():
            pieces = target[patch]
            footprint = polygon[pieces], weight[pieces], _some(pixel, pieces)
            value, part = _checker(feature[patch], relative[patch], *footprint)
            albedo_share[patch], share[patch] = value, part
        disc = feature[:, 10] == 1.0
        if disc.any():
            part = _disc(feature[disc], relative[disc], polygon[target[disc]])
            albedo_share[disc], share[disc] = part * feature[disc, 8], part
        sector = feature[:, 10] == 2.0
        if sector.any():
            pieces = target[sector]
            footprint = polygon[pieces], weight[pieces], _some(pixel, pieces)
            part = _sector(feature[sector], relative[sector], *footprint)
            albedo_share[sector], share[sector] = part * feature[sector, 8], part
        albedo[target] += albedo_share - records["ground"][target] * share
    return albedo


def _some(pixel: Pixel | None, rows: Long) -> Pixel | None:
    return None if pixel is None else (pixel[0][rows], pixel[1][rows], pixel[2][rows])


def _speckle(
    table: FeatureGrid,
    number: int,
    cell: Long,
    st: Float,
    polygon: Float,
    weight: Float,
    pixel: Pixel | None,
    grazing: Bool | None,
) -> Float:
    record = table.paints[number]
    size, grid = float(record["cell"]), int(table.grid_of_paint[number])
    step = np.floor(st / size)
    at = cell + step.astype(np.int64) - np.array([record["i0"], record["j0"]])
    local = st - step * size
    if pixel is None:
        cover = polygon_cover(table.speckle, grid, at, local, polygon, weight)
    else:
        large = np.zeros(len(at), bool) if grazing is None else grazing
        cover = np.zeros(len(at))
        for footprints, find in ((~large, speckle_cover), (large, grazing_cover)):
            if not footprints.any():
                continue
            ex, ey, q = (values[footprints] for values in pixel)
            cover[footprints] = find(
                table.speckle, grid, at[footprints], local[footprints], ex, ey, q
            )
    ground, dot = float(record["ground"]), float(record["dot"])
    return ground + (dot - ground) * cover


def _disc(feature: Float, centre: Float, polygon: Float) -> Float:
    reach = np.sqrt(np.max(np.sum(polygon**2, axis=-1), axis=-1))
    distance, radius = np.linalg.norm(centre, axis=1), feature[:, 2]
    share: Float = (distance < radius).astype(np.float64)
    near = np.abs(distance - radius) < reach
    if near.any():
        inside = polygon_clipping.disc_area(polygon[near] + centre[near, None], radius[near])
        # about its own middle a polygon's area loses no figures; slivers may have none at all
        area = polygon_clipping.polygon_area(polygon[near])
        known = area != 0.0
        crossed = np.flatnonzero(near)[known]
        share[crossed] = np.clip(inside[known] / area[known], 0.0, 1.0)
    return share


def _divisor(area: Float) -> Float:
    """Areas of polygons to divide by; slivers may have none left after rounding."""
    return np.where(area != 0.0, area, np.inf)


def _sector(
    feature: Float, centre: Float, polygon: Float, weight: Float, pixel: Pixel | None
) -> Float:
    """Share of polygons in sectors of discs with apex at -``centre``.

    Seen from the apex, an edge of the polygon sweeps over an area; the sector's straight sides
    sweep none. So only the parts of the edges between the sides count.
    """
    shifted = polygon + centre[:, None]
    straight = shifted * weight[..., None]
    area = _divisor(polygon_clipping.polygon_area(straight))
    left = np.stack([-feature[:, 5], feature[:, 4]], axis=1)
    right = np.stack([feature[:, 7], -feature[:, 6]], axis=1)
    disc = _disc(feature, centre, polygon)
    sides = []
    for normal in (left, right):
        if pixel is not None:
            d = np.sum(centre * normal, axis=1)
            gx, gy = (
                np.sum(e * normal, axis=1) + d * pixel[2][:, k] for k, e in enumerate(pixel[:2])
            )
            sides.append(polygon_clipping.half_plane_share(d, gx, gy))
            continue
        along = np.sum(straight * normal[:, None], axis=2)
        across = straight[..., 1] * normal[:, :1] - straight[..., 0] * normal[:, 1:]
        sides.append(polygon_clipping.half_plane_area(np.stack([along, across], axis=2)) / area)
    parts = np.clip(np.stack([disc, *sides]), 0.0, 1.0)
    share: Float = parts.prod(axis=0)
    # whole in two of them: the third one's share is the answer
    undecided = (share > 0.0) & ((parts < 1.0 - 1e-9).sum(axis=0) > 1)
    if undecided.any():
        p = shifted[undecided]
        q = np.roll(p, -1, axis=1)
        start, stop = np.zeros(p.shape[:2]), np.ones(p.shape[:2])
        for normal in (left[undecided], right[undecided]):
            a, b = np.sum(p * normal[:, None], axis=2), np.sum(q * normal[:, None], axis=2)
            at = a / np.where(a != b, a - b, 1.0)
            start = np.where(a < 0.0, np.where(b < 0.0, 2.0, np.maximum(start, at)), start)
            stop = np.where((b < 0.0) & (a >= 0.0), np.minimum(stop, at), stop)
        stop = np.maximum(start, stop)
        u, v = p + start[..., None] * (q - p), p + stop[..., None] * (q - p)
        swept = polygon_clipping.swept_area(u, v, feature[undecided, 2])
        share[undecided] = np.clip(swept / _divisor(polygon_clipping.polygon_area(p)), 0.0, 1.0)
    return share


def _checker(
    feature: Float, centre: Float, polygon: Float, weight: Float, pixel: Pixel | None
) -> tuple[Float, Float]:
    cos, sin = feature[:, 2], feature[:, 3]

    def turn(p: Float, c: Float, s: Float) -> Float:
        return np.stack([c * p[..., 0] + s * p[..., 1], c * p[..., 1] - s * p[..., 0]], axis=-1)

    centre = turn(centre, cos, sin)
    size = feature[:, 4:6]
    if pixel is None:
        polygon = turn(polygon, cos[:, None], sin[:, None])
        return _squares(feature, polygon + centre[:, None], weight)
    ex, ey, q = turn(pixel[0], cos, sin), turn(pixel[1], cos, sin), pixel[2]
    pieces = np.ceil(np.max((np.abs(ex) + np.abs(ey)) / size, axis=1))
    fine = pieces > FINEST
    if fine.any():
        feature, centre = feature.copy(), centre.copy()
        feature[fine], shift = _as_one_square(feature[fine])
        centre[fine] += shift
    pieces = np.where(fine, 1, np.maximum(pieces, 1))
    value, share = np.zeros(len(feature)), np.zeros(len(feature))
    for n in np.unique(pieces).astype(int):
        rows = np.flatnonzero(pieces == n)
        for j in range(n):
            for i in range(n):
                x, y = (i + 0.5) / n - 0.5, (j + 0.5) / n - 0.5
                w, move, along, across = piece_of_pixel(ex[rows], ey[rows], q[rows], (x, y), (n, n))
                part = _corner(feature[rows], centre[rows] + move, along, across, w / n * q[rows])
                value[rows] += part[0] / n**2
                share[rows] += part[1] / n**2
    return value, share


def _as_one_square(feature: Float) -> tuple[Float, Float]:
    """Patches as one square of their mean albedo, and the shift to their first corner."""
    result = feature.copy()
    shift = feature[:, 12:14] * feature[:, 4:6]
    result[:, 4:6] = feature[:, 4:6] * feature[:, 6:8]
    result[:, 6:8] = 1.0
    result[:, 8] = 0.5 * (feature[:, 8] + feature[:, 9])
    result[:, 12:14] = 0.0
    return result, shift


def _squares(feature: Float, polygon: Float, weight: Float) -> tuple[Float, Float]:
    """Patches over any convex polygons (patch axes), square by square."""
    spans = (polygon.max(axis=1) - polygon.min(axis=1)) / feature[:, 4:6]
    fine = spans.max(axis=1) > FINEST
    if fine.any():
        feature, polygon = feature.copy(), polygon.copy()
        feature[fine], shift = _as_one_square(feature[fine])
        polygon[fine] += shift[:, None]
    size, index = feature[:, 4:6], feature[:, 12:14]
    first = np.maximum(np.floor(polygon.min(axis=1) / size), -index)
    last = np.minimum(np.floor(polygon.max(axis=1) / size), feature[:, 6:8] - index - 1.0)
    value, total = np.zeros(len(feature)), np.zeros(len(feature))
    count = np.maximum(last - first + 1.0, 0.0).astype(int)
    most = count.max(axis=0, initial=0)
    for j in range(int(most[1])):
        for i in range(int(most[0])):
            rows = np.flatnonzero((count[:, 0] > i) & (count[:, 1] > j))
            square = first[rows] + [i, j]
            share = np.zeros(len(rows))
            for di, dj, sign in ((0, 0, 1.0), (1, 0, -1.0), (0, 1, -1.0), (1, 1, 1.0)):
                corner = (square + np.array([di, dj])) * size[rows]
                seen = (polygon[rows] - corner[:, None]) * weight[rows][..., None]
                area = _divisor(polygon_clipping.polygon_area(seen))
                share += sign * polygon_clipping.quadrant_area(seen) / area
            even = (square + index[rows]).sum(axis=1) % 2 == 0
            value[rows] += share * np.where(even, feature[rows, 8], feature[rows, 9])
            total[rows] += share
    return value, total


def _corner(feature: Float, centre: Float, ex: Float, ey: Float, q: Float) -> tuple[Float, Float]:
    """Albedo * share and share of the squares around the lattice corner nearest to ``centre``.

    A line of the pattern at distance d from the centre is straight on screen, with gradient
    e + d q.
    """
    size, index = feature[:, 4:6], feature[:, 12:14]
    corner = np.clip(np.rint(centre / size), -index, feature[:, 6:8] - index)
    d = centre - corner * size
    ex, ey = ex + d * q[:, :1], ey + d * q[:, 1:]
    corners = np.stack([-ex - ey, ex - ey, ex + ey, ey - ex], axis=1) * 0.5
    shifted = corners + d[:, None]
    area = polygon_clipping.polygon_area(shifted)
    right = polygon_clipping.half_plane_area(shifted) / area
    swapped = shifted[..., ::-1]
    above = polygon_clipping.half_plane_area(swapped) / -area
    both = polygon_clipping.quadrant_area(shifted) / area
    shares = np.stack([both, right - both, above - both, 1.0 - right - above + both], axis=1)
    corner = corner + index
    i = corner[:, :1] - np.array([0.0, 0.0, 1.0, 1.0])
    j = corner[:, 1:] - np.array([0.0, 1.0, 0.0, 1.0])
    inside = (i >= 0) & (i < feature[:, 6:7]) & (j >= 0) & (j < feature[:, 7:8])
    albedo = np.where((i + j) % 2 == 0, feature[:, 8:9], feature[:, 9:10])
    share = np.where(inside, shares, 0.0)
    return np.sum(albedo * share, axis=1), np.sum(share, axis=1)
