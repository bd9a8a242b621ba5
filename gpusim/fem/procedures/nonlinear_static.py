"""Nonlinear statics: equilibrium at large displacements, load step by load step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import NotConverged
from gpusim.fem.assembly.element_responses import element_responses
from gpusim.fem.assembly.equation import Equation, external_forces, portions
from gpusim.fem.assembly.stiffness_rounding import extremes
from gpusim.fem.elements.corotational import Corotational
from gpusim.fem.linear.solve_plan import Options
from gpusim.fem.linear.tangent_solver import TangentSolver
from gpusim.fem.materials.law import Law
from gpusim.fem.model.model import Model
from gpusim.fem.model.solution import LoadStep, Solution
from gpusim.fem.procedures.load_steps import load_steps
from gpusim.fem.procedures.newton import Controls
from gpusim.fem.recovery.cauchy_stress import cauchy_stress
from gpusim.mesh.quality import least_jacobian

# relative accuracy of linear solutions where all laws are elastic, and where points flow
_FORCING, _PLASTIC_FORCING = 1e-4, 1e-2
# of the accumulated plastic strain in one step: stress is a fifth of a per cent off at most
_MOST_FLOW = 0.07
# up to which strains by length and by Green-Lagrange are the same within a per cent
_SMALL_STRAIN = 0.02


def nonlinear_static(model: Model, targets: Float, options: Options) -> Solution:
    """Equilibria at ``targets`` (K,L), the factors of the load cases.

    Steps that were found before one that isn't stay part of the solution, which hasn't converged
    then. Raises NotConverged where none was.
    """
    responses = element_responses(model, options.formulation)
    equation = Equation(model, responses)
    options.clock.mark("elements")
    solver = TangentSolver(equation, options)
    history = any(isinstance(law, Law) and law.state_size for law in model.materials)
    forcing = _PLASTIC_FORCING if history else _FORCING
    # loads that follow have a symmetric stiffness in part only, which tells nothing of stability
    controls = Controls(options.tolerance, forcing, not history, not model.loads, options.progress)
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
    last, every = steps[-1], [one for step in steps for one in step.iterations]
    work = float(path_work(model, steps)[-1])
    reasons = () if solver.plan is None else solver.plan.lines
    return Solution(
        u=last.u,
        converged=message == "converged",
        error_estimate=max(step.error_estimate for step in steps),
        iterations=sum(one.solver_iterations for one in every),
        residuals=np.array([[one.residual] for one in last.iterations]),
        reactions=last.reactions,
        strain_energy=np.array([work]),
        external_work=np.array([work]),
        unknowns=int(equation.unknown.sum()),
        message=message,
        warnings=(
            *_strain_warning(equation, last.u),
            *_upside_down_warning(model, last.u),
            *_flow_warning(steps),
            *_stability_warning(controls, steps),
        ),
        timings=options.clock.timings,
        method="newton",
        backend="numpy",
        real="f64",
        element_classes=model.mesh.cell_count,
        row_classes=model.mesh.node_count,
        reasons=reasons,
        model=model,
        steps=tuple(steps),
    )


def _stability_warning(controls: Controls, steps: list[LoadStep]) -> tuple[str, ...]:
    """Wanted steps that end where a body wouldn't stay."""
    wanted = [step for step in steps if step.wanted]
    loose = [n for n, step in enumerate(wanted, 1) if not step.iterations[-1].definite]
    if not loose or not controls.stable:
        return ()
    return (
        f"{len(loose)} load steps, first number {loose[0]}, end in an equilibrium that isn't "
        "stable: the body would buckle (a small imperfection of mesh or load shows where to), or "
        "be torn where its material softens",
    )


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


def _strain_warning(equation: Equation, u: Float) -> tuple[str, ...]:
    """Where elements for small strain are strained more than they are made for."""
    strains = [
        response.strain_extent(which, u)
        for response in equation.responses
        if isinstance(response, Corotational)
        for which in portions(response.cells)
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


def path_work(model: Model, steps: Sequence[LoadStep]) -> Float:
    """(K,) work of loads and supports along the path, up to each step (trapezoidal rule)."""
    total, u, forces = 0.0, np.zeros_like(steps[0].u), np.zeros_like(steps[0].u)
    works = []
    for step in steps:
        acting = external_forces(model, step.u, step.factors) + step.reactions
        total += 0.5 * float(np.vdot(acting + forces, step.u - u))
        u, forces = step.u, acting
        works.append(total)
    return np.array(works)
