"""Modal bases: modes, and what static responses have beyond them.

A load strains a body also in modes that weren't computed. What its static response has beyond the
modes is taken in as residual vectors (Dickens, Nakagawa & Wittbrodt, Comput. Struct. 62 (1997)
985), which act like further modes: the response at 0 Hz is exact then, and what is left out grows
with (frequency / that of the last mode)^2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

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
# share of the greatest residual vector's energy from which on another one doesn't repeat it
_DISTINCT = 1e-12
# of a load: what is left of it beside the inertia of a free body, which is rounding below that
_BALANCED = 1e-12
# share of a free body's mass, at the first elastic frequency, that its solver has as well
_SHIFT = 0.01
# relative to squared frequencies: nearer to a resonance that nothing damps a response isn't known
_RESOLVED = 1e-7


@dataclass(frozen=True, eq=False)
class ModalBasis:
    """Mass-normalised ``shapes`` (m,N,3), decoupled, of ``angular`` frequencies (m,) rad/s, and the
    ``forcing`` (L,m) of loads on them. The first ``count`` are ``modes``, the others residual
    vectors."""

    shapes: Float
    angular: Float
    forcing: Float | Complex
    modes: Modes

    @property
    def count(self) -> int:
        """How many are modes."""
        return len(self.modes.angular)

    @property
    def computation(self) -> dict[str, Any]:
        """What results that superpose it tell as a `Computation`."""
        beyond, modes = len(self.angular) - self.count, self.modes
        message = f"{self.count} modes" + f", {beyond} residual vectors" * (beyond > 0)
        known = {
            name: getattr(modes, name) for name in ("unknowns", "warnings", "timings", "model")
        }
        return {"method": "modal", "message": message, **known}

    @staticmethod
    def of(
        equation: EquationOfMotion, modes: Modes, loads: Float | Complex, options: Options
    ) -> ModalBasis:
        """For forces ``loads`` (L,3N) on the equation's unknowns."""
        check_modes(modes)
        rigid, count = int((modes.frequencies == 0.0).sum()), len(modes.frequencies)
        # a free body: its rigid-body modes are exact, and the solver has some of its mass as well
        shift = _SHIFT * modes.angular[rigid] ** 2 if rigid else 0.0
        solver = ShiftedSolver(equation, shift, options)
        x = equation.unknowns(modes.shapes) * np.sqrt(equation.scale)
        parts = np.concatenate([loads.real, loads.imag][: 1 + np.iscomplexobj(loads)])
        rows = np.concatenate([x[rigid:], _residual_vectors(equation, solver, x, rigid, parts)])
        # modes have errors of their own, which residual vectors may take off
        mu, rows, _ = sharpened(equation, equation.inertia, rows, options.tolerance)
        x = np.concatenate([x[:rigid], rows / np.sqrt(mu)[:, None]])
        angular = np.concatenate([np.zeros(rigid), 1.0 / np.sqrt(mu)])
        same = np.abs(angular[:count] - modes.angular) <= _SAME * modes.angular[-1]
        expected = "all from the lowest one on, of this model, formulation and mass"
        require(bool(same.all()), "modes", "others than the basis has", expected)
        forcing = np.sqrt(equation.scale) * (loads @ x.T)
        shapes = equation.displacements(x / np.sqrt(equation.scale))
        return ModalBasis(shapes, angular, forcing, modes)

    @property
    def lacking(self) -> Float:
        """(L,) share of the energy of static responses that modes lack; 0 where there is none, as
        of a load that moves a free body alone."""
        elastic = self.angular > 0.0
        energy = np.abs(self.forcing[:, elastic] / self.angular[elastic]) ** 2
        beyond = energy[:, self.count - len(self.angular) + elastic.sum() :]
        return np.asarray(beyond.sum(axis=1) / np.maximum(energy.sum(axis=1), 1e-300))

    def coordinates(self, angular: Float, dampings: Sequence[Damping]) -> Complex:
        """(F,m) under the first load, at ``angular`` (F,) rad/s. Raises InputError at a resonance
        that nothing damps."""
        stiffness = self.dynamic_stiffness(angular, dampings, "harmonic: frequencies")
        return np.asarray(self.forcing[0] / stiffness)

    def dynamic_stiffness(self, angular: Float, dampings: Sequence[Damping], what: str) -> Complex:
        """(F,m) forces over amplitudes, at ``angular`` (F,) rad/s. Raises InputError naming
        ``what`` at a resonance that none of the ``dampings`` damps."""
        stiffness = (self.angular**2 - angular[:, None] ** 2).astype(np.complex128)
        for one in dampings:
            stiffness += 1j * one.dissipation(angular, self.angular)
        size = np.maximum(self.angular**2, angular[:, None] ** 2)
        known = (np.abs(stiffness) > _RESOLVED * size).all(axis=0)
        mode = int(np.argmin(known))
        expected = f"damping, or frequencies other than {self.angular[mode] / (2.0 * np.pi):.9g} Hz"
        got = f"a resonance of mode {mode + 1} that nothing damps"
        require(bool(known.all()), what, got, expected)
        return stiffness

    def truncation(self, angular: Float, what: str) -> Float:
        """(F,) at most what modes left out add to the response to the first load at ``angular``
        (F,) rad/s, in the energy norm over that of the static response. Raises InputError,
        naming ``what``, beyond the last mode."""
        last, lacking = self.angular[self.count - 1], float(self.lacking[0])
        if lacking <= _NEGLIGIBLE:
            return np.zeros(len(angular))
        got = (f"{angular.max() / (2.0 * np.pi):.6g} Hz, beyond {self.count} modes that lack "
               f"{lacking:.1e} of the static response's energy")  # fmt: skip
        expected = f"less than {last / (2.0 * np.pi):.6g} Hz, or more modes (count)"
        require(bool((angular < last).all()), what, got, expected)
        ratio = (angular / last) ** 2
        return np.asarray(np.sqrt(lacking) * ratio / (1.0 - ratio) ** 1.5)


def check_modes(modes: Modes) -> None:
    """Raises NotConverged for modes that were given up, and InputError for rigid ones alone."""
    if not modes.converged:
        raise NotConverged(f"modes; got {modes.message}; expected converged ones")
    require(bool(modes.frequencies.any()), "modes", "rigid ones alone", "a greater count")


def _residual_vectors(
    equation: EquationOfMotion, solver: ShiftedSolver, x: Float, rigid: int, loads: Float
) -> Float:
    """(k,3N), k <= L: what the static responses to loads (L,3N) have beyond modes ``x`` (n,3N), the
    first ``rigid`` of which are a free body's."""
    inertia = equation.inertia(x)
    # a free body is strained by what is left beside its inertia
    balanced = loads - (loads @ x[:rigid].T) @ inertia[:rigid]
    sizes = np.linalg.norm([balanced, loads], axis=2)
    balanced[~(sizes[0] > _BALANCED * sizes[1])] = 0.0

    def elastic(y: Float) -> Float:
        # what rounding makes of rigid motions may have less than no energy
        image = equation.stiffness(y - (y @ inertia[:rigid].T) @ x[:rigid])
        return image - (image @ x[:rigid].T) @ inertia[:rigid]

    solved = truncated_cg(elastic, solver.preconditioner, balanced, _STATIC_ERROR)
    if solved is None:
        raise NotConverged(
            "modal superposition: static response; got a stiffness that isn't positive definite; "
            "expected less prestress, or fewer motions without stiffness"
        )
    beyond = solved[0]
    beyond /= np.sqrt(np.maximum((beyond * balanced).sum(axis=1, keepdims=True), 1e-300))
    for _ in range(2):
        beyond -= (beyond @ inertia.T) @ x
    products = beyond @ equation.stiffness(beyond).T
    energy, turn = np.linalg.eigh(0.5 * (products + products.T))
    least = max(_ROUNDING, _DISTINCT * energy[-1])
    return np.asarray(turn[:, energy > least].T @ beyond)
