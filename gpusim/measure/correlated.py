"""How uncertain fits are where the noise of neighbouring pixels is alike.

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

import numpy as np
import numpy.typing as npt

__all__ = ["widening"]

FloatArray = npt.NDArray[np.float64]
Lag = tuple[int, int]

REACH = 3  # px: noise further apart counts as independent
SURE = 4.0  # standard deviations by which a correlation must stand out
MOST_TAKEN = 3.0  # variance of the noise over that of what fits leave, if distances are known
BLURS = np.linspace(0.3, 1.8, 31)  # px
ASKED = 8  # fits that tell how much of the noise is taken up
LAGS = [(d, a) for d in range(REACH + 1) for a in range(-REACH, REACH + 1) if d > 0 or a > 0]


def widening(
    residual: FloatArray, weight: FloatArray, influence: FloatArray, slopes: FloatArray
) -> FloatArray:
    """Standard uncertainty over that for independent noise, at least 1, of C fits (C,).

    ``residual``, ``weight`` (C, S, S): what the fits leave of their pixels, and 0 for those that
    they don't use; ``influence`` (C, Q, S, S): h of the parameters whose variances are added;
    ``slopes`` (C, P, S, S): of the model by all its parameters.
    """
    used = weight > 0
    count = np.maximum(used.sum(axis=(1, 2)), 1)
    left = np.where(used, residual, 0.0)
    scale = np.sqrt((left * left).sum(axis=(1, 2)) / count)
    left = left / np.where(scale > 0, scale, 1.0)[:, None, None]
    own = np.where(used[:, None], influence, 0.0)
    some = np.unique(np.linspace(0, len(used) - 1, min(ASKED, len(used))).astype(np.int64))
    taken = _overlaps(np.where(used[some, None], slopes[some], 0.0))
    share = len(used) / len(some)
    observed, pairs = {(0, 0): float((left * left).sum())}, {(0, 0): int(used.sum())}
    known: list[Lag] = [(0, 0)]
    for lag in LAGS:
        one, other = _shifted(used, *lag)
        pairs[lag] = int((one & other).sum())
        if not pairs[lag]:
            continue
        one, other = _shifted(left, *lag)
        observed[lag] = float((one * other).sum())
        independent = -share * float(np.trace(taken[lag], axis1=1, axis2=2).sum())
        if abs(observed[lag] - independent) > SURE * np.sqrt(pairs[lag]):
            known.append(lag)
    if len(known) == 1:
        return np.ones(len(used))
    matrix, sums = _equations(known, taken, share, pairs, observed)
    covariance = np.asarray(np.linalg.lstsq(matrix, sums)[0], dtype=np.float64)
    if not (np.abs(covariance[1:]) <= covariance[0]).all() or not covariance[0] <= MOST_TAKEN:
        # so much is taken up that distances can't be told apart
        known = [(0, 0), *(lag for lag in LAGS if pairs[lag])]
        covariance = _as_blurred(known, *_equations(known, taken, share, pairs, observed))
    alone = (own * own).sum(axis=(1, 2, 3))
    together = covariance[0] * alone
    for value, lag in zip(covariance[1:], known[1:], strict=True):
        one, other = _shifted(own, *lag)
        together += 2.0 * value * (one * other).sum(axis=(1, 2, 3))
    stated = count / np.maximum(count - slopes.shape[1], 1)
    ratio = together / np.where(alone > 0, alone * stated, 1.0)
    return np.asarray(np.sqrt(np.maximum(ratio, 1.0)))


def _equations(
    known: list[Lag],
    taken: dict[Lag, FloatArray],
    share: float,
    pairs: dict[Lag, int],
    observed: dict[Lag, float],
) -> tuple[FloatArray, FloatArray]:
    """Matrix and right-hand side for the covariance at the distances ``known``, 0 at others."""
    matrix = np.array([[share * _left_over(taken, d, k) for k in known] for d in known])
    matrix += np.diag([float(pairs[lag]) for lag in known])
    return matrix, np.array([observed[lag] for lag in known])


def _as_blurred(known: list[Lag], matrix: FloatArray, sums: FloatArray) -> FloatArray:
    """The covariance of white noise behind a Gaussian blur that fits the equations best."""
    square = np.array([float(d * d + a * a) for d, a in known])
    best, found = np.inf, np.zeros(len(known))
    for blur in BLURS:
        alike = np.exp(-square / (4.0 * blur * blur))
        left = matrix @ alike
        scale = float(left @ sums / max(float(left @ left), 1e-300))
        error = float(np.square(sums - scale * left).sum())
        if error < best:
            best, found = error, scale * alike
    return found


def _overlaps(slopes: FloatArray) -> dict[Lag, FloatArray]:
    """G(m) = sum_i Q_(i+m) Q_i^T of each fit, (C, P, P), by distance m up to twice the reach."""
    count, number = slopes.shape[:2]
    flat = slopes.reshape(count, number, -1).transpose(0, 2, 1)
    basis = np.linalg.qr(flat)[0].transpose(0, 2, 1).reshape(slopes.shape)
    found = {}
    for down in range(2 * REACH + 1):
        for across in range(-2 * REACH, 2 * REACH + 1):
            one, other = (v.reshape(count, number, -1) for v in _shifted(basis, down, across))
            found[down, across] = other @ one.transpose(0, 2, 1)
            found[-down, -across] = found[down, across].transpose(0, 2, 1)
    return found


def _left_over(taken: dict[Lag, FloatArray], at: Lag, of: Lag) -> float:
    """Sum over pairs at distance ``at`` of H S H - H S - S H, S = 1 at the distances +-``of``."""
    if of == (0, 0):
        return -float(np.trace(taken[at], axis1=1, axis2=2).sum())
    both = taken[of] + taken[-of[0], -of[1]]
    inner = np.einsum("cij,cji->", both, taken[at])
    ends = taken[at[0] + of[0], at[1] + of[1]] + taken[at[0] - of[0], at[1] - of[1]]
    return float(inner - 2.0 * np.trace(ends, axis1=1, axis2=2).sum())


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
