"""What large displacements add to linear ones, to third order in the load (Koiter 1945).

Equilibria at a share s of the load are s u_1 + s^2 u_2 + s^3 u_3 + ... with u_1 by linear theory.
Residual forces of the turned elements at a small share, of both signs, tell even orders from odd
ones, and each correction is one more linear solution. Where a body is held so that it has to
stretch as it bends, u_3 is what it stiffens by.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.fem.assembly.element_responses import element_responses
from gpusim.fem.assembly.equation import Equation
from gpusim.fem.model.model import Model, resolve_formulation
from gpusim.fem.procedures.statics import solve
from gpusim.fem.recovery.linear_theory import cell_rotations

# rad by which the body turns at the share of the load at which forces are looked at; and at a far
# smaller one, at which they are linear
_TURN, _LINEAR = 5e-4, 1e-4
# of a correction, relative
_TOLERANCE = 1e-3


def higher_orders(model: Model, u: Float, factors: Float, formulation: str) -> Float:
    """(N,3) what comes to the linear displacements ``u`` (N,3) of a model without constraints at
    ``factors`` (L,) of its load cases, u_2 + u_3."""
    equation = Equation(model, element_responses(model, resolve_formulation(model, formulation)))
    turn = float(np.linalg.norm(cell_rotations(model.mesh, u), axis=1).max())
    share = _TURN / max(turn, _TURN)
    at_rest = np.zeros_like(u)

    def residual(moved: Float, part: float) -> Float:
        acting = equation.external(moved, part * factors)
        inner = equation.internal(moved, part * factors)
        return equation.unbalanced(acting - inner)

    def odd(second: Float, part: float) -> Float:
        """Over the share, of the displacements to second order."""
        ends = (residual(sign * part * u + part**2 * second, sign * part) for sign in (1.0, -1.0))
        return np.asarray(np.subtract(*ends) / (2.0 * part))

    def correction(forces: Float) -> Float:
        dead = replace(model, forces=forces, prescribed=at_rest, loads=(), temperature=None)
        return solve(dead, formulation=formulation, tolerance=_TOLERANCE, backend="numpy").u

    both = residual(share * u, share) + residual(-share * u, -share)
    second = correction(both / (2.0 * share**2))
    linear = odd(at_rest, _LINEAR * share)  # what the linear solution is off by
    third = correction((odd(second, share) - linear) / share**2)
    return second + third
