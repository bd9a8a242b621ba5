"""Nonlinear statics: equilibrium at large displacements, load step by load step."""

from __future__ import annotations

from dataclasses import replace

from gpusim.arrays.array_types import Float
from gpusim.errors import NotConverged
from gpusim.fem.assembly.element_responses import element_responses
from gpusim.fem.assembly.equation import Equation
from gpusim.fem.assembly.stiffness_rounding import extremes
from gpusim.fem.linear.solve_plan import Options
from gpusim.fem.linear.tangent_solver import TangentSolver
from gpusim.fem.model.model import Model
from gpusim.fem.model.solution import LoadStep, Solution, load_path_results
from gpusim.fem.procedures.load_path_checks import load_path_warnings
from gpusim.fem.procedures.load_steps import load_steps
from gpusim.fem.procedures.newton import Controls, Steps
from gpusim.fem.recovery.cauchy_stress import cauchy_stress

# relative accuracy of linear solutions where all laws are elastic, and where points flow
_FORCING, _PLASTIC_FORCING = 1e-4, 1e-2


def nonlinear_static(model: Model, targets: Float, options: Options) -> Solution:
    """Equilibria at ``targets`` (K,L), the factors of the load cases.

    Steps that were found before one that isn't stay part of the solution, which hasn't converged
    then. Raises NotConverged where none was.
    """
    responses = element_responses(model, options.formulation)
    equation = Equation(model, responses)
    options.clock.mark("elements")
    solver = TangentSolver(equation, options)
    forcing = _PLASTIC_FORCING if equation.has_history else _FORCING
    first = Steps.SEARCHED if equation.has_history else Steps.FORETOLD
    controls = Controls(options.tolerance, forcing, first, True, options.progress)
    steps: list[LoadStep] = []
    message = "converged"
    try:
        for step in load_steps(equation, solver, targets, controls):
            if step.wanted:
                found = cauchy_stress(model, responses, step.u, options.formulation)
                step = replace(step, stress=found)
            steps.append(step)
    except NotConverged as error:
        if not steps:
            raise
        cause = extremes(model)
        message = f"{error}; the model has {cause}" if cause else str(error)
    options.clock.mark("load steps")
    reasons = () if solver.plan is None else solver.plan.lines
    return Solution(
        **load_path_results(steps, steps[-1]),
        converged=message == "converged",
        unknowns=int(equation.unknown.sum()),
        message=message,
        warnings=load_path_warnings(equation, steps),
        timings=options.clock.timings,
        method="newton",
        backend="numpy",
        real="f64",
        element_classes=model.mesh.cell_count,
        reasons=reasons,
        model=model,
    )
