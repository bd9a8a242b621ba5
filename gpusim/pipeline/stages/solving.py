"""Solving the bodies of a scene; or a model, or one body, without making images."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from gpusim import fem
from gpusim.errors import InputError, NotConverged
from gpusim.gpu import Device
from gpusim.pipeline.build.build import BodyParts, build_body
from gpusim.pipeline.build.modelling import build_model
from gpusim.plan.stages import RunOptions
from gpusim.scene import Scene
from gpusim.scene.amplitudes import load_groups
from gpusim.scene.description import model as m

__all__ = ["solve", "solve_bodies"]


def solve(problem: fem.Model | Scene, device: Device | None = None, **options: Any) -> fem.Solution:
    """Solve K u = F for a `Model`, or for the one body of a `Scene` at load factor 1.

    Loads of a scene whose amplitudes aren't multiples of each other are separate load cases.

    ``options`` are those of `gpusim.fem.solve` (``tolerance``, ``formulation``, ``backend``,
    ``max_iterations``, ``method``, ``start``, ``progress``); a scene brings its own
    tolerance, formulation and method, which they override.

    Raises
    ------
    InputError
        Neither a model nor a scene, or a scene without exactly one body; and what
        `gpusim.fem.solve` raises.

    Examples
    --------
    >>> bar = gs.mesh.box(size=(1, 0.1, 0.1), divisions=(4, 1, 1))
    >>> fixed = np.isclose(bar.points[:, :1], 0.0).repeat(3, axis=1)
    >>> forces = gs.fem.face_force(bar, gs.mesh.select_faces(bar, name="x_max"), total=(1e4, 0, 0))
    >>> solution = gs.solve(gs.Model(bar, [gs.Isotropic(210e9, 0.0)], fixed=fixed, forces=forces))
    >>> print(f"{1e6 * solution.u[:, 0].max():.3f} micrometres")
    4.762 micrometres
    """
    if isinstance(problem, Scene):
        if len(problem.bodies) != 1:
            raise InputError(
                f"solve: scene {problem.name!r}; got {len(problem.bodies)} bodies; expected one "
                "(run the scene, or solve a Model per body)"
            )
        body, solver = problem.bodies[0], problem.solver
        defaults = {
            "tolerance": solver.tolerance,
            "formulation": body.formulation,
            "max_iterations": solver.max_iterations,
            "method": solver.method,
        }
        groups = load_groups(body, problem.analysis.load_factors)
        model = build_model(build_body(body, problem.input), groups)
        return fem.solve(model, device, **{**defaults, **options})
    return fem.solve(problem, device, **options)


def solve_bodies(
    solver: m.Solver,
    bodies: Sequence[BodyParts],
    models: Sequence[fem.Model],
    options: RunOptions,
    progress: Callable[[float, str], None],
) -> list[fem.Solution]:
    """Solve each body's model; ``progress`` is called with (done 0..1, text).

    Raises
    ------
    NotConverged
        Naming the body; and what `gpusim.fem.solve` raises.
    """
    solutions = []
    for parts, model in zip(bodies, models, strict=True):

        def note(iterations: int, estimate: float, name: str = parts.body.name) -> None:
            done = min(0.99, max(0.0, np.log(max(estimate, 1e-300)) / np.log(solver.tolerance)))
            progress(done, f"{name}: iteration {iterations}, {estimate:.1e}")

        solution = fem.solve(
            model,
            tolerance=solver.tolerance,
            formulation=parts.body.formulation,
            max_iterations=solver.max_iterations,
            method=solver.method,
            progress=note,
            **options.for_solver(),
        )
        if not solution.converged:
            raise NotConverged(
                f"solve, body {parts.body.name!r}: stopped after {solution.iterations} "
                f"iterations at an estimated displacement error of "
                f"{solution.error_estimate:.2e}; expected {solver.tolerance:.1e}: "
                f"{solution.message}"
            )
        solutions.append(solution)
    return solutions
