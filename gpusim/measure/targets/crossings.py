"""Chessboard corners to a thousandth of a pixel: all crossings of an image fitted at once.

The model is that of `gpusim.measure.targets.border_junction`: two straight borders, integrated over
the pixels and blurred by the lens, under a light that varies linearly. A corner of a board has no
ends to find but neighbours that give its two directions, also under strong perspective. Where the
lens bends the borders, pixels are looked at in coordinates that make them straight
(`gpusim.measure.targets.plumb_lines`). The true image and the model are both symmetric about the
corner, so that what the model leaves out (the few pixels that both borders cross) doesn't move it.
``cv2.cornerSubPix`` is off by 0.035-0.08 px on perfect images.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Bool, Float
from gpusim.errors import InputError
from gpusim.field_summary import field_summary
from gpusim.measure.images import check_image, check_points
from gpusim.measure.targets.border_junction import (
    CENTRE,
    PARAMETERS,
    fit_junctions,
    frames,
    residual_and_slopes,
)
from gpusim.measure.targets.noise import allowed_residual, noise_level, widening
from gpusim.measure.targets.plumb_lines import Straighten, plumb_lines, straight_offsets
from gpusim.parallel.blas_threads import one_blas_thread
from gpusim.validation import require, unmasked

INSIDE = 0.62  # of the way to the next corner
MIN_SHARE = 0.4  # … at least, next to a pattern's end
MIN_REACH, ROUGH_REACH, MAX_REACH = 3.0, 7.0, 12.0  # px; the second in a first fit
FIRST_SIGMA, MAX_SIGMA = 0.5, 6.0  # px
MAX_DRIFT = 3.0  # px from the start
MIN_CONTRAST = 0.02  # of the image's grey range
MAX_RESIDUAL = 0.25  # of the contrast, besides the picture's noise
MIN_PIXELS = 24
MORE_BLUR = 0.1  # px


@dataclass(frozen=True)
class Crossings:
    """C fitted corners; rows that weren't fitted are NaN.

    Attributes
    ----------
    points : (C, 2) float64, x, y in px.
    sigma : (C,) float64, standard uncertainty of a coordinate from the fit's own residuals, px;
        how much those of neighbouring pixels are alike is taken from all fits together.
    contrast : (C,) float64, half the step in grey levels, positive if the quadrant between the
        first and the second direction is bright.
    blur : (C,) float64, width of the lens blur, px.
    residual : (C,) float64, RMS of the fit over the contrast.
    ok : (C,) bool.

    Examples
    --------
    >>> image = gs.export.read_image("markers.png")
    >>> fit = gs.measure.fit_crossings(image, [[39, 60]], first=[[8, 0]], second=[[0, 8]])
    >>> fit.ok, fit.points.round(2)
    (array([ True]), array([[39.5, 59.5]]))
    """

    points: Float
    sigma: Float
    contrast: Float
    blur: Float
    residual: Float
    ok: Bool
    __repr__ = field_summary


@unmasked("image")
@one_blas_thread()
def fit_crossings(
    image: npt.NDArray[Any],
    start: npt.ArrayLike,
    first: npt.ArrayLike,
    second: npt.ArrayLike,
    *,
    share: npt.ArrayLike = INSIDE,
    margin: tuple[float, float] | None = None,
    blur: npt.ArrayLike | None = None,
    index: npt.ArrayLike | None = None,
    straighten: Straighten | None = None,
) -> Crossings:
    """Fit the corners near ``start`` (C, 2).

    ``first`` and ``second`` (C, 2) are the steps in px to the next corner along the two borders;
    turning from the first to the second is turning from +x to +y (down). The fit looks at most
    12 px and ``share`` (a number, or (C,)) of these steps far. It is done twice, the second time
    around what was found. Where the pattern ends after a step, ``margin`` = (px, lens blurs) says
    how close to there the second fit may look; ``share`` then holds for the first one only. Where
    ``blur`` (C,) in px is known, from another picture, the first one is left out.

    A lens that bends the borders would move the corners towards the picture's middle. For corners
    of a flat board ``index`` (C, 2), their columns and rows, shows the first fit how the lens bends
    its lines; otherwise ``straighten`` may tell it, from pixels (…, 2) to places (…, 2) where
    straight lines are straight: `lens_mapping` of a calibrated camera.

    Raises
    ------
    InputError
        Not a grey image, or points and steps of other shapes than (C, 2).

    Examples
    --------
    >>> image = gs.export.read_image("markers.png")
    >>> gs.measure.fit_crossings(image, [[39, 60]], first=[[8, 0]], second=[[0, 8]]).points.round(2)
    array([[39.5, 59.5]])
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
    if not span > 0:
        return _failed(len(points))
    known = _known_blur(blur, len(points))
    if index is not None:
        shape, expected = np.shape(index), (len(points), 2)
        require(shape == expected, "fit_crossings: index", shape, str(expected))
    around, before = points, None
    sharp = known
    if sharp is None:
        rough, before = _fit(array, points, steps, inside, span, None, straighten, rough=True)
        around, sharp = np.where(rough.ok[:, None], rough.points, points), rough.blur
        if index is not None:
            straighten = _bent(rough, index, array)
    if margin is not None:
        inside = np.where(np.isfinite(sharp), _own_share(steps, sharp, margin), inside)
    result, fitted = _fit(array, around, steps, inside, span, before, straighten)
    if straighten is not None and index is not None:
        # the field is as right as the corners that it is taken from
        straighten = _bent(result, index, array)
        around = np.where(result.ok[:, None], result.points, around)
        result, _ = _fit(array, around, steps, inside, span, fitted, straighten)
    if known is not None and margin is not None:
        # where the picture is less sharp than was said, the pattern's border reaches further
        rows = np.flatnonzero(result.ok & (result.blur > known + MORE_BLUR))
        if rows.size:
            again = fit_crossings(
                array, result.points[rows], *steps[rows].transpose(1, 0, 2), margin=margin,
                blur=result.blur[rows] + MORE_BLUR, straighten=straighten,
            )  # fmt: skip
            for field in fields(result):
                getattr(result, field.name)[rows] = getattr(again, field.name)
    drift = np.linalg.norm(result.points - points, axis=1)
    return _kept(result, result.ok & (drift <= 2 * MAX_DRIFT))


def _bent(found: Crossings, index: npt.ArrayLike, array: npt.NDArray[Any]) -> Straighten | None:
    """What makes the lines straight again on which the corners lie that were found."""
    place = np.asarray(index, dtype=np.int64)[found.ok]
    return plumb_lines(found.points[found.ok], place, (array.shape[1], array.shape[0]))


def _known_blur(blur: npt.ArrayLike | None, count: int) -> Float | None:
    if blur is None:
        return None
    known = np.asarray(blur, dtype=np.float64)
    if known.shape != (count,) or not (known >= 0).all():
        raise InputError(f"fit_crossings: blur; got {known.shape}; expected ({count},), px >= 0")
    return known


def _own_share(steps: Float, blur: Float, margin: tuple[float, float]) -> Float:
    """Share of the steps up to the pattern's own border, as far as it and its blur reach."""
    length = np.linalg.norm(steps, axis=2).mean(axis=1)
    own = 1.0 - (margin[0] + margin[1] * blur) / np.maximum(length, 1e-9)
    return np.asarray(np.clip(own, MIN_SHARE, 1.0))


def _fit(
    array: npt.NDArray[Any],
    start: Float,
    steps: Float,
    inside: Float,
    span: float,
    before: Float | None,
    straighten: Straighten | None,
    *,
    rough: bool = False,
) -> tuple[Crossings, Float]:
    """The fits, and their parameters (C, 9): NaN where it isn't ok.

    ``before`` are those of an earlier fit, around ``start``.
    """
    reach = ROUGH_REACH if rough else MAX_REACH
    fit = fit_windows(
        array, start, steps, inside, span, reach, before=before, straighten=straighten, rough=rough
    )
    place, contrast, blur = fit.parameters[:, :2], fit.parameters[:, 5], fit.blur
    with np.errstate(invalid="ignore"):
        residual = fit.rms / np.abs(contrast)
        most = np.full(len(start), MAX_RESIDUAL)
        if (residual > MAX_RESIDUAL).any():
            noise = noise_level(np.asarray(array, dtype=np.float32)) / span
            most = allowed_residual(MAX_RESIDUAL, noise, contrast)
        drift = np.linalg.norm(place - start, axis=1)
        ok = fit.settled & (np.abs(contrast) >= 0.5 * MIN_CONTRAST) & (residual <= most)
        ok &= (blur <= MAX_SIGMA) & (drift <= MAX_DRIFT)
    found = Crossings(place, fit.sigma, contrast * span, blur, residual, ok)
    return _kept(found, ok), np.where(ok[:, None], fit.parameters, np.nan)


@dataclass(frozen=True, eq=False)
class WindowFits:
    """C fits: ``parameters`` (C, 9) as of `border_junction`, the place in the image; ``rms`` (C,)
    of the residuals; ``sigma`` (C,) px; ``settled`` (C,) bool. NaN where there are too few pixels.
    """

    parameters: Float
    rms: Float
    sigma: Float
    settled: Bool

    @property
    def blur(self) -> Float:
        """(C,) px."""
        return np.asarray(np.sqrt(self.parameters[:, 8]))


def fit_windows(
    array: npt.NDArray[Any],
    start: Float,
    steps: Float,
    share: Float,
    span: float,
    most: float,
    *,
    before: Float | None = None,
    straighten: Straighten | None = None,
    rough: bool = False,
) -> WindowFits:
    """Fit the corners near ``start`` (C, 2) of an image whose grey range is ``span``.

    Looked at are pixels within ``share`` (C,) of the ``steps`` (C, 2, 2), and ``most`` px.
    ``before`` (C, 9), NaN where unknown, are parameters to start from; ``rough`` fits are a start
    for others, without a ``sigma``.
    """
    x, y, grey, weight, middle = _windows(array, start, steps, share, most)
    if straighten is not None:
        corner = start - middle
        offset = np.stack([x - corner[:, :1], y - corner[:, 1:]], axis=2)
        offset = straight_offsets(straighten, start, offset)
        x, y = corner[:, :1] + offset[..., 0], corner[:, 1:] + offset[..., 1]
    usable = (weight.sum(axis=1) >= MIN_PIXELS) & (np.abs(np.linalg.det(steps)) > 4.0)
    rows = np.flatnonzero(usable)
    p = np.full((len(start), PARAMETERS), np.nan)
    rms, sigma = np.full((2, len(start)), np.nan)
    settled = np.zeros(len(start), dtype=bool)
    if not rows.size:
        return WindowFits(p, rms, sigma, settled)
    grey /= span
    p0 = _first(x, y, grey, weight, start - middle, steps)
    if before is not None:
        known = np.isfinite(before).all(axis=1)
        p0[known, 2:] = before[known, 2:]
    fit = fit_junctions(x[rows], y[rows], grey[rows], weight[rows], p0[rows], rough=rough)
    p[rows], rms[rows], settled[rows] = fit.parameters, fit.rms, fit.converged
    variance = 0.5 * (fit.covariance[:, 0, 0] + fit.covariance[:, 1, 1])
    sigma[rows] = np.sqrt(np.maximum(variance, 0.0))
    sure = np.flatnonzero(fit.converged)
    if sure.size and not rough:
        own = rows[sure]
        window = x[own], y[own], grey[own]
        sigma[own] *= _widening(
            fit.parameters[sure], fit.covariance[sure, :2], weight[own], *window
        )
    p[:, :2] += middle
    return WindowFits(p, rms, sigma, settled)


def _widening(p: Float, covariance: Float, weight: Float, *window: Float) -> Float:
    """By how much (C,) residuals that are alike in neighbouring pixels widen the scatter of x and
    y; ``covariance`` (C, 2, 9): of these two with all parameters."""
    rest, slopes = residual_and_slopes(p, *window)
    influence = covariance @ (slopes * weight[:, None])
    side = round(np.sqrt(weight.shape[1]))
    return widening(
        rest.reshape(-1, side, side),
        weight.reshape(-1, side, side),
        influence.reshape(-1, 2, side, side),
        slopes.reshape(-1, PARAMETERS, side, side),
    )


def _windows(
    array: npt.NDArray[Any], start: Float, steps: Float, share: Float, most: float
) -> tuple[Float, Float, Float, Float, Float]:
    """Pixels around each corner: x, y from the window's middle, grey, weight (C, P); middle."""
    length = (share * np.linalg.norm(steps, axis=2).max(axis=1)).max(initial=0.0)
    radius = int(np.ceil(np.clip(length, MIN_REACH, most)))
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
    x: Float,
    y: Float,
    grey: Float,
    weight: Float,
    at: Float,
    steps: Float,
) -> Float:
    """First parameters: position, two angles, level, contrast, slopes of the light, blur."""
    count = len(at)
    total = np.maximum(weight.sum(axis=1), 1.0)
    level = (weight * grey).sum(axis=1) / total
    angle_1 = np.arctan2(steps[:, 0, 1], steps[:, 0, 0])
    angle_2 = np.arctan2(-steps[:, 1, 0], steps[:, 1, 1])
    p = np.column_stack([at, angle_1, angle_2, level, np.ones(count), np.zeros((count, 2)),
                         np.full(count, FIRST_SIGMA**2)])  # fmt: skip
    _, _, normal_1, normal_2 = frames(p)
    dx, dy = x - at[:, :1], y - at[:, 1:]
    sign = np.sign(dx * normal_1[:, :1] + dy * normal_1[:, 1:]) * np.sign(
        dx * normal_2[:, :1] + dy * normal_2[:, 1:]
    )
    p[:, 5] = (weight * sign * (grey - level[:, None])).sum(axis=1) / total
    return p


def _failed(count: int) -> Crossings:
    empty = np.full(count, np.nan)
    return Crossings(
        np.full((count, 2), np.nan), empty, empty, empty, empty, np.zeros(count, dtype=bool)
    )


def _kept(found: Crossings, ok: Bool) -> Crossings:
    """NaN in the rows that aren't ok."""
    sigma, contrast, blur, residual = (
        np.where(ok, values, np.nan)
        for values in (found.sigma, found.contrast, found.blur, found.residual)
    )
    points = np.where(ok[:, None], found.points, np.nan)
    return Crossings(points, sigma, contrast, blur, residual, ok)
