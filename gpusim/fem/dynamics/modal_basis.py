"""Modal bases: modes, and what static responses have beyond them.

A load strains a body also in modes that weren't computed. What its static response has beyond the
modes is taken in as residual vectors (Dickens, Nakagawa & Wittbrodt, Comput. Struct. 62 (1997)
985), which act like further modes: the response at 0 Hz is exact then, and what is left out grows
with (frequency / that of the last mode)^2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpusim.arrays.array_types import Complex, Float
from gpusim.errors import NotConverged
from gpusim.fem.assembly.equation_of_motion import EquationOfMotion
from gpusim.fem.eigenvalues.rayleigh_quotients import sharpened
from gpusim.fem.krylov.truncated_cg import truncated_cg
from gpusim.fem.linear.shifted_solver import ShiftedSolver
from gpusim.fem.linear.solve_plan import Options
from gpusim.fem.model.damping import Damping
from gpusim.fem.model.modes import Modes
from gpusim.validation import require

# of the static response, in the energy norm
_STATIC_ERROR = 1e-10
# of the static response's energy: less beyond the modes is rounding; more than that is open at
# frequencies above theirs
_ROUNDING, _NEGLIGIBLE = 1e-18, 1e-12
# of the last frequency: by which a basis may change those of modes
_SAME = 1e-3
# share of the greater residual vector's energy from which on the other one doesn't repeat it
_DISTINCT = 1e-12
# of a load: what is left of it beside the inertia of a free body, which is rounding below that
_BALANCED = 1e-12
# share of a free body's mass, at the first elastic frequency, that its solver has as well
_SHIFT = 0.01
# relative to squared frequencies: nearer to a resonance that nothing damps a response isn't known
RESOLVED = 1e-7


@dataclass(frozen=True, eq=False)
class ModalBasis:
    """Mass-normalised ``shapes`` (m,N,3), decoupled, of ``angular`` frequencies (m,) rad/s, and the
    ``forcing`` (m,) of one load on them. The first ``count`` are modes, the others residual
    vectors, with a share ``lacking`` of the static response's energy."""

    shapes: Float
    angular: Float
    forcing: Complex
    count: int
    lacking: float

    @staticmethod
    def of(equation: EquationOfMotion, modes: Modes, load: Complex, options: Options) -> ModalBasis:
        """For forces ``load`` (3N,) on the equation's unknowns."""
        rigid, count = int((modes.frequencies == 0.0).sum()), len(modes.frequencies)
        require(rigid < count, "harmonic: modes", "rigid ones alone", "a greater count")
        fits = modes.shapes[0].size == len(load)
        require(fits, "harmonic: modes", "those of another mesh", "those of the model")
        # a free body: its rigid-body modes are exact, and the solver has some of its mass as well
        shift = _SHIFT * modes.angular[rigid] ** 2 if rigid else 0.0
        solver = ShiftedSolver(equation, shift, options)
        x = equation.unknowns(modes.shapes) * np.sqrt(equation.scale)
        rows = np.concatenate([x[rigid:], _residual_vectors(equation, solver, x, rigid, load)])
        # modes have errors of their own, which residual vectors may take off
        mu, rows, _ = sharpened(equation, equation.inertia, rows, options.tolerance)
        x = np.concatenate([x[:rigid], rows / np.sqrt(mu)[:, None]])
        squares = np.concatenate([np.zeros(rigid), 1.0 / mu])
        same = np.abs(np.sqrt(squares[:count]) - modes.angular) <= _SAME * modes.angular[-1]
        expected = "all from the lowest one on, of this model, formulation and mass"
        require(bool(same.all()), "harmonic: modes", "others than the basis has", expected)
        forcing = np.sqrt(equation.scale) * (x @ load)
        energy = np.abs(forcing[rigid:]) ** 2 / squares[rigid:]
        # nothing at all where a load moves a free body alone
        lacking = float(energy[count - rigid :].sum() / max(energy.sum(), 1e-300))
        shapes = equation.displacements(x / np.sqrt(equation.scale))
        return ModalBasis(shapes, np.sqrt(squares), forcing, count, lacking)

    def coordinates(self, angular: Float, damping: Damping | None) -> Complex:
        """(F,m) at ``angular`` (F,) rad/s. Raises InputError at a resonance that nothing damps."""
        dynamic = (self.angular**2 - angular[:, None] ** 2).astype(np.complex128)
        if damping is not None:
            dynamic += 1j * damping.dissipation(angular, self.angular)
        size = np.maximum(self.angular**2, angular[:, None] ** 2)
        known = (np.abs(dynamic) > RESOLVED * size).all(axis=0)
        mode = int(np.argmin(known))
        expected = f"damping, or frequencies other than {self.angular[mode] / (2.0 * np.pi):.9g} Hz"
        got = f"a resonance of mode {mode + 1} that nothing damps"
        require(bool(known.all()), "harmonic: frequencies", got, expected)
        return np.asarray(self.forcing / dynamic)

    def truncation(self, angular: Float, what: str = "harmonic: frequencies") -> Float:
        """(F,) at most what modes left out add at ``angular`` (F,) rad/s, in the energy norm over
        that of the static response. Raises InputError naming ``what`` beyond the last mode."""
        last = self.angular[self.count - 1]
        got = (f"{angular.max() / (2.0 * np.pi):.6g} Hz, beyond {self.count} modes that lack "
               f"{self.lacking:.1e} of the static response's energy")  # fmt: skip
        expected = f"less than {last / (2.0 * np.pi):.6g} Hz, or more modes (count)"
        if self.lacking <= _NEGLIGIBLE:
            return np.zeros(len(angular))
        require(bool((angular < last).all()), what, got, expected)
        ratio = (angular / last) ** 2
        return np.asarray(np.sqrt(self.lacking) * ratio / (1.0 - ratio) ** 1.5)


def _residual_vectors(
    equation: EquationOfMotion, solver: ShiftedSolver, x: Float, rigid: int, load: Complex
) -> Float:
    """(k,3N), k <= 2: what the static responses to the real and the imaginary part of a load have
    beyond modes ``x`` (n,3N), the first ``rigid`` of which are a free body's."""
    inertia, parts = equation.inertia(x), np.stack([load.real, load.imag])
    # a free body is strained by what is left beside its inertia
    balanced = parts - (parts @ x[:rigid].T) @ inertia[:rigid]
    sizes = np.linalg.norm([balanced, parts], axis=2)
    balanced[~(sizes[0] > _BALANCED * sizes[1])] = 0.0

    def elastic(y: Float) -> Float:
        # what rounding makes of rigid motions may have less than no energy
        image = equation.stiffness(y - (y @ inertia[:rigid].T) @ x[:rigid])
        return image - (image @ x[:rigid].T) @ inertia[:rigid]

    solved = truncated_cg(elastic, solver.preconditioner, balanced, _STATIC_ERROR)
    if solved is None:
        raise NotConverged(
            "harmonic: static response; got a stiffness that isn't positive definite; expected "
            "less prestress, or fewer motions without stiffness"
        )
    static = beyond = solved[0]
    for _ in range(2):
        beyond = beyond - (beyond @ inertia.T) @ x
    products = beyond @ equation.stiffness(beyond).T
    energy, turn = np.linalg.eigh(0.5 * (products + products.T))
    least = max(_ROUNDING * float(np.vdot(static, balanced)), _DISTINCT * energy[-1])
    return np.asarray(turn[:, energy > least].T @ beyond)
