"""Line search: how far to go along a step of Newton's method, by the work that is left to gain.

Points that begin to flow are softer than their tangent was: full steps overshoot, the next ones
more so. What plasticity with isotropic hardening does in a step of the implicit Euler method is to
make an energy least, of displacements and internal modes alike (Simo & Hughes, Computational
Inelasticity, 1998, 1.4.3), so that there is a right share of a step.
"""

from __future__ import annotations

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import NotConverged
from gpusim.fem.assembly.equation import Equation, Tangent

# of the work that a step promised: what it may have gone too far by (Crisfield, Non-linear Finite
# Element Analysis of Solids and Structures 1, 1991, 9.3.2)
_ROOM = 0.8
# what a step is shortened to at a time, at least, and how often
_LEAST, _MOST = 0.1, 6


def line_search(equation: Equation, begun: Tangent, du: Float) -> Tangent:
    """The tangent at the share of ``du`` (N,3), along which the elements have advanced, that it is
    good to go from ``begun``. Raises NotConverged where there is none."""
    promised, share = equation.work_left(begun, du), 1.0
    if promised <= 0.0:  # no minimum lies that way: the tangent is indefinite
        return equation.linearised(begun.u + du, begun.factors)
    for _ in range(_MOST):
        try:
            tangent = equation.linearised(begun.u + share * du, begun.factors)
            left = equation.work_left(tangent, share * du) / share
        except NotConverged:  # cells turned inside out
            left = -np.inf
        if left >= -_ROOM * promised:
            return tangent
        shorter = max(promised / (promised - left), _LEAST)
        equation.shorten(shorter)
        share *= shorter
    raise NotConverged(f"got a step too long still at {share:.1g} of it; expected a shorter one")
