"""Iterative refinement around a direct solver, and the error that it shows."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.fem.assembly.stiffness_rounding import check_finite, indefinite
from gpusim.fem.assembly.system import System
from gpusim.fem.direct_solvers.banded_cholesky import BandedFactor
from gpusim.fem.direct_solvers.substructuring import SubstructuredFactor
from gpusim.fem.krylov.error_estimates import VISIBLE, rounded
from gpusim.fem.krylov.outer_iteration import Outcome

_MOST = 20
# a correction that is not at least this much smaller than the one before has met rounding
_CONTRACTION = 0.5
# safety on the factor by which corrections shrink, and the least that is believed of it
_CAUTION, _LEAST_SHARE = 100.0, 1e-3
# a relative error beyond which there is no solution: whether the factorisation of a singular
# stiffness breaks down is a matter of the last digits, which differ between processors
_SINGULAR = 0.1


def refine(
    system: System,
    factor: BandedFactor | SubstructuredFactor,
    *,
    tolerance: float,
    progress: Callable[[int, float], None] | None,
) -> Outcome:
    """Corrections x += K^-1 (f - K x) with the float64 residual in differences.

    The size of a correction is the error of the solution before it, as long as corrections
    shrink; the estimate is the last correction's greatest displacement over the solution's, plus
    what the rounding of K leaves open (``gpusim.fem.assembly.stiffness_rounding``; found once for
    all load cases). Where that is much of the tolerance, residuals are formed by deformation. The
    error after a correction is smaller by the factor by which corrections shrink once more: a
    hundred times that factor (at least 0.001) is believed where the tolerance asks for it, and the
    tolerance is what is stated then. One correction at least is always made, so the estimate rests
    on a measured residual.

    Raises NotConverged where float64 can't tell the stiffness from a singular one.
    """
    shape, cases, sharp = system.right.shape, len(system.right), False
    given = system.prescribed * (system.scale / system.load_scale)[:, None, None]
    x = factor.apply(system.right.reshape(cases, -1)).reshape(shape)
    before = _size(x)
    history = [np.ones(cases)]
    estimate = blur = np.full(cases, np.inf)
    message = f"stopped after {_MOST} refinements"
    for number in range(_MOST):
        check_finite(x, "direct solver")
        if number:
            correction = factor.apply(_residual(system, x))
        else:
            correction, blur = _first_correction(system, factor, x, given)
            if not bool((blur <= VISIBLE * tolerance * _size(x + given)).all()):
                system, sharp = system.by_deformation(), True
                by_rows = blur
                correction, blur = _first_correction(system, factor, x, given)
                blur = np.minimum(blur, by_rows)
        correction = correction.reshape(shape)
        x = x + correction
        check_finite(x, "direct solver")
        size = _size(x + given)
        size = np.where(size > 0.0, size, 1e-300)
        change = _size(correction)
        history.append(change / np.where(before > 0.0, before, 1.0) * history[-1])
        # each correction is smaller than the one before by a factor that it shows itself
        shrinks = np.clip(
            _CAUTION * change / np.where(before > 0.0, before, 1.0), _LEAST_SHARE, 1.0
        )
        estimate = (change + blur) / size
        reached = bool(((change * shrinks + blur) / size <= tolerance).all())
        if progress is not None:
            progress(number + 1, float(estimate.max()))
        if reached:
            estimate = np.minimum(estimate, tolerance)
            message = "converged"
            break
        if not bool((change <= np.maximum(_CONTRACTION * before, blur)).all()):
            message = f"stagnated at an estimated relative error of {estimate.max():.2g}"
            break
        if bool((change <= blur).all()):
            message = rounded(float(estimate.max()))
            break
        before = change
    factor_of = (system.scale / system.load_scale)[:, None, None]
    u = np.where(system.free, x / factor_of, system.prescribed)
    good = bool((estimate <= tolerance).all())
    if not good and not estimate.max() <= _SINGULAR:
        raise indefinite("direct solver", float(estimate.max()))
    forces = system.forces(system.apply(x)) if sharp else None
    return Outcome(u, good, float(estimate.max()), len(history), np.stack(history), message, forces)


def _residual(system: System, x: Float) -> Float:
    """(L,n)."""
    residual = np.where(system.free, system.right - system.apply(x), 0.0)
    return np.asarray(residual.reshape(len(x), -1))


def _first_correction(
    system: System, factor: BandedFactor | SubstructuredFactor, x: Float, given: Float
) -> tuple[Float, Float]:
    """The first correction (L,n), and what the rounding of K does to the displacements (L,)."""
    size = _size(x + given)
    forces = np.where(system.free, system.rounding(x + given), 0.0).reshape(len(x), -1)
    worst = _worst(forces / np.where(size > 0.0, size, 1.0)[:, None])
    solved = factor.apply(np.concatenate([_residual(system, x), worst]))
    return solved[:-1], np.abs(solved[-1]).max() * size


def _size(u: Float) -> Float:
    """(L,) greatest displacements of (L,N,3)."""
    return np.asarray(np.abs(u).max(axis=(1, 2)))


def _worst(forces: Float) -> Float:
    """(1,n): the greatest of all load cases' forces (L,n), with its sign: one solution with them
    tells what they do, whichever case they come from."""
    at = np.abs(forces).argmax(axis=0)
    return np.asarray(np.take_along_axis(forces, at[None], axis=0))
