"""Whether all of a subset moved as its warp says, from what the match leaves in its parts.

A subset across the edge of a body, a hole or a crack sees two motions; the fit settles between
them, often with a high correlation. Its parts tell: each ninth of the subset is asked for the
motion d that would explain what is left there, e = J d, and how much of the pattern it can't
explain at all. Subsets that merely are noisy are the same in all their parts. A small jump across a
line leaves next to nothing in the parts: it is looked for by itself (see ``discontinuity``).
"""

from __future__ import annotations

import cv2
import numpy as np

from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.measure.correlation.discontinuity import COARSE, FINE, fit_discontinuities
from gpusim.measure.correlation.image_pair import Pair, subset_pixels
from gpusim.measure.correlation.matching import Settings
from gpusim.measure.correlation.warp import COEFFICIENTS, basis, steepest_descent
from gpusim.measure.images import SplineImage
from gpusim.parallel.threads import shared

PARTS = 3  # parts along each side of a subset
MIN_PART_PIXELS = 6.0  # px with weight that a part needs to be asked
SHARE = 0.25  # of its pixels that a part must have
MIN_SIGNIFICANCE = 25.0  # square of the standard deviations by which a part's motion must stand out
# residual variance of a part over the lower quartile of all parts: shot noise differs by 2, chance
# by the number of pixels n
RESIDUAL_RATIO, CHANCE = 2.0, 8.0  # RESIDUAL_RATIO + CHANCE / sqrt(n)
MIN_TEXTURE = 0.4  # sum of squared slopes over the mean one of the parts: with less, not asked
MIN_ISOTROPY = 0.2  # likewise 4 det / trace^2 of those sums, 1 without a preferred direction
MAX_LEVERAGE = 2.5  # uncertainty of the point over that with known slopes; 1.0 to 1.2 usually
MAX_SPREAD = 3.0  # uncertainty of the point over the lower quartile of all
BORDER = 2.0  # px
MIN_SHARE = 1e-4  # eigenvalue of the scaled normal matrix without noise, at least
# standard deviations of the noise's slopes that those of a pattern must exceed …
MIN_SLOPE_SIGMAS = 6.0
MIN_CROSS_SLOPES = 0.1  # … or this share of those across them
FOREIGN_VARIANCE = 0.15  # residual variance of a part over the variance of the subset's grey values
# what a smooth field explains over what a jump does, by coarse lines: no jump with more
MAX_SMOOTH_COARSE = 2.0
MAX_SMOOTH_FINE = np.array([0.9, 1.05])  # likewise by fine lines, as the jump is less sure or …
UNCERTAIN_LENGTH = 2.5  # times ``apart_px``: a shorter jump doesn't move a point by as much as that
UNCERTAIN_SMOOTH = 2.2  # what a smooth field explains over what a jump does: uncertain up to here
# times MIN_SIGNIFICANCE for a jump that makes uncertain: noise alone shows it in 1 of 20
UNCERTAIN_SIGNIFICANCE = 0.55
COARSE_SHARE = 0.5  # of a jump's length and surety that coarse lines must show
CLEAR_SIGNIFICANCE = 4.0  # … more than this times MIN_SIGNIFICANCE: noise no longer decides
# times MIN_SIGNIFICANCE for a jump: the best of all lines fits noise better than one part does
LINE_SIGNIFICANCE = 2.4
MAX_SMOOTH_MOTION = 0.6  # px: a part that moved by more isn't asked whether it did so smoothly
CHUNK = 1 << 16  # pixels handled at once
LINE_CHUNK = 96  # subsets asked for a jump at once: what they need stays in the cache
MAX_REMAP_SIDE = 32_000  # px: sides of the images that cv2.remap takes


def inconsistent_subsets(
    pair: Pair,
    points: Float,
    coefficients: Float,
    settings: Settings,
    blur_px: float = 0.0,
) -> tuple[Bool, Bool, Bool]:
    """(M,) bool: subsets a part or a side of which moved by more than ``apart_px`` from the rest;
    uncertain ones, of which a line explains that, and a smooth field about as well: a narrow strip,
    a corner, a jump of about a pixel, or short waves; and those of them where noise hardly does.

    points, coefficients : (M, 2) and (M, 2, 6), matched subsets, px; all inside both images.

    A part counts if its own motion is well beyond the noise left in it, or if it doesn't match:
    what is left there is ``FOREIGN_VARIANCE`` of the pattern and far more than in the other parts.
    Motions below ``MAX_SMOOTH_MOTION`` count only if a jump explains them better than a smooth
    field does.
    """
    # blurred noise is correlated: it moves a part by more than its variance says
    sure = MIN_SIGNIFICANCE * max(1.0, 4.0 * np.pi * blur_px**2)
    parts = shared(
        lambda part: _inconsistent_chunk(pair, points[part], coefficients[part], settings, sure),
        _chunks(len(points), settings),
    )
    verdicts = np.concatenate(parts, axis=1) if parts else np.zeros((3, 0), dtype=np.bool_)
    return verdicts[0], verdicts[1], verdicts[2]


def one_sided_texture(
    pair: Pair, points: Float, noise: Float, settings: Settings, usual: float
) -> tuple[Bool, Bool]:
    """(M,) bool: subsets whose texture lies to one side, so that their point is extrapolated, or
    goes one way only; and those of the second kind.

    A subset on the plain background of a body sees a strip of it at most. What an affine warp says
    of the point then is the strip's motion plus a badly known slope times the distance. Stripes say
    nothing of the way along them. ``noise`` (M,) is the variance of the reference's noise there,
    where the grey range is 1; ``usual`` the `usual_spread`.
    """
    parts = shared(
        lambda part: _leverage(pair, points[part], noise[part], settings),
        _chunks(len(points), settings),
    )
    if not parts:
        return np.zeros(0, dtype=np.bool_), np.zeros(0, dtype=np.bool_)
    lever, spread, striped = np.concatenate(parts, axis=1)
    # a bright edge within a good texture has a long lever too, but the point is well known
    far = (lever > MAX_LEVERAGE) & (spread > MAX_SPREAD * usual)
    return np.asarray(far | (striped > 0)), np.asarray(striped > 0)


def usual_spread(pair: Pair, points: Float, noise: Float, settings: Settings) -> float:
    """How uncertain points are for grey noise 1, the lower quartile."""
    return float(np.quantile(_leverage(pair, points, noise, settings)[1], 0.25))


def _chunks(count: int, settings: Settings) -> list[slice]:
    """Subsets in parts that stay in the cache."""
    size = max(1, CHUNK // settings.window.size)
    return [slice(first, first + size) for first in range(0, count, size)]


def _leverage(pair: Pair, points: Float, noise: Float, settings: Settings) -> Float:
    """(3, M): uncertainty of each point over what it would be if the slopes of the warp were known,
    that for grey noise 1, and 1 where the pattern has slopes one way only.

    Noise has slopes too, which tell nothing: their part is taken out of the normal matrix.
    """
    column, row, planes = _subsets(pair, points, settings)
    weight = settings.window.ravel() * planes[..., 3]
    root = np.sqrt(weight)
    a, b = (column - points[:, :1]) / settings.half, (row - points[:, 1:]) / settings.half
    descent = steepest_descent("affine", root * planes[..., 1], root * planes[..., 2], a, b)
    descent = descent.transpose(1, 0, 2)
    normal = descent @ descent.transpose(0, 2, 1)
    total = np.maximum(weight.sum(axis=1), 1.0)
    noise = settings.slope_noise * noise
    terms = (root * basis(a, b, 3)).transpose(1, 0, 2)
    moments = noise[:, None, None] * (terms @ terms.transpose(0, 2, 1))
    striped = _one_direction(normal[:, ::3, ::3], moments[:, 0, 0], total)
    diagonal = np.einsum("bii->bi", normal).copy()
    for first in (0, 3):
        normal[:, first : first + 3, first : first + 3] -= moments
    scale = 1.0 / np.sqrt(np.maximum(diagonal, 1e-30))
    values, vectors = np.linalg.eigh(normal * scale[:, :, None] * scale[:, None, :])
    values = np.maximum(values, MIN_SHARE)
    normal = np.einsum("bik,bk,bjk->bij", vectors, values, vectors)
    spread = np.einsum("bik,bk,bjk->bij", vectors, 1.0 / values, vectors)
    variance, known = (np.stack([m[:, k, k] for k in (0, 3)]) for m in (spread, normal))
    variance = np.sqrt(variance)
    return np.stack(
        [(variance * np.sqrt(known)).max(axis=0), (variance * scale[:, ::3].T).max(axis=0), striped]
    )


def _one_direction(slopes: Float, noise: Float, pixels: Float) -> Bool:
    """Whether sums of products of slopes (B, 2, 2) tell one direction only, beside those that noise
    makes: each of ``noise`` on the diagonal, known to a share of sqrt(2 / number of pixels), of
    which the slope filter leaves about one in three independent."""
    low, high = np.linalg.eigvalsh(slopes).T - noise
    return np.asarray(
        (low < MIN_SLOPE_SIGMAS * np.sqrt(6.0 / pixels) * noise) & (low < MIN_CROSS_SLOPES * high)
    )


def _subsets(pair: Pair, points: Float, settings: Settings) -> tuple[Long, Long, Float]:
    """Pixels (M, n) of subsets in the whole reference image, columns and rows, and the planes."""
    column, row = subset_pixels(points, settings.half)
    x, y = pair.reference.origin
    return column, row, pair.planes_at(column[:, 0] - x, row[:, 0] - y, len(settings.window))


def _misfit(
    pair: Pair, points: Float, coefficients: Float, settings: Settings
) -> tuple[Float, ...]:
    """What differs in subsets of n pixels where they were found: weights, grey values f, slopes of
    these in x and y, and what is left of f, all (M, n); contrast of f and total weight (M, 1)."""
    half = settings.half
    column, row, planes = _subsets(pair, points, settings)
    count = COEFFICIENTS[settings.shape]
    terms = basis((column - points[:, :1]) / half, (row - points[:, 1:]) / half, count)
    motion = np.einsum("bik,kbn->ibn", coefficients[:, :, :count], terms)
    x_there, y_there = column + motion[0], row + motion[1]
    weight = settings.window.ravel() * planes[..., 3]
    # at the border, what lies beyond is guessed: that looks like a strip that moved
    left, top, right, bottom = pair.deformed.valid
    weight = weight * ((x_there >= left + BORDER) & (x_there <= right - BORDER))
    weight = weight * ((y_there >= top + BORDER) & (y_there <= bottom - BORDER))
    total = np.maximum(weight.sum(axis=1, keepdims=True), 1.0)
    g = _resampled(pair.deformed, x_there, y_there)
    f = planes[..., 0] - (weight * planes[..., 0]).sum(axis=1, keepdims=True) / total
    g -= (weight * g).sum(axis=1, keepdims=True) / total
    contrast = (weight * f * f).sum(axis=1, keepdims=True)
    rest = (
        f - np.sqrt(contrast / np.maximum((weight * g * g).sum(axis=1, keepdims=True), 1e-30)) * g
    )
    return weight, f, planes[..., 1], planes[..., 2], rest, contrast, total


def _ninths(misfit: tuple[Float, ...], settings: Settings, sure: float) -> tuple[Bool, Float]:
    """Which subsets (M,) have a part that isn't of the reference, and the largest motion of a part
    against its subset, px, where it is sure."""
    weight, _, x, y, rest, contrast, total = misfit
    size = 2 * settings.half + 1
    third = np.arange(size) * PARTS // size
    part = PARTS * np.repeat(third, size) + np.tile(third, size)
    member = (part[:, None] == np.arange(PARTS * PARTS)).astype(np.float64)
    pixels = weight @ member
    divisor = np.maximum(pixels, 1e-30)
    mean_x, mean_y, mean_e = ((weight * v) @ member / divisor for v in (x, y, rest))
    xx = (weight * x * x) @ member - pixels * mean_x**2
    xy = (weight * x * y) @ member - pixels * mean_x * mean_y
    yy = (weight * y * y) @ member - pixels * mean_y**2
    xe = (weight * x * rest) @ member - pixels * mean_x * mean_e
    ye = (weight * y * rest) @ member - pixels * mean_y * mean_e
    ee = (weight * rest * rest) @ member - pixels * mean_e**2

    asked = (pixels >= MIN_PART_PIXELS) & (pixels >= SHARE * settings.window.sum() / PARTS**2)
    determinant = xx * yy - xy * xy
    slopes = np.where(asked, xx + yy, 0.0)
    usual_slopes = slopes.sum(axis=1) / np.maximum(asked.sum(axis=1), 1)
    solvable = asked & (determinant > MIN_ISOTROPY * (0.5 * slopes) ** 2)
    solvable &= slopes > MIN_TEXTURE * usual_slopes[:, None]
    divisor = np.where(solvable, determinant, 1.0)
    dx, dy = (yy * xe - xy * ye) / divisor, (xx * ye - xy * xe) / divisor
    explained = dx * xe + dy * ye
    noise = np.maximum(ee - explained, 0.0) / np.maximum(pixels - 3.0, 1.0)
    variance = np.where(asked, ee / np.maximum(pixels, 1.0), np.nan)
    usual = _lower_quartile(ee / np.maximum(pixels, 1.0), asked)[:, None]
    noise = np.maximum(noise, usual)
    motion = np.where(solvable & (explained > sure * noise), np.hypot(dx, dy), 0.0).max(axis=1)
    odd = RESIDUAL_RATIO + CHANCE / np.sqrt(np.maximum(pixels, 1.0))
    foreign = asked & (variance > odd * usual) & (variance > FOREIGN_VARIANCE * contrast / total)
    return np.asarray(foreign.any(axis=1)), np.asarray(motion)


def _inconsistent_chunk(
    pair: Pair, points: Float, coefficients: Float, settings: Settings, sure: float
) -> Bool:
    """(3, M) bool: as ``inconsistent_subsets`` returns them."""
    misfit = _misfit(pair, points, coefficients, settings)
    weight, f, x, y, rest, *_ = misfit
    foreign, motion = _ninths(misfit, settings, sure)
    torn_subsets = foreign | (motion > max(MAX_SMOOTH_MOTION, settings.apart_px))
    uncertain, likely = np.zeros((2, len(points)), dtype=np.bool_)
    open_ = np.flatnonzero(~torn_subsets)
    sector = np.zeros(len(points), dtype=np.int64)
    for searches, share in (((COARSE,), COARSE_SHARE), (FINE, 1.0)):
        coarse, seen = share < 1.0, np.zeros(len(points), dtype=np.bool_)
        parts = [open_[sector[open_] == number] for number in range(len(searches))]
        for search, chunk in [
            (search, part[i : i + LINE_CHUNK])
            for search, part in zip(searches, parts, strict=True)
            for i in range(0, part.size, LINE_CHUNK)
        ]:
            jump = fit_discontinuities(
                weight[chunk], (x[chunk], y[chunk]), f[chunk], rest[chunk], search
            )
            sector[chunk] = jump.sector
            torn = np.maximum(jump.length, motion[chunk]) > share * settings.apart_px
            torn &= jump.sure > share * LINE_SIGNIFICANCE * sure
            unclear = jump.length > UNCERTAIN_LENGTH * settings.apart_px
            unclear &= jump.sure > UNCERTAIN_SIGNIFICANCE * sure
            smooth, asked = np.full(chunk.size, np.inf), np.flatnonzero(torn | unclear)
            smooth[asked] = jump.smooth(asked)
            clear = MAX_SMOOTH_FINE[(jump.sure > CLEAR_SIGNIFICANCE * sure).astype(np.int64)]
            most = MAX_SMOOTH_COARSE if coarse else clear
            seen[chunk] = torn & (smooth < most * jump.sure)
            unclear &= smooth < UNCERTAIN_SMOOTH * jump.sure
            uncertain[chunk] |= unclear
            likely[chunk] |= unclear & (jump.sure > COARSE_SHARE * LINE_SIGNIFICANCE * sure)
        open_ = np.flatnonzero(seen)
    torn_subsets[open_] = True
    return np.stack([torn_subsets, uncertain & ~torn_subsets, likely & ~torn_subsets])


def _lower_quartile(values: Float, valid: Bool) -> Float:
    """Of the valid values in each row (B, n), between two of them linearly; 0 without any."""
    rows = np.arange(len(values))
    ordered = np.sort(np.where(valid, values, np.inf), axis=1)
    place = 0.25 * np.maximum(valid.sum(axis=1) - 1, 0)
    before = place.astype(np.int64)
    share = place - before
    low, high = ordered[rows, before], ordered[rows, np.ceil(place).astype(np.int64)]
    has_valid = valid.any(axis=1)
    low, high = np.where(has_valid, low, 0.0), np.where(has_valid, high, 0.0)
    return np.asarray(low + share * (high - low))


def _resampled(image: SplineImage, x: Float, y: Float) -> Float:
    """Grey values of an image at positions (B, n), to 1/32 px: enough to see what doesn't fit."""
    if max(*image.pixels.shape, *x.shape) > MAX_REMAP_SIDE:
        return image.values(x, y)
    greys = cv2.remap(
        image.pixels,
        (x - image.origin[0]).astype(np.float32),
        (y - image.origin[1]).astype(np.float32),
        cv2.INTER_LANCZOS4,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return np.asarray(greys, dtype=np.float64)
