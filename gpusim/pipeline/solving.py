"""Solving a model, or the body of a scene, without making images."""

from __future__ import annotations

from typing import Any

from gpusim import fem
from gpusim.errors import InputError
from gpusim.gpu import Device
from gpusim.pipeline.build import build_body
from gpusim.pipeline.modelling import build_model
from gpusim.scene import Scene
from gpusim.scene.amplitudes import load_groups

__all__ = ["solve"]


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
        model = build_model(build_body(body), groups)
        return fem.solve(model, device, **{**defaults, **options})
    return fem.solve(problem, device, **options)
