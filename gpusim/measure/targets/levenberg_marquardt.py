"""Many small least-squares problems at once (Levenberg-Marquardt, damped by the diagonal).

Marquardt, "An algorithm for least-squares estimation of nonlinear parameters", J. SIAM 11 (1963).
Each problem has its own damping and stops by itself; the arithmetic is batched over all of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gpusim.arrays.array_types import Bool, Float, Long

Model = Callable[[Float, Long], tuple[Float, Float]]

FIRST_DAMPING = 1e-3
MAX_DAMPING = 1e8
MIN_DAMPING = 1e-7
# in a kink, as where a sharp border lies between two columns of pixels, steps go to and fro across
# the valley and hardly down: a fit that gained no more than this share by so many is there
MIN_GAIN, GAIN_STEPS = 1e-4, 4
# noise makes the kink jagged, and no step is the last: at the end this much will do, less than what
# an error of one standard deviation adds to the squares of a thousand samples
LAST_GAIN = 1e-3

# a parameter that stays above 0 grows at most by this in a step: near 0 its slope may hold no
# further than a hair, and where it leads to no step is taken until all of them are tiny
MOST_GROWTH = 16.0


@dataclass(frozen=True)
class ManyFits:
    """C fits of Q parameters.

    Attributes
    ----------
    parameters : (C, Q) float64.
    rms : (C,) RMS of the residuals.
    covariance : (C, Q, Q), from the residuals and the slopes at the end.
    converged : (C,) bool; steps became smaller than the tolerance, or hardly go down any more.
    """

    parameters: Float
    rms: Float
    covariance: Float
    converged: Bool


def fit_many(
    model: Model,
    start: Float,
    weight: Float,
    scale: Float,
    *,
    lower: Float | None = None,
    tolerance: float = 1e-6,
    iterations: int = 40,
) -> ManyFits:
    """Minimise the weighted squares of many residuals.

    Parameters
    ----------
    model : (parameters (K, Q), which problems (K,)) -> residuals (K, P), slopes (K, Q, P).
    start : (C, Q).
    weight : (C, P), 0 for samples that don't count.
    scale : (Q,) sizes of a step in each parameter that is one unit; a fit has converged when its
        step is below ``tolerance`` in all of them.
    lower : (Q,) least values of the parameters, or None. One that is there and would go further
        down is held while the others take their step; one that is above 0 grows by `MOST_GROWTH`.
    """
    count = len(start)
    p = start.copy()
    damping = np.full(count, FIRST_DAMPING)
    converged = np.zeros(count, dtype=bool)
    active = np.arange(count)
    normal, gradient, square = _normal(model, p, active, weight)
    earlier, steps = square.copy(), np.zeros(count, dtype=np.int64)
    gained = np.full(count, np.inf)
    for _ in range(iterations):
        least = None if lower is None else p[active] <= lower
        step = _damped_steps(normal[active], -gradient[active], damping[active, None], least)
        new = p[active] + step
        if lower is not None:
            most = np.where(lower > 0.0, MOST_GROWTH * p[active], np.inf)
            new = np.clip(new, lower, most)
            step = new - p[active]
        small = np.asarray((np.abs(step) <= tolerance * scale).all(axis=1))
        # the last step of a fit that is hardly damped needs no look at what it changes
        last = small & (damping[active] <= FIRST_DAMPING)
        p[active[last]], converged[active[last]] = new[last], True
        active, new, small = active[~last], new[~last], small[~last]
        if not active.size:
            break
        new_normal, new_gradient, new_square = _normal(model, new, active, weight)
        better = new_square <= square[active]  # false for NaN
        taken = active[better]
        p[taken] = new[better]
        normal[taken], gradient[taken] = new_normal[better], new_gradient[better]
        square[taken] = new_square[better]
        steps[taken] += 1
        damping[taken] = np.maximum(0.1 * damping[taken], MIN_DAMPING)
        damping[active[~better]] *= 10.0
        converged[active[small]] = True
        # where no damping makes a step go down any more, rounding decides: that is the minimum too
        stuck = damping[active] > MAX_DAMPING
        due = better & (steps[active] % GAIN_STEPS == 0)
        row = active[due]
        gained[row], earlier[row] = earlier[row] - square[row], square[row]
        stuck |= due & (gained[active] <= MIN_GAIN * square[active])
        converged[active[stuck]] = True
        active = active[~small & ~stuck]
    # by the last whole row of steps, and since
    gain = np.maximum(gained, earlier - square)[active]
    converged[active] = gain <= LAST_GAIN * square[active]
    covariance = _covariance(normal, square, (weight > 0).sum(axis=1))
    total = np.maximum(weight.sum(axis=1), 1e-300)
    return ManyFits(p, np.sqrt(square / total), covariance, converged)


def _damped_steps(normal: Float, down: Float, damping: Float, least: Bool | None) -> Float:
    """Steps (K, Q) by normal matrices and gradients ``down`` the slope, both of which are changed;
    parameters that are ``least`` (K, Q) don't go further down."""
    diagonal = np.arange(normal.shape[1])
    main = normal[:, diagonal, diagonal]
    floor = 1e-12 * main.max(axis=1, keepdims=True) + 1e-300
    normal[:, diagonal, diagonal] = main + damping * main + floor
    if least is not None:
        held = least & (down <= 0)
        normal[held[:, :, None] | held[:, None, :]] = 0.0
        normal[:, diagonal, diagonal] += held
        down[held] = 0.0
    return np.asarray(np.linalg.solve(normal, down[..., None])[..., 0])


def _normal(model: Model, p: Float, rows: Long, weight: Float) -> tuple[Float, Float, Float]:
    """Normal matrices, gradients and squares of the problems ``rows``, at parameters ``p``."""
    residual, slopes = model(p, rows)
    own = weight[rows]
    weighted = slopes * own[:, None, :]
    normal = weighted @ slopes.transpose(0, 2, 1)
    gradient = (weighted @ residual[..., None])[..., 0]
    square = np.einsum("kp,kp->k", own, residual * residual)
    return normal, gradient, square


def _covariance(normal: Float, square: Float, samples: Long) -> Float:
    """(C, Q, Q), from normal matrices and the squares that so many samples leave."""
    size = normal.shape[1]
    main = normal[:, np.arange(size), np.arange(size)]
    # a parameter that changes nothing (a blur of none) is left out of the others' covariance
    main = np.sqrt(np.maximum(main, 1e-24 * main.max(axis=1, keepdims=True) + 1e-200))
    scaled = normal / (main[:, :, None] * main[:, None, :]) + 1e-14 * np.eye(size)
    inverse = np.linalg.inv(scaled) / (main[:, :, None] * main[:, None, :])
    return np.asarray(inverse * (square / np.maximum(samples - size, 1))[:, None, None])
