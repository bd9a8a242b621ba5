"""Chessboard corners to a thousandth of a pixel: all crossings of an image fitted at once.

The model is that of `gpusim.measure.cross`: two straight borders, integrated over the pixels and
blurred by the lens, under a light that varies linearly. A corner of a board has no ends to find
but neighbours that give its two directions, also under strong perspective. The true image and the
model are both symmetric about the corner, so that what the model leaves out (the few pixels that
both borders cross) doesn't move it. ``cv2.cornerSubPix`` is off by 0.035-0.08 px on perfect images.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.measure.border import profile_and_slopes, slope_by_turn
from gpusim.measure.images import FloatArray, check_image, check_points
from gpusim.measure.levenberg import fit_many

__all__ = ["Crossings", "fit_crossings"]

CENTRE = 1.5  # px: both borders within this distance: the pixel isn't used
INSIDE = 0.62  # of the way to the next corner
LEAST_REACH, MOST_REACH = 3.0, 12.0  # px
MIN_SIGMA, FIRST_SIGMA, MOST_SIGMA = 0.004, 0.5, 6.0  # px
MOST_DRIFT = 3.0  # px from the start
MIN_CONTRAST = 0.02  # of the image's grey range
MOST_RESIDUAL = 0.25  # of the contrast
# the last parameter is the logarithm of the blur: it can't change its sign, and far below a pixel,
# where it changes next to nothing, its steps needn't become small
SCALE = np.array([1.0, 1.0, 0.1, 0.1, 1.0, 1.0, 0.1, 0.1, 100.0])


@dataclass(frozen=True)
class Crossings:
    """C fitted corners; rows that weren't fitted are NaN.

    Attributes
    ----------
    points : (C, 2) float64, x, y in px.
    sigma : (C,) float64, standard uncertainty of a coordinate from the fit's own residuals, px.
    contrast : (C,) float64, half the step in grey levels, positive if the quadrant between the
        first and the second direction is bright.
    blur : (C,) float64, width of the lens blur, px.
    residual : (C,) float64, RMS of the fit over the contrast.
    ok : (C,) bool.
    """

    points: FloatArray
    sigma: FloatArray
    contrast: FloatArray
    blur: FloatArray
    residual: FloatArray
    ok: npt.NDArray[np.bool_]


def fit_crossings(
    image: npt.NDArray[Any],
    start: npt.ArrayLike,
    first: npt.ArrayLike,
    second: npt.ArrayLike,
    *,
    share: npt.ArrayLike = INSIDE,
) -> Crossings:
    """Fit the corners near ``start`` (C, 2).

    ``first`` and ``second`` (C, 2) are the steps in px to the next corner along the two borders;
    turning from the first to the second is turning from +x to +y (down). The fit looks at most
    12 px and ``share`` (a number, or (C,)) of these steps far.

    Raises
    ------
    InputError
        Not a grey image, or points and steps of other shapes than (C, 2).
    """
    array = check_image(image, "image")
    points = check_points(start, "start")
    steps = np.stack([check_points(first, "first"), check_points(second, "second")], axis=1)
    if steps.shape != (len(points), 2, 2):
        raise InputError(f"fit_crossings: got {len(points)} points and {len(steps)} steps")
    inside = np.broadcast_to(np.asarray(share, dtype=np.float64), (len(points),))
    if not ((inside > 0) & (inside <= 2)).all():
        raise InputError(f"fit_crossings: share; got {share!r}; expected above 0, at most 2")
    span = float(array.max()) - float(array.min())
    rounds = [points, points]
    result = _failed(len(points))
    if not span > 0:
        return result
    for _ in range(2):  # the window is set again around the first result
        result = _fit(array, rounds[-1], steps, inside, span)
        rounds.append(np.where(result.ok[:, None], result.points, rounds[-1]))
    drift = np.linalg.norm(result.points - points, axis=1)
    return _kept(result, result.ok & (drift <= 2 * MOST_DRIFT))


def _fit(
    array: npt.NDArray[Any],
    start: FloatArray,
    steps: FloatArray,
    inside: FloatArray,
    span: float,
) -> Crossings:
    x, y, grey, weight, middle = _windows(array, start, steps, inside)
    usable = (weight.sum(axis=1) >= 24) & (np.abs(np.linalg.det(steps)) > 4.0)
    rows = np.flatnonzero(usable)
    if not rows.size:
        return _failed(len(start))
    grey /= span
    p0 = _first(x, y, grey, weight, start - middle, steps)

    def model(p: FloatArray, which: npt.NDArray[np.int64]) -> tuple[FloatArray, FloatArray]:
        at = rows[which]
        return _residual(p, x[at], y[at], grey[at])

    fit = fit_many(model, p0[rows], weight[rows], SCALE, tolerance=1e-5, iterations=100)
    p = np.full((len(start), 9), np.nan)
    p[rows] = fit.parameters
    rms, sigma = np.full(len(start), np.nan), np.full(len(start), np.nan)
    rms[rows] = fit.rms
    variance = 0.5 * (fit.covariance[:, 0, 0] + fit.covariance[:, 1, 1])
    sigma[rows] = np.sqrt(np.maximum(variance, 0.0))
    settled = np.zeros(len(start), dtype=bool)
    settled[rows] = fit.converged
    contrast, blur = p[:, 5], np.exp(np.minimum(p[:, 8], np.log(10.0 * MOST_SIGMA)))
    place = p[:, :2] + middle
    with np.errstate(invalid="ignore"):
        residual = rms / np.abs(contrast)
        drift = np.linalg.norm(place - start, axis=1)
        ok = (
            settled
            & (np.abs(contrast) >= 0.5 * MIN_CONTRAST)
            & (residual <= MOST_RESIDUAL)
            & (blur <= MOST_SIGMA)
            & (drift <= MOST_DRIFT)
        )
    found = Crossings(place, sigma, contrast * span, blur, residual, ok)
    return _kept(found, ok)


def _windows(
    array: npt.NDArray[Any], start: FloatArray, steps: FloatArray, share: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Pixels around each corner: x, y from the window's middle, grey, weight (C, P); middle."""
    length = (share * np.linalg.norm(steps, axis=2).max(axis=1)).max(initial=0.0)
    radius = int(np.ceil(np.clip(length, LEAST_REACH, MOST_REACH)))
    middle = np.rint(start)
    offset = np.arange(-radius, radius + 1.0)
    y, x = (axis.ravel() for axis in np.meshgrid(offset, offset, indexing="ij"))
    columns = (middle[:, :1] + x).astype(np.int64)
    lines = (middle[:, 1:] + y).astype(np.int64)
    height, width = array.shape
    inside = (columns >= 0) & (columns < width) & (lines >= 0) & (lines < height)
    grey = array[np.clip(lines, 0, height - 1), np.clip(columns, 0, width - 1)].astype(np.float64)
    # where a pixel lies in steps to the next corners
    from_corner = np.stack(np.broadcast_arrays(x, y), axis=-1) - (start - middle)[:, None, :]
    determinant = np.linalg.det(steps)
    safe = np.where(np.abs(determinant) > 1e-9, determinant, 1.0)
    u = from_corner[..., 0] * steps[:, None, 1, 1] - from_corner[..., 1] * steps[:, None, 1, 0]
    v = from_corner[..., 1] * steps[:, None, 0, 0] - from_corner[..., 0] * steps[:, None, 0, 1]
    u, v = u / safe[:, None], v / safe[:, None]
    far = np.linalg.norm(from_corner, axis=2)
    off_1 = np.abs(v * safe[:, None]) / np.linalg.norm(steps[:, None, 0], axis=2)
    off_2 = np.abs(u * safe[:, None]) / np.linalg.norm(steps[:, None, 1], axis=2)
    reach = share[:, None]
    use = inside & (np.abs(u) <= reach) & (np.abs(v) <= reach) & (far <= radius + 0.5)
    use &= ~((off_1 < CENTRE) & (off_2 < CENTRE))
    across = np.broadcast_to(x, use.shape), np.broadcast_to(y, use.shape)
    return across[0], across[1], grey, use.astype(np.float64), middle


def _first(
    x: FloatArray,
    y: FloatArray,
    grey: FloatArray,
    weight: FloatArray,
    at: FloatArray,
    steps: FloatArray,
) -> FloatArray:
    """First parameters: position, two angles, level, contrast, slopes of the light, blur."""
    count = len(at)
    total = np.maximum(weight.sum(axis=1), 1.0)
    level = (weight * grey).sum(axis=1) / total
    angle_1 = np.arctan2(steps[:, 0, 1], steps[:, 0, 0])
    angle_2 = np.arctan2(-steps[:, 1, 0], steps[:, 1, 1])
    p = np.column_stack([at, angle_1, angle_2, level, np.ones(count), np.zeros((count, 2)),
                         np.full(count, np.log(FIRST_SIGMA))])  # fmt: skip
    _, _, normal_1, normal_2 = _frames(p)
    dx, dy = x - at[:, :1], y - at[:, 1:]
    sign = np.sign(dx * normal_1[:, :1] + dy * normal_1[:, 1:]) * np.sign(
        dx * normal_2[:, :1] + dy * normal_2[:, 1:]
    )
    p[:, 5] = (weight * sign * (grey - level[:, None])).sum(axis=1) / total
    return p


def _frames(p: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Directions (C, 2) of both borders and their normals."""
    along_1 = np.stack([np.cos(p[:, 2]), np.sin(p[:, 2])], axis=1)
    along_2 = np.stack([-np.sin(p[:, 3]), np.cos(p[:, 3])], axis=1)
    normal_1 = np.stack([-along_1[:, 1], along_1[:, 0]], axis=1)
    normal_2 = np.stack([along_2[:, 1], -along_2[:, 0]], axis=1)
    return along_1, along_2, normal_1, normal_2


def _residual(
    p: FloatArray, x: FloatArray, y: FloatArray, grey: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Model less grey value (C, P) and its derivatives (C, 9, P), as in `cross._residual`."""
    along_1, along_2, normal_1, normal_2 = _frames(p)
    dx, dy = x - p[:, :1], y - p[:, 1:2]
    sigma = np.exp(np.clip(p[:, 8], np.log(MIN_SIGMA), np.log(10.0 * MOST_SIGMA)))
    first, second = (
        profile_and_slopes(dx * normal[:, :1] + dy * normal[:, 1:], normal, sigma)
        for normal in (normal_1, normal_2)
    )
    light = 1.0 + p[:, 6:7] * dx + p[:, 7:8] * dy
    pattern = p[:, 4:5] + p[:, 5:6] * first[0] * second[0]
    scale = p[:, 5:6] * light
    by_1, by_2 = scale * second[0], scale * first[0]
    slopes = np.empty((len(p), 9, x.shape[1]))
    for i in range(2):
        slopes[:, i] = (
            -by_1 * first[1] * normal_1[:, i : i + 1]
            - by_2 * second[1] * normal_2[:, i : i + 1]
            - p[:, 6 + i : 7 + i] * pattern
        )
    # turning a border takes normal_1 to -along_1, and normal_2 to along_2
    slopes[:, 2] = by_1 * slope_by_turn(first, normal_1, -along_1, dx, dy)
    slopes[:, 3] = by_2 * slope_by_turn(second, normal_2, along_2, dx, dy)
    slopes[:, 4] = light
    slopes[:, 5] = light * first[0] * second[0]
    slopes[:, 6] = dx * pattern
    slopes[:, 7] = dy * pattern
    rising = sigma[:, None] * (sigma[:, None] > 1.001 * MIN_SIGMA)
    slopes[:, 8] = (by_1 * first[2] + by_2 * second[2]) * rising
    return light * pattern - grey, slopes


def _failed(count: int) -> Crossings:
    empty = np.full(count, np.nan)
    return Crossings(
        np.full((count, 2), np.nan), empty, empty, empty, empty, np.zeros(count, dtype=bool)
    )


def _kept(found: Crossings, ok: npt.NDArray[np.bool_]) -> Crossings:
    """NaN in the rows that aren't ok."""
    sigma, contrast, blur, residual = (
        np.where(ok, values, np.nan)
        for values in (found.sigma, found.contrast, found.blur, found.residual)
    )
    points = np.where(ok[:, None], found.points, np.nan)
    return Crossings(points, sigma, contrast, blur, residual, ok)
