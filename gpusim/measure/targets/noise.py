"""How noisy a picture is, and how uncertain fits are where the noise of neighbours is alike.

Colour filters, sharpening and compression correlate noise. A fit whose parameter is p = sum h_i n_i
of the noise n then varies by sum_ij h_i h_j c(j - i); independent noise gives s^2 sum_i h_i^2.

The covariance c at each distance is taken from what all fits of an image leave. A fit takes up part
of the noise: it leaves e = (I - H) n with H = Q Q^T, Q an orthonormal basis of its slopes, and so

    E[e e^T] = C - H C - C H + H C H

whose sums over pairs at a distance are linear in c. Where a marker has 14 px and nine parameters,
what is left looks much less alike than the noise is.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float, Single

WINDOW = 7  # px: noise that neighbours share keeps most of its variance in it
FLAT = 0.2  # share of a picture that is taken as flat, or next to it
RMS_ALLOWANCE = 1.3  # RMS over the noise: chance, and what a level that is too low by a tenth lacks
MIN_CLEAR = 0.35  # noise over the contrast beyond which nothing may be left for it
Lag = tuple[int, int]

REACH = 3  # px: noise further apart counts as independent
MIN_SIGMAS = 4.0  # standard deviations by which a correlation must stand out
MAX_TAKEN = 3.0  # variance of the noise over that of what fits leave, if distances are known
BLURS = np.linspace(0.3, 1.8, 31)  # px
SAMPLED_FITS = 8  # fits that tell how much of the noise is taken up
LAGS = [(d, a) for d in range(REACH + 1) for a in range(-REACH, REACH + 1) if d > 0 or a > 0]


def noise_level(image: Single) -> float:
    """Standard deviation of the noise, in the image's (H, W) grey levels.

    The lower quintile of the standard deviations in windows of 7 x 7 px; 0 for smaller images.
    """
    if min(image.shape) < WINDOW:
        return 0.0
    even = image - np.float32(image.mean())
    size = (WINDOW, WINDOW)
    mean = cv2.boxFilter(even, cv2.CV_64F, size)
    square = cv2.sqrBoxFilter(even, cv2.CV_64F, size)
    half = WINDOW // 2
    variance = (square - mean * mean)[half:-half, half:-half] * (WINDOW**2 / (WINDOW**2 - 1.0))
    return float(np.sqrt(max(float(np.quantile(variance, FLAT)), 0.0)))


def allowed_residual(most: float, noise: float, contrast: float | Float) -> Float:
    """RMS over the contrast that a fit may leave: ``most`` without noise, more with it."""
    share = noise / np.maximum(np.abs(contrast), 1e-300)
    more = np.where(share <= MIN_CLEAR, RMS_ALLOWANCE * share, 0.0)
    return np.asarray(np.hypot(most, more))


def widening(residual: Float, weight: Float, influence: Float, slopes: Float) -> Float:
    """Standard uncertainty over that for independent noise, at least 1, of C fits (C,).

    ``residual``, ``weight`` (C, S, S): what the fits leave of their pixels, and 0 for those that
    they don't use; ``influence`` (C, Q, S, S): h of the parameters whose variances are added;
    ``slopes`` (C, P, S, S): of the model by all its parameters.
    """
    used = weight > 0
    count = np.maximum(used.sum(axis=(1, 2)), 1)
    standardised = np.where(used, residual, 0.0)
    scale = np.sqrt((standardised * standardised).sum(axis=(1, 2)) / count)
    standardised = standardised / np.where(scale > 0, scale, 1.0)[:, None, None]
    influences = np.where(used[:, None], influence, 0.0)
    sampled = np.unique(
        np.linspace(0, len(used) - 1, min(SAMPLED_FITS, len(used))).astype(np.int64)
    )
    taken = _FittedShare(np.where(used[sampled, None], slopes[sampled], 0.0))
    share = len(used) / len(sampled)
    observed = _alike(standardised, REACH, (0,))
    pairs = np.rint(_alike(used.astype(np.float64), REACH, (0,)))
    independent = -share * taken.trace
    known = [(0, 0)] + [
        lag
        for lag in LAGS
        if pairs[lag] and abs(observed[lag] - independent[lag]) > MIN_SIGMAS * np.sqrt(pairs[lag])
    ]
    if len(known) == 1:
        return np.ones(len(used))
    matrix, sums = _equations(known, taken, share, pairs, observed)
    covariance = np.asarray(np.linalg.lstsq(matrix, sums)[0], dtype=np.float64)
    if not (np.abs(covariance[1:]) <= covariance[0]).all() or not covariance[0] <= MAX_TAKEN:
        # so much is taken up that distances can't be told apart
        known = [(0, 0), *(lag for lag in LAGS if pairs[lag])]
        covariance = _as_blurred(known, *_equations(known, taken, share, pairs, observed))
    alike = _alike(influences, REACH, (1,))
    alone = alike[:, 0, 0]
    together = covariance[0] * alone
    for value, (down, across) in zip(covariance[1:], known[1:], strict=True):
        together += 2.0 * value * alike[:, down, across]
    stated = count / np.maximum(count - slopes.shape[1], 1)
    ratio = together / np.where(alone > 0, alone * stated, 1.0)
    return np.asarray(np.sqrt(np.maximum(ratio, 1.0)))


def _equations(
    known: list[Lag],
    taken: _FittedShare,
    share: float,
    pairs: Float,
    observed: Float,
) -> tuple[Float, Float]:
    """Matrix and right-hand side for the covariance at the distances ``known``, 0 at others."""
    matrix = share * taken.matrix(known)
    matrix += np.diag([float(pairs[lag]) for lag in known])
    return matrix, np.array([observed[lag] for lag in known])


def _as_blurred(known: list[Lag], matrix: Float, sums: Float) -> Float:
    """The covariance of white noise behind a Gaussian blur that fits the equations best."""
    square = np.array([float(d * d + a * a) for d, a in known])
    best, covariance = np.inf, np.zeros(len(known))
    for blur in BLURS:
        alike = np.exp(-square / (4.0 * blur * blur))
        predicted = matrix @ alike
        scale = float(predicted @ sums / max(float(predicted @ predicted), 1e-300))
        error = float(np.square(sums - scale * predicted).sum())
        if error < best:
            best, covariance = error, scale * alike
    return covariance


class _FittedShare:
    """What fits take up of the noise, by distance."""

    def __init__(self, slopes: Float) -> None:
        """``slopes`` (C, P, S, S) of some fits, 0 at pixels that they don't use."""
        count, number = slopes.shape[:2]
        flat = slopes.reshape(count, number, -1).transpose(0, 2, 1)
        basis = np.linalg.qr(flat)[0].transpose(0, 2, 1).reshape(slopes.shape)
        # G(m) = sum_i Q_(i+m) Q_i^T of each fit by distance m: [m, -m wraps round, C, P, P]
        self.overlap = np.zeros((2 * REACH + 1, 2 * REACH + 1, count, number, number))
        for down in range(REACH + 1):
            for across in range(-REACH if down else 0, REACH + 1):
                one, other = (v.reshape(count, number, -1) for v in _shifted(basis, down, across))
                gram = other @ one.transpose(0, 2, 1)
                self.overlap[down, across] = gram
                self.overlap[-down, -across] = gram.transpose(0, 2, 1)
        self.trace = _alike(basis, 2 * REACH, (0, 1))
        """Sum over pairs at each distance of H: the trace of G, up to twice the reach."""

    def matrix(self, lags: list[Lag]) -> Float:
        """Sums over pairs at each distance (rows) of H S H - H S - S H, S = 1 at the distances
        +- each (columns)."""
        down, across = np.array(lags).T
        at, count = self.overlap[down, across], len(lags)
        both = (at + self.overlap[-down, -across]).reshape(count, -1)
        inner = at.swapaxes(3, 2).reshape(count, -1) @ both.T
        ends = (
            self.trace[down[:, None] + down, across[:, None] + across]
            + self.trace[down[:, None] - down, across[:, None] - across]
        )
        result: Float = inner - 2.0 * ends
        result[:, (down == 0) & (across == 0)] *= 0.5  # one distance, not two
        return result


def _alike(values: Float, reach: int, summed: tuple[int, ...]) -> Float:
    """Sums of products of values (…, S, S) with those at each distance, up to ``reach`` either way.

    Distances are the last two indices, negative ones wrap round; axes ``summed`` are summed over.
    """
    size = 2 * (values.shape[-1] + reach,)
    spectrum = np.fft.rfft2(values, size)
    power = (spectrum.real**2 + spectrum.imag**2).sum(axis=summed)
    return np.asarray(np.fft.irfft2(power, size))


def _shifted(
    values: npt.NDArray[Any], down: int, across: int
) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    """The values (…, S, S) of all pixels that have one ``down`` rows and ``across`` columns on,
    and those of the latter."""
    size = values.shape[-1]
    left, right = max(-across, 0), size - max(across, 0)
    return (
        values[..., : size - down, left:right],
        values[..., down:, left + across : right + across],
    )
