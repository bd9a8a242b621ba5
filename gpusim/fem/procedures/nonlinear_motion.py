"""Motion at large displacements: equilibrium with the forces of inertia, by Newton's method.

Within a step these are linear in the displacement that it ends in: those of a predicted state, and
s M times what it differs by. So each step is an equilibrium of the static kind, of a body on
springs s M.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.fem.assembly.element_batches import portions
from gpusim.fem.assembly.element_responses import element_responses
from gpusim.fem.assembly.equation import Equation, FormedElements, Tangent
from gpusim.fem.assembly.shifted_system import Shift, shifted_elements, with_row_sums
from gpusim.fem.elements.element_response import Want
from gpusim.fem.linear.tangent_solver import TangentSolver
from gpusim.fem.model.history import State
from gpusim.fem.model.mass import ElementMass, scalar_mass
from gpusim.fem.procedures.initial_value_problem import InitialValueProblem
from gpusim.fem.procedures.newton import Controls, Steps, equilibrium
from gpusim.fem.procedures.time_integration import LinearMotion, Scheme, predicted
