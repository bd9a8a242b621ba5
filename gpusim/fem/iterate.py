"""The outer loop: runs of conjugate gradients inside a float64 refinement."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.errors import NotConverged
from gpusim.fem.blur import VISIBLE, Blur, extent, rounded
from gpusim.fem.indefinite import check_finite
from gpusim.fem.probe import probe
from gpusim.fem.stopping import energy_bound, smallest_ritz_value
from gpusim.fem.system import System

__all__ = ["HARSH", "Norm", "Outcome", "iterate"]

Float = npt.NDArray[np.float64]

# a Ritz value lies slightly above the eigenvalue that the bounds ask for
_BELOW = 0.9
_MOST_REFINEMENTS = 12
# share of the tolerance that the first run of conjugate gradients may leave, and a later one
_AIM, _LATER_AIM = 0.7, 0.15
# share of the tolerance to which r.z must have fallen, by the plain bound that is stated
_ENOUGH = 0.95
# ratio of stiffnesses from node to node beyond which the loads may not feel all soft modes, and
# how much closer to go there
HARSH, _HARSH_AIM = 1e3, 0.03
# a Ritz value below which the preconditioner is poor, and iterations per decimal beyond which it
# is: the loads may not feel all soft modes then, either
_POOR, _MANY = 0.03, 5.0
# iterations that may be spent on such modes where they give no bound
_GLANCE = 40
# a run goes this far at least: after a few steps Ritz values tell little
_LOOSEST = 1e-3
# where the true residual has reached its own rounding, what a run left and what it moved the
# solution by stand for the error, with this factor of safety
_SAFETY = 3.0
# a Ritz value below this tells of motions that the coarse levels, and ``Norm.lowest``, don't see
_UNSEEN = 1e-6
# iterations in half a run from which on its Ritz values can tell anything
_LEAST_HALF = 10


@dataclass(frozen=True, eq=False)
class Norm:
    """The norm of the stopping rule: sum of squares, or u.D u with blocks (N,3,3).

    ``lowest`` is the least eigenvalue of N^-1 K'; None: the smallest Ritz value serves, or
    ``softest``, a Rayleigh quotient of M^-1 K' near the least eigenvalue, if that is smaller.
    ``sought``: soft modes have been looked for already, as ``probe`` does.
    """

    blocks: Float | None
    lowest: float | None
    sought: bool = False
    softest: float = np.inf

    def size(self, u: Float, even: bool = False) -> Float:
        """(L,) norms of (L,N,3); ``even``: see `gpusim.fem.blur.extent`."""
        if self.blocks is None:
            return extent(u, even)
        image = np.matmul(self.blocks, u[..., None])[..., 0]
        return np.asarray(np.sqrt(np.maximum(np.einsum("lni,lni->l", u, image), 0.0)))


@dataclass(frozen=True, eq=False)
class Outcome:
    """Displacements (L,N,3) in the model's units, and how the iteration ended; ``forces`` are
    K u (L,N,3), if they were formed for the last estimate."""

    u: Float
    converged: bool
    error_estimate: float
    iterations: int
    residuals: Float
    message: str
    forces: Float | None = None


class _State:
    """Least Ritz value so far and the estimates per load case.

    Where the Ritz value is all that is known of the least eigenvalue, it must have settled: it
    may not have halved during the last half of a run of some length. Before that there is no
    estimate.
    """

    def __init__(self, system: System, norm: Norm) -> None:
        self.system, self.norm = system, norm
        self.mu = np.full(len(system.right), np.inf)
        self.settled = np.full(len(system.right), norm.lowest is not None)
        self.given = system.prescribed * (system.scale / system.load_scale)[:, None, None]
        self.lowest, self.probed = norm.lowest, False

    def doubtful(self, iterations: int, tolerance: float) -> bool:
        """Whether there may be soft modes that the loads haven't told of, by a first run."""
        if self.probed or self.lowest is None:
            return False
        many = iterations > _MANY * -np.log10(tolerance) and not self.norm.sought
        return bool((self.mu < _POOR).any()) or many

    def probe(self, loop: Any, most: int) -> str:
        """Look for them; the loop's run is lost. Returns what to say of it."""
        bounded = self.lowest is not None
        found = probe(self.system, loop, most if bounded else _GLANCE)
        self.probed = True
        self.mu = np.minimum(self.mu, found.mu)
        if self.lowest is not None:
            self.lowest = min(self.lowest, found.lowest)
            self.settled &= found.settled
        return f" ({found.iterations} more iterations looked for soft modes)"

    def learn(self, history: Float) -> None:
        for case in range(len(self.mu)):
            lowest = smallest_ritz_value(history[:, case, 1], history[:, case, 2])
            self.mu[case] = min(self.mu[case], lowest, self.norm.softest)
            if not self.settled[case]:
                half = history[: len(history) // 2, case]
                before = smallest_ritz_value(half[:, 1], half[:, 2])
                self.settled[case] = len(half) >= _LEAST_HALF and before <= 2.0 * lowest

    def left(self, history: Float, rz: Float, x: Float) -> Float:
        """Estimates (L,) by r.z after a run, which are above the bounds that stopped it; ``rz``
        before it."""
        for line in history:
            # a case at rest has neither step nor change
            rz = np.where(line[:, 1] > 0.0, line[:, 0] * line[:, 2], rz)
        known = np.isfinite(self.mu) | ~(rz > 0.0)
        energy = np.sqrt(np.maximum(rz, 0.0) / (_BELOW * np.where(known, self.mu, 1.0)))
        return np.where(known, self.relative(energy, x), np.inf)

    def apart(self, residual: Float, expected: Float | None, x: Float) -> Float:
        """Relative displacement error (L,) from what the true residual (L,n) has more than the
        one that the loop went by: ||A^-1 d||_A <= ||d|| / sqrt(least eigenvalue)."""
        if expected is None or self.lowest is None or self.norm.blocks is not None:
            return np.full(len(residual), np.inf)
        gap = np.where(self.system.free.ravel(), residual - expected, 0.0)
        size = np.sqrt(np.einsum("ln,ln->l", gap, gap))
        return self.relative(size / np.sqrt(_BELOW * self.lowest), x)

    def relative(self, energy: Float, x: Float) -> Float:
        """Estimated relative displacement error for energy-norm errors (L,)."""
        return self.over(energy, self.size(x + self.given))

    def size(self, total: Float) -> Float:
        """What errors (L,) are relative to, for complete displacements (L,N,3)."""
        return self.norm.size(total, even=bool(self.given.any()))

    def over(self, energy: Float, size: Float) -> Float:
        """The same for solutions whose norms are ``size`` (L,)."""
        lowest = _BELOW * self.mu
        if self.lowest is not None:
            lowest = _BELOW * self.lowest * np.minimum(1.0, self.mu / _UNSEEN)
        bound = np.where(self.settled, energy / np.sqrt(lowest), np.inf)
        relative = np.divide(bound, size, out=np.full_like(bound, np.inf), where=size > 0.0)
        return np.where(energy > 0.0, relative, 0.0)


def iterate(
    system: System,
    loop: Any,
    norm: Norm,
    start: Float | None,
    *,
    blur: Blur | None = None,
    tolerance: float,
    most: int,
    chunk: int,
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

    ``blur`` tells what the rounding of K itself leaves open, which is added. Where that is much of
    the tolerance, refinement goes on with forces by deformation.
    """
    refinement = _Refinement(system, loop, norm, start, tolerance, most, chunk, progress)
    refinement.run(system)
    left = 0.0 if blur is None else blur(system, refinement.total)
    if left > VISIBLE * tolerance and refinement.iterations < most:
        system = system.by_deformation()
        refinement.run(system)
        assert blur is not None
        left = min(left, blur(system, refinement.total))
    return refinement.outcome(system, left)


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
        chunk: int,
        progress: Callable[[int, float], None] | None,
    ) -> None:
        self._loop, self._tolerance, self._most = loop, tolerance, most
        self._chunk, self._progress = chunk, progress
        self._factor = (system.scale / system.load_scale)[:, None, None]
        self._begun = start is not None
        self._x = np.zeros_like(system.right)
        if start is not None:
            self._x = np.where(system.free, start * self._factor, 0.0)
        self._state = _State(system, norm)
        self.iterations = 0
        self._histories: list[Float] = []
        self._first: Float | None = None
        self._inside, self._note = min(tolerance, _LOOSEST), ""
        if system.contrast > HARSH:
            self._note = self._state.probe(loop, most)
            self._inside *= _HARSH_AIM

    @property
    def total(self) -> Float:
        """The scaled solution, prescribed displacements included."""
        return self._x + self._state.given

    def run(self, system: System) -> None:
        """As far as one form of the system leads."""
        state, loop, tolerance, most = self._state, self._loop, self._tolerance, self._most
        cases, norm = len(system.right), state.norm
        self._estimate = np.full(cases, np.inf)
        self._message = f"stopped after {most} iterations"
        inside, drift = np.full(cases, np.inf), np.full(cases, np.inf)
        left = np.full(cases, np.inf)
        self._image: Float | None = None
        for refinement in range(_MOST_REFINEMENTS):
            x = self._x
            self._image = system.apply(x) if self._begun else np.zeros_like(x)
            residual = system.right - self._image
            residual = np.where(system.free, residual, 0.0).reshape(cases, -1)
            if refinement == 1 and not state.probed:
                spread = state.apart(residual, loop.residual(), x)
                if bool((left + spread <= tolerance).all()):
                    self._estimate, self._message = left + spread, "converged"
                    break
            rz = loop.begin(residual)
            check_finite(rz[None, :, None], "the preconditioned residual")
            self._first = rz if self._first is None else self._first
            if refinement or self._begun:
                before = self._estimate
                # a case without load takes no step and needs no estimate
                known = np.isfinite(state.mu) | ~(rz > 0.0)
                energy = np.sqrt(np.maximum(rz, 0.0) / (_BELOW * np.where(known, state.mu, 1.0)))
                # r.z below zero says nothing of the error, least of all that there is none
                none = np.where(rz < 0.0, np.inf, 0.0)
                self._estimate = estimate = np.where(rz > 0.0, state.relative(energy, x), none)
                if known.all() and bool((estimate <= tolerance).all()):
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
            report = self._progress
            if report is not None:
                report = partial(_shifted, report, self.iterations)
            near = state.apart(residual, np.zeros_like(residual), x) <= tolerance
            correction, history, inside = _run(
                system, loop, state, x, rz, near, aim * self._inside, _ENOUGH * tolerance,
                most - self.iterations, self._chunk, report,
            )  # fmt: skip
            self._x, self._image, self._begun = x + correction, None, True
            loop.keep()
            left = state.left(history, rz, self._x)
            size = state.size(self.total)
            drift = norm.size(correction) / np.where(size > 0.0, size, 1e-300)
            self.iterations += len(history)
            self._histories.append(history)
            if state.doubtful(self.iterations, aim * self._inside):
                self._note = state.probe(loop, most)
                self._inside = tolerance  # they are known now
        else:
            self._message = f"stopped after {_MOST_REFINEMENTS} refinements"

    def outcome(self, system: System, blur: float) -> Outcome:
        """By the form of the system that was refined last; ``blur`` is added to the estimate."""
        converged = bool((self._estimate <= self._tolerance).all())
        message, estimate = self._message, float(self._estimate.max()) + blur
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


def _run(
    system: System,
    loop: Any,
    state: _State,
    x: Float,
    rz: Float,
    near: npt.NDArray[np.bool_],
    tolerance: float,
    enough: float,
    most: int,
    chunk: int,
    progress: Callable[[int, float], None] | None,
) -> tuple[Float, Float, Float]:
    """One run from the residual that the loop holds; returns (correction, history, estimate).

    It ends where the sharp bound is at ``tolerance``, and the plain one by r.z, which the caller
    goes by, at ``enough``: another run for the rest would begin anew. Where supports are moved, or
    there is a start, a first one must have come far for its own correction, too: beside a far
    motion, or a start that is nearly right, any correction is small, and its Ritz values would tell
    nothing of the soft modes. Cases that are known to be ``near`` (L,) needn't.
    """
    history = np.zeros((0, len(rz), 4))
    moved = state.given.any(axis=(1, 2)) | x.any(axis=(1, 2))
    fresh = ~np.isfinite(state.mu) & moved & ~near
    active = rz > 0.0
    estimate = np.full(len(rz), np.inf)
    estimate[~active] = 0.0
    plain = estimate.copy()
    correction, base = np.zeros_like(system.right), x + state.given
    while active.any() and len(history) < most:
        lines = loop.run(min(chunk, most - len(history)), active)
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
        correction = loop.correction().reshape(x.shape)
        energy, left = np.zeros(len(rz)), np.zeros(len(rz))
        for case in np.flatnonzero(active):
            energy[case] = energy_bound(history[:, case], _BELOW * state.mu[case])
            last = history[-1, case]
            left[case] = np.sqrt(last[0] * last[2] / (_BELOW * state.mu[case]))
        size = state.size(base + correction)
        estimate = np.where(active, state.over(energy, size), estimate)
        plain = np.where(active & (energy > 0.0), state.over(left, size), estimate)
        told = ~fresh | (state.over(energy, state.norm.size(correction)) <= _LOOSEST)
        active &= ~((estimate <= tolerance) & (plain <= enough) & told)
        if progress is not None:
            progress(len(history), float(estimate.max()))
    return correction, history, estimate


def _shifted(progress: Callable[[int, float], None], done: int, now: int, error: float) -> None:
    progress(done + now, error)


def _refuse_indefinite(system: System, bad: npt.NDArray[np.bool_]) -> None:
    """``bad`` (L,): where r.z is negative."""
    if bad.any():
        raise NotConverged(
            "conjugate gradients: the preconditioner isn't positive definite in load case "
            f"{system.first_case + np.flatnonzero(bad)[0]}; got r.z < 0 (are materials or "
            "element sizes extremely unequal?); expected r.z > 0, or method 'direct' "
            "or 'block_jacobi'"
        )
