"""Nonlinear statics: equilibrium at large displacements, load step by load step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import NotConverged
from gpusim.fem.assembly.element_batches import portions
from gpusim.fem.assembly.element_responses import element_responses
from gpusim.fem.assembly.equation import Equation, external_forces
from gpusim.fem.assembly.stiffness_rounding import extremes
from gpusim.fem.elements.corotational import Corotational
from gpusim.fem.elements.element_response import ElementResponse
from gpusim.fem.linear.solve_plan import Options
from gpusim.fem.linear.tangent_solver import TangentSolver
from gpusim.fem.materials.j2 import J2, fit_for_flow
from gpusim.fem.model.model import Model
from gpusim.fem.model.solution import LoadStep, Solution, load_path_results
from gpusim.fem.procedures.load_steps import load_steps
from gpusim.fem.procedures.newton import Controls, Steps
from gpusim.fem.recovery.cauchy_stress import cauchy_stress
from gpusim.mesh.quality import least_jacobian

# relative accuracy of linear solutions where all laws are elastic, and where points flow
_FORCING, _PLASTIC_FORCING = 1e-4, 1e-2
# of the accumulated plastic strain in one step: stress is a fifth of a per cent off at most
_MOST_FLOW = 0.07
# up to which strains by length and by Green-Lagrange are the same within a per cent
_SMALL_STRAIN = 0.02
# what is said of equilibria without a positive definite tangent
_UNSTABLE = (
    "isn't stable: the body would buckle (a small imperfection of mesh or load shows where to), or "
    "be torn where its material softens"
)
_UNCERTAIN = (
    "may not be stable: loads that follow have no potential there, and the symmetric part of the "
    "stiffness isn't positive definite, which would be enough"
)


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
    steps = _with_work(model, steps)
    last = steps[-1]
    reasons = () if solver.plan is None else solver.plan.lines
    return Solution(
        **load_path_results(steps, last),
        converged=message == "converged",
        unknowns=int(equation.unknown.sum()),
        message=message,
        warnings=(
            *_strain_warning(equation, last.u),
            *_upside_down_warning(model, last.u),
            *_flow_warning(steps),
            *_locking_warning(responses),
            *_stability_warnings(equation, steps),
        ),
        timings=options.clock.timings,
        method="newton",
        backend="numpy",
        real="f64",
        element_classes=model.mesh.cell_count,
        reasons=reasons,
        model=model,
    )


def _stability_warnings(equation: Equation, steps: list[LoadStep]) -> list[str]:
    """Wanted steps that end where a body wouldn't stay, or perhaps wouldn't."""
    loose: dict[str, list[int]] = {}
    for number, step in enumerate((one for one in steps if one.wanted), 1):
        if not step.iterations[-1].definite:
            skew = equation.skew_stiffness(step.u, step.factors)
            loose.setdefault(_UNSTABLE if skew is None else _UNCERTAIN, []).append(number)
    return [
        f"{len(numbers)} load steps, first number {numbers[0]}, end in an equilibrium that {what}"
        for what, numbers in loose.items()
    ]


def _upside_down_warning(model: Model, u: Float) -> tuple[str, ...]:
    """Cells whose corners have passed through one another, which no integration point need see."""
    least = [
        least_jacobian(kind, model.mesh.points + u, cells) for kind, _, cells in model.mesh.blocks()
    ]
    inverted = int((np.concatenate(least) <= 0.0).sum())
    return (f"{inverted} cells are turned inside out at a corner",) if inverted else ()


def _flow_warning(steps: Sequence[LoadStep]) -> tuple[str, ...]:
    """Where flow is taken in the direction that it has at the end of a long step: by shear of 0.1,
    0.5 and 1 in one step, which turns it, forces are 0.14, 3 and 10 per cent too small."""
    before, most = np.zeros(1), 0.0
    for step in steps:
        if step.stress is not None and (plastic := step.stress.nodal_plastic_strain) is not None:
            most = max(most, float(np.nanmax(plastic - before)) / step.substeps)
            before = plastic
    if not most > _MOST_FLOW:
        return ()
    return (
        f"plastic strain grows by up to {most:.2g} in one step: where its direction turns, stress "
        f"may be {0.4 * most**2:.1%} off (load steps in between make it less)",
    )


def _locking_warning(responses: Sequence[ElementResponse]) -> list[str]:
    """Metal in cells that can't flow at constant volume."""
    blocks = [one.block for one in responses if isinstance(one.block.law, J2)]
    return [
        f"{len(block.cells)} {block.name} ({block.formulation!r}) can't flow at constant volume: "
        "where metal yields they are far too stiff"
        for block in blocks
        if not fit_for_flow(block.name, block.formulation)
    ]


def _strain_warning(equation: Equation, u: Float) -> tuple[str, ...]:
    """Where elements for small strain are strained more than they are made for."""
    strains = [
        response.strain_extent(which, u)
        for response in equation.responses
        if isinstance(response, Corotational)
        for which in portions(len(response.cells))
    ]
    strain = np.concatenate(strains) if strains else np.zeros(1)
    beyond = int((strain > _SMALL_STRAIN).sum())
    if not beyond:
        return ()
    return (
        f"{beyond} cells are strained by up to {strain.max():.2%}: linear elastic laws are meant "
        f"for {_SMALL_STRAIN:.0%} at most (SaintVenantKirchhoff, Hencky and NeoHookean hold "
        "beyond)",
    )


def _with_work(model: Model, steps: Sequence[LoadStep]) -> list[LoadStep]:
    """With the work of loads and supports along the path, up to each step (trapezoidal rule)."""
    total, u, forces = 0.0, np.zeros_like(steps[0].u), np.zeros_like(steps[0].u)
    told = []
    for step in steps:
        acting = external_forces(model, step.u, step.factors) + step.reactions
        total += 0.5 * float(np.vdot(acting + forces, step.u - u))
        u, forces = step.u, acting
        told.append(replace(step, external_work=total))
    return told
