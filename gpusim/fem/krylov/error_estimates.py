"""When to stop: from the coefficients of conjugate gradients to an error in displacement.

Write e for the error of the iterate, A for K on the free unknowns, M for the preconditioner and
mu for the smallest Ritz value, the least eigenvalue of the tridiagonal (Lanczos) matrix that
alpha and beta define. Then

    ||e||_A^2 <= g_k (r_k . z_k),   g_0 = 1/mu,
    g_{k+1} = (g_k - alpha_k) / (mu (g_k - alpha_k) + beta_k)

is the Gauss-Radau upper bound (Meurant & Tichy, Numer. Algorithms 62 (2013) 163), exact for mu
below the smallest eigenvalue of M^-1 A; a Ritz value is slightly above it, so mu is taken 10 %
smaller. The displacement error follows from a norm N with a known least eigenvalue of N^-1 A,

    ||e||_N <= ||e||_A / sqrt(lambda_N),     relative to ||u||_N,

where N = I (root-mean-square displacement of the nodes) and lambda_N comes from the multigrid
hierarchy, and from ``probe`` where that converges slowly. The bound assumes that the whole error
sits in the softest mode, so it is pessimistic for stiff load cases. It speaks of the root mean
square; a single node may be off by more, most of all where soft and stiff parts meet.

An estimate that is no bound goes by the softness of the error, displacement over energy norm.
z = M^-1 r is what the preconditioner sees of the error, and its energy is sqrt(mu r.z) at least:
its softness s = ||z|| / sqrt(mu r.z), and t, that of the last step, tell of the error's. Where s is
more than t, softer motions come up than steps went along so far, and still softer ones may follow:

    ||e|| ~ 2.5 max(t, s^2 / t) sqrt(r.z / mu)

with the root mean square or the greatest displacement, whichever is more beside that of u. A load
that moves the body as it is soft tells of all of that; one that doesn't, as a pull along a plate,
leaves the bound.

Conjugate gradients tell mu by their Ritz values as far as the right-hand side holds its mode, and a
load may hold next to nothing of it, though it decides the displacement: a thin plate that is pulled
along, and a little across. Noise in the forces holds every mode, and most of the soft ones
(``probe``). What the rounding of the stiffness leaves open no residual shows at all
(``RoundingError``, and `gpusim.fem.assembly.stiffness_rounding`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from scipy.linalg import eigvalsh_tridiagonal

from gpusim.arrays.array_types import Bool, Float
from gpusim.arrays.unique import noise
from gpusim.fem.assembly.stiffness_rounding import check_finite, indefinite
from gpusim.fem.assembly.system import System

# share of the tolerance beyond which forces by deformation are worth their time
VISIBLE = 0.1
# root mean square of displacements in bending, of the greatest one (a cantilever: 0.29)
_UNEVEN = 0.2
# share of the tolerance below which a bound of it isn't looked at any closer
_NEGLIGIBLE = 0.02
_FIRST = 10
# the Ritz value may fall by this factor and the Rayleigh quotient by that one while the number of
# iterations doubles, where the least eigenvalues count as found
_RITZ, _RAYLEIGH = 2.0, 1.5
# a Ritz value lies slightly above the eigenvalue that the bounds ask for
BELOW = 0.9
# how much more than by its softness an error may be (1.6 was the most on 200 bodies), and how much
# less than the softest mode a load may move a body that is to tell of it
_SHARP, _FELT = 2.5, 2.0
# a run goes this far at least: after a few steps Ritz values tell little, and steps
LOOSEST = 1e-3
# a Ritz value below which the preconditioner is poor, and iterations per decimal beyond which it
# is: the loads may not feel all soft modes then, either
_POOR, _MANY = 0.03, 5.0
# a Ritz value below this tells of motions that the coarse levels, and ``Norm.lowest``, don't see
_UNSEEN = 1e-6


def smallest_ritz_value(alpha: Float, beta: Float) -> float:
    """Least eigenvalue of the Lanczos matrix of one load case; inf before the first step."""
    # a case that broke down takes no further step
    steps = int(np.logical_and.accumulate(alpha > 0.0).sum())
    if steps == 0:
        return float("inf")
    alpha, beta = alpha[:steps], beta[:steps]
    diagonal = 1.0 / alpha
    diagonal[1:] += beta[:-1] / alpha[:-1]
    if steps == 1:
        return float(diagonal[0])
    off = np.sqrt(beta[:-1]) / alpha[:-1]
    return float(eigvalsh_tridiagonal(diagonal, off, select="i", select_range=(0, 0))[0])


def energy_bound(history: Float, mu: float) -> float:
    """Gauss-Radau bound of ||e||_A after all steps of ``history`` (k,4): r.z, alpha, beta, p.q."""
    rz, alpha, beta = history[-1, 0] * history[-1, 2], history[:, 1], history[:, 2]
    if not mu > 0.0 or not np.isfinite(mu):
        return float("inf")
    simple = 1.0 / mu
    radau = simple
    for a, b in zip(alpha, beta, strict=True):
        gap = radau - a
        # a gap below zero says that mu is above an eigenvalue already found: fall back
        radau = gap / (mu * gap + b) if gap > 0.0 else simple
    return float(np.sqrt(max(min(radau, simple), 0.0) * max(rz, 0.0)))


class Inverse(Protocol):
    """Nearly K'^-1, with the least eigenvalue of K'."""

    @property
    def lowest(self) -> float: ...

    def apply(self, r: Float) -> Float: ...


class RoundingError:
    """By a preconditioner in place of the inverse; it is within a factor of two for the soft
    motions that matter here."""

    def __init__(self, inverse: Inverse, tolerance: float) -> None:
        self._inverse, self._negligible = inverse, _NEGLIGIBLE * tolerance

    def __call__(self, system: System, u: Float) -> float:
        """Relative error (2-norm, the greatest over load cases) of the scaled, complete
        displacements ``u`` (L,N,3)."""
        # |K| u is at most twice the greatest sum of a row: far too much for a body of good
        # proportions
        if np.finfo(np.float64).eps * system.row_sum / self._inverse.lowest <= self._negligible:
            return 0.0
        forces = np.where(system.free, system.rounding(u), 0.0)
        error = self._inverse.apply(forces.reshape(len(u), -1))
        size = extent(u, even=bool(system.prescribed.any()))
        relative = np.sqrt(np.einsum("ln,ln->l", error, error)) / np.where(size > 0.0, size, 1e-300)
        return float(relative.max())


def extent(u: Float, even: bool) -> Float:
    """(L,) 2-norms of displacements (L,N,3), which errors are relative to.

    ``even``: supports may have moved all of the body alike. Errors are uneven, as bending is, and
    beside such a motion their 2-norm makes less of them than the greatest displacement does: the
    size is no more then than that of bending with the same greatest displacement.
    """
    size = np.sqrt(np.einsum("lni,lni->l", u, u))
    if even:
        size = np.minimum(size, _UNEVEN * np.sqrt(u[0].size) * np.abs(u).max(axis=(1, 2)))
    return np.asarray(size)


def rounded(error: float) -> str:
    """What to say where it is too much."""
    error_words = f"an estimated relative error of {error:.2g}"
    return f"the rounding of the stiffness in float64 leaves {error_words}"


@dataclass(frozen=True, eq=False)
class Probed:
    """``mu`` (L,) least Ritz values of M^-1 A, ``settled`` (L,) whether they are final, ``lowest``
    a Rayleigh quotient of A near its least eigenvalue, and the ``iterations`` that it took."""

    mu: Float
    settled: Bool
    lowest: float
    iterations: int


def probe(system: System, loop: Any, most: int, first: int = _FIRST, ritz: float = _RITZ) -> Probed:
    """Solve for noise until the least Ritz value and the Rayleigh quotient of the solution settle
    between ``first`` and twice as many iterations, or 2 and 4 times as many, and so on.

    One solution of A x = noise is a step of inverse iteration, so its quotient is near the least
    eigenvalue. Raises NotConverged for stiffnesses that aren't positive definite.
    """
    rough = noise(system.right.size, 11)
    rough = np.where(system.free, rough.reshape(system.right.shape), 0.0)
    active = loop.begin(rough.reshape(len(rough), -1)) > 0.0
    cases = len(rough)
    history = np.zeros((0, cases, 4))
    mu, lowest = np.full(cases, np.inf), np.inf
    settled = ~active
    while len(history) < most and not settled.all():
        count = min(max(first, len(history)), most - len(history))
        history = np.concatenate([history, loop.run(count, active)])
        check_finite(history, "conjugate gradients")
        if ((history[:, :, 3] <= 0.0) & (history[:, :, 0] > 0.0)).any():
            raise indefinite("conjugate gradients")
        before, quotient_before = mu, lowest
        mu = np.array(
            [smallest_ritz_value(history[:, k, 1], history[:, k, 2]) for k in range(cases)]
        )
        x = loop.correction()
        size = np.einsum("ln,ln->l", x, x)
        # ||x_k||_A^2 is the sum of alpha r.z
        energy = (history[:, :, 0] * history[:, :, 1]).sum(axis=0)
        held = size > 0.0
        lowest = float((energy[held] / size[held]).min()) if held.any() else np.inf
        settled = ~active | ((before <= ritz * mu) & bool(quotient_before <= _RAYLEIGH * lowest))
    return Probed(mu, settled, lowest, len(history))


@dataclass(frozen=True)
class Norm:
    """The norm of the stopping rule, the sum of squares: ``lowest`` is the least eigenvalue of K';
    ``sought``: soft modes have been looked for already, as ``probe`` does; ``share``: of the energy
    of K' that the loop's own is sure to hold."""

    lowest: float
    sought: bool = False
    share: float = 1.0


class Estimates:
    """Least Ritz value so far, and the estimates per load case."""

    def __init__(self, system: System, norm: Norm) -> None:
        self.system, self.norm = system, norm
        self.mu = np.full(len(system.right), np.inf)
        self.settled = np.ones(len(system.right), dtype=bool)
        self.given = system.prescribed * (system.scale / system.load_scale)[:, None, None]
        self.lowest, self.probed = norm.lowest * norm.share, False
        # what a start was off by, where nothing sharper came to be known
        self.floor = np.zeros(len(system.right))
        # softness of the last step, where one has been looked at; whether soft modes have been felt
        self._last = np.full(len(system.right), np.inf)
        self._felt = np.zeros(len(system.right), dtype=bool)

    def doubtful(self, iterations: int, tolerance: float) -> bool:
        """Whether there may be soft modes that the loads haven't told of, by a first run."""
        if self.probed:
            return False
        many = iterations > _MANY * -np.log10(tolerance) and not self.norm.sought
        return bool((self.mu < _POOR).any()) or many

    def probe(self, loop: Any, most: int) -> str:
        """Look for them; the loop's run is lost. Returns what to say of it."""
        spectrum = probe(self.system, loop, most)
        self.probed = True
        self.mu = np.minimum(self.mu, spectrum.mu)
        self.lowest = min(self.lowest, spectrum.lowest)
        self.settled &= spectrum.settled
        return f" ({spectrum.iterations} more iterations looked for soft modes)"

    def learn(self, history: Float) -> None:
        for case in range(len(self.mu)):
            lowest = smallest_ritz_value(history[:, case, 1], history[:, case, 2])
            self.mu[case] = min(self.mu[case], lowest)

    def energies(self, history: Float) -> tuple[Float, Float]:
        """Bounds (L,) of ||e||_A after all steps of a run: the sharp one, and the one by r.z."""
        mu = BELOW * self.mu
        sharp = [energy_bound(history[:, case], mu[case]) for case in range(len(mu))]
        return np.array(sharp), np.sqrt(np.maximum(history[-1, :, 0] * history[-1, :, 2], 0.0) / mu)

    def follow(self, step: Float, correction: Float, history: Float, total: Float) -> None:
        """The last step (L,N,3) of a run has led to this correction, and to ``total``."""
        work = history[:, :, 0] * history[:, :, 1]
        softness = self._softness(step, np.sqrt(np.maximum(work[-1], 0.0)), total)
        # ||x_k||_A^2 is the sum of alpha r.z
        energy = np.sqrt(self.norm.share * np.maximum(work.sum(axis=0), 0.0))
        self._felt |= self.over(energy, extent(correction, even=False)) <= _FELT
        # a case at rest took no step
        self._last = np.where(work[-1] > 0.0, softness, self._last)

    def by_softness(self, rz: Float, loop: Any, total: Float, enough: float) -> Float:
        """Estimates (L,) by the softness of what is left to ``total``; infinite where there may be
        motions that it doesn't tell of, or where it can't be within ``enough``."""
        known = self._felt & (rz > 0.0) & np.isfinite(self._last) & (self.mu >= _POOR)
        known &= not self.probed
        rz, mu, last = (np.where(known, one, 1.0) for one in (rz, self.mu, self._last))
        energy = np.sqrt(rz / (BELOW * mu))
        known &= self.over(energy, self.size(total)) <= LOOSEST
        known &= _SHARP * last * energy <= enough
        if not known.any():
            return np.full(len(rz), np.inf)
        left = self._softness(loop.preconditioned().reshape(total.shape), np.sqrt(mu * rz), total)
        return np.where(known, _SHARP * np.maximum(last, left / last * left) * energy, np.inf)

    def _softness(self, part: Float, energy: Float, total: Float) -> Float:
        """Of vectors (L,N,3) with energy norms (L,), beside the size of ``total``."""
        sizes = np.stack([self.size(total), np.abs(total).max(axis=(1, 2))]) * energy
        parts = np.stack([extent(part, even=False), np.abs(part).max(axis=(1, 2))])
        return np.asarray(
            np.divide(parts, sizes, out=np.full_like(parts, np.inf), where=sizes > 0.0).max(axis=0)
        )

    def by_rz(self, rz: Float, x: Float) -> Float:
        """Estimates (L,) for the residual of x by ||e||_A <= sqrt(r.z / mu), infinite where no Ritz
        value is known. A case without load takes no step and needs none. That r.z is below zero
        says nothing of the error, least of all that there is none."""
        known = np.where(rz > 0.0, np.isfinite(self.mu), rz == 0.0)
        energy = np.sqrt(np.maximum(rz, 0.0) / (BELOW * np.where(known, self.mu, 1.0)))
        return np.where(known, self.relative(energy, x), np.inf)

    def apart(self, residual: Float, expected: Float | None, x: Float) -> Float:
        """Relative displacement error (L,) from what the true residual (L,n) has more than the
        one that the loop went by: ||A^-1 d||_A <= ||d|| / sqrt(least eigenvalue)."""
        if expected is None:
            return np.full(len(residual), np.inf)
        gap = np.where(self.system.free.ravel(), residual - expected, 0.0)
        size = np.sqrt(np.einsum("ln,ln->l", gap, gap))
        return self.relative(size / np.sqrt(BELOW * self.lowest), x)

    def relative(self, energy: Float, x: Float) -> Float:
        """Estimated relative displacement error for energy-norm errors (L,)."""
        return self.over(energy, self.size(x + self.given))

    def size(self, total: Float) -> Float:
        """What errors (L,) are relative to, for complete displacements (L,N,3)."""
        return extent(total, even=bool(self.given.any()))

    def over(self, energy: Float, size: Float) -> Float:
        """The same for solutions whose norms are ``size`` (L,)."""
        lowest = BELOW * self.lowest * np.minimum(1.0, self.mu / _UNSEEN)
        bound = np.where(self.settled, energy / np.sqrt(lowest), np.inf)
        relative = np.divide(bound, size, out=np.full_like(bound, np.inf), where=size > 0.0)
        return np.where(energy > 0.0, relative, 0.0)
