"""The outer loop: runs of conjugate gradients inside a float64 refinement, load case by load case.

On the host load cases are iterated each by itself: what a case takes doesn't depend on the others
then, nor do its numbers, however many processors there are. Short array operations gain little from
threads (the interpreter lock), so cases are shared out to copies of the process
(`gpusim.parallel.processes`): as long as there is a processor for it, a second case costs little
more than its memory.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gpusim.arrays.array_types import Bool, Float
from gpusim.errors import NotConverged
from gpusim.fem.assembly.stiffness_rounding import check_finite
from gpusim.fem.assembly.system import System
from gpusim.fem.krylov.error_estimates import (
    LOOSEST,
    VISIBLE,
    Estimates,
    Norm,
    RoundingError,
    extent,
    rounded,
)
from gpusim.parallel.processes import in_copies

# share of the tolerance up to which rounding leaves conjugate gradients enough of it
_LITTLE = 0.5
_MOST_REFINEMENTS = 12
# share of the tolerance that the first run of conjugate gradients may leave, and a later one
_AIM, _LATER_AIM = 0.7, 0.15
# share of the tolerance to which r.z must have fallen, by the plain bound that is stated
_ENOUGH = 0.95
# ratio of stiffnesses from node to node beyond which the loads may not feel all soft modes, and
# how much closer to go there
UNEVEN_STIFFNESS, _UNEVEN_AIM = 1e3, 0.03
# share of the tolerance within which a start counts as right by what its residual may do: the least
# eigenvalue that this rests on may be several times too large
_NEAR = 0.1
# where the true residual has reached its own rounding, what a run left and what it moved the
# solution by stand for the error, with this factor of safety
_SAFETY = 3.0
Progress = Callable[[int, float], None]

# a copy of the process takes some 5 ms, the iterations of this many unknowns several times that
_LEAST_UNKNOWNS = 5_000


@dataclass(frozen=True, eq=False)
class Outcome:
    """Displacements (L,N,3) in the model's units, and how the iteration ended; ``forces`` are
    K u (L,N,3), if they were formed for the last estimate. ``method``, ``backend`` and ``real``
    tell how it came about."""

    u: Float
    converged: bool
    error_estimate: float
    iterations: int
    residuals: Float
    message: str
    forces: Float | None = None
    method: str = "multigrid"
    backend: str = "numpy"
    real: str = "f64"


def iterate(
    system: System,
    loop: Any,
    norm: Norm,
    start: Float | None,
    *,
    rounding: RoundingError,
    tolerance: float,
    most: int,
    progress: Callable[[int, float], None] | None,
) -> Outcome:
    """Run until the estimate of every load case is at or below ``tolerance``.

    Each run of conjugate gradients solves for a correction from the true residual, formed in
    float64 on the host. The estimate that counts is that of the true residual,
    ||e||_A <= sqrt(r . M^-1 r / mu); inside a run the Gauss-Radau bound decides.

    Where rounding keeps the true residual from falling, that bound stays above the tolerance
    however good the solution is, because it puts the whole residual into the softest mode. The
    size of the last correction then tells the error: it solves for the same rounding. The
    solution counts as converged if the run that gave it ended within its own bound and moved the
    solution by little; the estimate is the sum of both, times a factor of safety.

    ``rounding`` tells what the rounding of K itself leaves open, which is added. Where that is much
    of the tolerance, refinement goes on with forces by deformation.
    """
    refinement = _Refinement(system, loop, norm, start, tolerance, most, progress)
    refinement.run(system)
    rounding_error = rounding(system, refinement.total)
    if rounding_error > VISIBLE * tolerance and refinement.iterations < most:
        system = system.by_deformation()
        refinement.run(system)
        rounding_error = min(rounding_error, rounding(system, refinement.total))
    if (
        refinement.beyond(rounding_error)
        and rounding_error <= _LITTLE * tolerance
        and refinement.iterations < most
    ):
        # both together were too much, and this part can still be made smaller
        refinement.run(system, tolerance - rounding_error)
    return refinement.outcome(system, rounding_error)


class _Refinement:
    """The solution so far; goes from one form of the system to another."""

    def __init__(
        self,
        system: System,
        loop: Any,
        norm: Norm,
        start: Float | None,
        tolerance: float,
        most: int,
        progress: Callable[[int, float], None] | None,
    ) -> None:
        self._loop, self._tolerance, self._most = loop, tolerance, most
        self._progress = progress
        self._factor = (system.scale / system.load_scale)[:, None, None]
        self._begun = start is not None
        self._x = np.zeros_like(system.right)
        if start is not None:
            self._x = np.where(system.free, start * self._factor, 0.0)
        self._state = Estimates(system, norm)
        self.iterations = 0
        self._histories: list[Float] = []
        self._first: Float | None = None
        self._inside, self._note = min(tolerance, LOOSEST), ""
        if system.contrast > UNEVEN_STIFFNESS:
            self._note = self._state.probe(loop, most)
            self._inside *= _UNEVEN_AIM

    @property
    def total(self) -> Float:
        """The scaled solution, prescribed displacements included."""
        return self._x + self._state.given

    def beyond(self, rounding: float) -> bool:
        """Whether the estimate is within the tolerance, but not with ``rounding`` added."""
        estimate = float(np.maximum(self._estimate, self._state.floor).max())
        return estimate <= self._tolerance < estimate + rounding

    def run(self, system: System, tolerance: float | None = None) -> None:
        """As far as one form of the system leads; to another ``tolerance`` if that is given."""
        state, loop, most = self._state, self._loop, self._most
        tolerance = self._tolerance if tolerance is None else tolerance
        cases = len(system.right)
        self._estimate = np.full(cases, np.inf)
        self._message = f"stopped after {most} iterations"
        inside, drift = np.full(cases, np.inf), np.full(cases, np.inf)
        remaining = np.full(cases, np.inf)
        self._image: Float | None = None
        for refinement in range(_MOST_REFINEMENTS):
            x = self._x
            self._image = system.apply(x) if self._begun else np.zeros_like(x)
            residual = system.right - self._image
            residual = np.where(system.free, residual, 0.0).reshape(cases, -1)
            if refinement == 1 and not state.probed:
                spread = state.apart(residual, loop.residual(), x)
                if bool((remaining + spread <= tolerance).all()):
                    self._estimate, self._message = remaining + spread, "converged"
                    break
            rz = loop.begin(residual)
            check_finite(rz[None, :, None], "the preconditioned residual")
            self._first = rz if self._first is None else self._first
            if refinement or self._begun:
                before = self._estimate
                softness = state.by_softness(rz, loop, self.total, tolerance)
                self._estimate = estimate = np.minimum(state.by_rz(rz, x), softness)
                if bool((estimate <= tolerance).all()):
                    self._message = "converged"
                    break
                settled = _SAFETY * (inside + drift) <= tolerance
                if refinement > 1 and bool((settled | (estimate <= tolerance)).all()):
                    self._estimate = np.minimum(estimate, _SAFETY * (inside + drift))
                    self._message = "converged to the rounding of the residual"
                    break
                stuck = refinement > 1 and not (estimate.max() <= 0.5 * before.max())
                if stuck and self.iterations < most:
                    error = f"{estimate.max():.2g}"
                    self._message = f"stagnated at an estimated relative error of {error}"
                    break
            if self.iterations >= most:
                break
            _refuse_indefinite(system, rz < 0.0)
            aim = _LATER_AIM if refinement else _AIM
            off = state.apart(residual, np.zeros_like(residual), x)
            near = off <= _NEAR * tolerance
            state.floor = np.where(near & ~np.isfinite(state.mu), off, state.floor)
            correction, history, inside, remaining = self._conjugate_gradients(
                system, rz, near, aim * self._inside, _ENOUGH * tolerance
            )
            self._x, self._image, self._begun = x + correction, None, True
            loop.keep()
            size = state.size(self.total)
            drift = extent(correction, even=False) / np.where(size > 0.0, size, 1e-300)
            self.iterations += len(history)
            self._histories.append(history)
            if state.doubtful(self.iterations, aim * self._inside):
                self._note = state.probe(loop, most)
                self._inside = tolerance  # they are known now
        else:
            self._message = f"stopped after {_MOST_REFINEMENTS} refinements"

    def _conjugate_gradients(
        self, system: System, rz: Float, near: Bool, aim: float, enough: float
    ) -> tuple[Float, Float, Float, Float]:
        """One run from the residual that the loop holds, whose r.z are ``rz``; returns (correction,
        history, estimate, what to state).

        It ends where the sharp bound is at ``aim``, and the plain one by r.z, which is stated, at
        ``enough``, or the softness of what is left says so: another run for the rest would begin
        anew. Where supports are moved, or there is a start, a first one must have come far for its
        own correction, too: beside a far motion, or a start that is nearly right, any correction is
        small, and its Ritz values would tell nothing of the soft modes. Cases that are known to be
        ``near`` (L,) needn't.
        """
        loop, state, x, most = self._loop, self._state, self._x, self._most - self.iterations
        history = np.zeros((0, len(rz), 4))
        moved = state.given.any(axis=(1, 2)) | x.any(axis=(1, 2))
        told = np.isfinite(state.mu)
        fresh = ~told & moved & ~near
        active = rz > 0.0
        estimate = np.where(active, np.inf, 0.0)
        stated = estimate.copy()
        correction, base = np.zeros_like(system.right), x + state.given
        while active.any() and len(history) < most:
            lines = loop.run(1, active)
            check_finite(lines, "conjugate gradients")
            bent = active & ((lines[:, :, 3] <= 0.0) & (lines[:, :, 0] > 0.0)).any(axis=0)
            if bent.any():
                case = system.first_case + np.flatnonzero(bent)[0]
                raise NotConverged(
                    f"conjugate gradients: negative curvature in load case {case}; got "
                    f"p.Kp = {lines[:, bent, 3].min():.3g}; expected a positive definite stiffness"
                )
            _refuse_indefinite(system, (active & (lines[:, :, 2] < 0.0)).any(axis=0))
            history = np.concatenate([history, lines])
            state.learn(history)
            before, correction = correction, loop.correction().reshape(x.shape)
            total = base + correction
            size, (energy, by_residual) = state.size(total), state.energies(history)
            estimate = np.where(active, state.over(energy, size), estimate)
            stated = np.where(active, state.over(by_residual, size), stated)
            far = state.over(energy, extent(correction, even=False)) <= LOOSEST
            done = (estimate <= aim) & (stated <= enough)
            if (active & (far | told) & ~done).any():
                state.follow(correction - before, correction, history, total)
                rz = history[-1, :, 0] * history[-1, :, 2]
                softness = state.by_softness(rz, loop, total, enough)
                softness = np.where(active & (far | told), softness, np.inf)
                estimate, stated = np.minimum(estimate, softness), np.minimum(stated, softness)
                done |= softness <= enough
            active &= ~(done & (far | ~fresh))
            if self._progress is not None:
                self._progress(self.iterations + len(history), float(estimate.max()))
        return correction, history, estimate, stated

    def outcome(self, system: System, rounding: float) -> Outcome:
        """By the form of the system refined last; ``rounding`` is added to the estimate."""
        estimates = np.maximum(self._estimate, self._state.floor)
        converged = bool((estimates <= self._tolerance).all())
        message, estimate = self._message, float(estimates.max()) + rounding
        if converged and not estimate <= self._tolerance:
            converged, message = False, rounded(estimate)
        residuals = np.zeros((0, len(self._estimate)))
        if self._histories and self._first is not None:
            lines, first = np.concatenate(self._histories)[:, :, 0], self._first
            residuals = np.sqrt(np.maximum(lines, 0.0) / np.where(first > 0.0, first, 1.0))
        u = np.where(system.free, self._x / self._factor, system.prescribed)
        forces = None if self._image is None else system.forces(self._image)
        return Outcome(
            u, converged, estimate, self.iterations, residuals, message + self._note, forces
        )


def _refuse_indefinite(system: System, bad: Bool) -> None:
    """``bad`` (L,): where r.z is negative."""
    if bad.any():
        raise NotConverged(
            "conjugate gradients: the preconditioner isn't positive definite in load case "
            f"{system.first_case + np.flatnonzero(bad)[0]}; got r.z < 0 (are materials or "
            "element sizes extremely unequal?); expected r.z > 0, or method 'direct'"
        )


def each_case(
    solve: Callable[[System, Float | None, Progress | None], Outcome],
    system: System,
    start: Float | None,
    progress: Progress | None,
) -> Outcome:
    """``solve`` for each load case of the system, from ``start`` (L,N,3), on the host.

    ``progress`` hears of the cases that are solved in this process. The first case's error is
    raised, if several have one.
    """
    cases = len(system.right)
    if cases == 1:
        return solve(system, start, progress)
    done, here = 0, os.getpid()

    def one(case: int) -> Outcome:
        nonlocal done
        before = done

        def report(iterations: int, error: float) -> None:
            assert progress is not None
            progress(before + iterations, error)

        begin = None if start is None else start[case : case + 1]
        # in a copy there is nobody to hear: what a program does there would be lost, or done twice
        hears = progress is not None and os.getpid() == here
        outcome = solve(system.case(case), begin, report if hears else None)
        done += outcome.iterations
        return outcome

    if int(system.free.sum()) < _LEAST_UNKNOWNS:
        return _joined([one(case) for case in range(cases)])
    return _joined(in_copies(one, cases))


def _joined(outcomes: Sequence[Outcome]) -> Outcome:
    """All cases in one, told about as the worst of them: the residuals of those that took fewer
    iterations stay as they ended."""
    worst = max(outcomes, key=lambda one: (not one.converged, one.error_estimate))
    most = max(len(one.residuals) for one in outcomes)
    forces = [one.forces for one in outcomes if one.forces is not None]
    return Outcome(
        np.concatenate([one.u for one in outcomes]),
        all(one.converged for one in outcomes),
        worst.error_estimate,
        max(one.iterations for one in outcomes),
        np.concatenate([_stretched(one.residuals, most) for one in outcomes], axis=1),
        worst.message,
        np.concatenate(forces) if len(forces) == len(outcomes) else None,
    )


def _stretched(residuals: Float, count: int) -> Float:
    """(k,1) to (count,1) by the last line."""
    if len(residuals) in (0, count):
        return residuals if len(residuals) else np.zeros((count, 1))
    return np.concatenate([residuals, np.repeat(residuals[-1:], count - len(residuals), axis=0)])
