"""Large displacements: which bodies linear theory is too far off for, and their equilibria."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from math import inf
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim import fem
from gpusim.arrays.array_types import Float
from gpusim.errors import NotConverged
from gpusim.fem.assembly.equation import external_forces
from gpusim.fem.procedures.expansion import higher_orders
from gpusim.fem.recovery.linear_theory import stretching
from gpusim.graph.runner import Inputs
from gpusim.graph.session import Session
from gpusim.graph.stage import StageResult
from gpusim.motion import State, Stepped, Superposed
from gpusim.pipeline.checks.linear_theory import LinearMotion, linear_motion
from gpusim.pipeline.notes import notes_of
from gpusim.pipeline.scene_objects.load_steps import STEPS, step_arrays
from gpusim.pipeline.scene_objects.modelling import BodyModel
from gpusim.pipeline.scene_objects.moving_bodies import MovingBodies, moving_bodies
from gpusim.pipeline.scene_objects.solution import SceneSolution, support_forces
from gpusim.pipeline.stages.mechanics import save_arrays, solver_arguments
from gpusim.report import LoadStepRow
from gpusim.scene import Scene
from gpusim.scene.description.model import Body
from gpusim.scene.frames import FrameTable, Instant

SMALL = 0.002
"""Of a displacement: what linear theory may be off by where nobody says how bodies are solved."""
SMALL_TURN, SURE_TURN, FAR_TURN = 0.02, 0.03, 0.06
"""rad: of a bar displacements are off by twice the mean square of its rotation at most, here by
less than 0.08 and 0.2 %; of a cantilever under a force by 0.17 %, and its end comes back by 2 %."""
STRETCHING = 3e-4
"""Of strains: three times what could make a difference of 0.2 %."""


@dataclass(frozen=True, eq=False)
class _LoadPath:
    """What a ``body`` goes through: its states, by the ``instants`` of the frames that have them
    first. ``weights`` (K, L): of the load cases of its ``model``; ``linear``: its motion by linear
    theory."""

    body: Body
    model: fem.Model
    instants: Mapping[State, Instant]
    weights: Float
    linear: Superposed


def equilibria(scene: Scene, inputs: Inputs, session: Session) -> StageResult:
    """Of the bodies that linear theory is too far off for, and what speaks for it."""
    geometry, table, stressed = inputs.row
    frames = FrameTable(table)
    objects = moving_bodies(scene, inputs, [one.shown for one in frames])
    solved: SceneSolution = inputs["solution"]
    objects.motions = [solved.superposed(number) for number in range(len(scene.bodies))]
    facts, rows, warnings = dict[str, str](), list[LoadStepRow](), list[str]()
    arrays, forces = dict[str, npt.NDArray[Any]](), dict[str, Any]()
    for number, body in enumerate(scene.bodies):
        made: BodyModel = inputs[f"model/{body.name}"]
        path = _load_path(objects, number, frames, made.displaced)
        why = body.large_displacements(geometry) if path.instants else ""
        if not why:
            motion = linear_motion(objects, number)
            if motion.doubtful:
                warnings.append(f"body {body.name!r}: {motion.doubtful}")
            off = _correction(motion, path, frames[motion.frame].shown.states[number])
            told = _told(motion, off)
            if not abs(off) > SMALL:
                facts[f"linear statics, {body.name}"] = told
                continue
            why = f"by linear theory it {told}"
        solution = _solved(path, scene, session, inputs)
        found = [
            _row(path, instant, step)
            for instant, step in zip(path.instants.values(), solution.steps, strict=True)
        ]
        facts[f"nonlinear statics, {body.name}"] = f"{why}; {_changed(found)}"
        warnings += [f"body {body.name!r}: {text}" for text in solution.warnings]
        reactions = np.stack([step.reactions for step in solution.steps])
        stepped = Stepped(
            tuple(path.instants),
            np.stack([step.u for step in solution.steps]),
            support_forces(reactions, path.model, made.support),
        )
        forces[body.name] = _forces(path, stepped, frames[frames.last_moved].shown.states[number])
        wanted = {frames[frame].shown.states[number] for frame in stressed}
        steps = zip(path.instants, solution.steps, strict=True)
        stresses = {state: step.stress for state, step in steps if state in wanted}
        arrays |= step_arrays(stepped, stresses, number)
        rows += found
    notes = notes_of(warnings, facts, session.adapter)
    notes |= {"steps": [asdict(row) for row in rows], "forces": forces}
    iterations = sum(row.iterations for row in rows)
    words = f"{len(rows)} load steps, {iterations} iterations" if rows else "linear theory will do"
    return StageResult({STEPS: partial(save_arrays, arrays)} if arrays else {}, notes, words)


def _correction(motion: LinearMotion, path: _LoadPath, state: State | None) -> float:
    """By what share of the greatest displacement linear theory is too small in a state, to third
    order in the load; infinite where the body turns too far to tell."""
    model = path.model
    if state is None:  # at rest: forces that move nothing
        return 0.0
    if motion.turn > (SURE_TURN if model.constraints else FAR_TURN):
        return inf
    u = path.linear.displacement(state)
    bends = motion.turn > SMALL_TURN or stretching(model.mesh, u) > STRETCHING
    if model.constraints or not bends:
        return 0.0
    moved = u + higher_orders(model, u, np.array(state), path.body.formulation)
    return _greatest(moved) / _greatest(u) - 1.0


def _told(motion: LinearMotion, off: float) -> str:
    if abs(off) == inf:
        return motion.fact
    if abs(off) < 0.001:
        return f"{motion.fact}: displacements are less than 0.1 % off"
    way = "large" if off < 0.0 else "small"
    return f"{motion.fact}: displacements are about {100 * abs(off):.2g} % too {way}"


def _load_path(
    objects: MovingBodies, number: int, frames: FrameTable, model: fem.Model
) -> _LoadPath:
    first: dict[State, Instant] = {}
    for instant in frames:
        state = instant.shown.states[number]
        if state is not None:
            first.setdefault(state, instant)
    linear = objects.motions[number]
    assert isinstance(linear, Superposed)
    weights = np.array([state[: len(model.load_cases)] for state in first])
    return _LoadPath(objects.bodies[number].body, model, first, weights, linear)


def _solved(path: _LoadPath, scene: Scene, session: Session, inputs: Inputs) -> fem.Solution:
    """Of a whole path, without the steps that nobody asked for. Raises NotConverged, naming the
    first frame that has no equilibrium."""
    asked = solver_arguments(scene.solver, path.body, session.options, inputs.progress)
    steps: tuple[fem.LoadStep, ...] = ()
    try:
        solution = fem.solve(path.model, geometry="nonlinear", factors=path.weights, **asked)
        steps, why = tuple(step for step in solution.steps if step.wanted), solution.message
    except NotConverged as error:
        why = str(error)
    instants = tuple(path.instants.values())
    if len(steps) < len(instants):
        missing = instants[len(steps)]
        where = f"solve, body {path.body.name!r}, frame {missing.number} (load {missing.factor:g})"
        reached = "no frame was reached"
        if steps:
            last = instants[len(steps) - 1].number
            reached = f"load_factors of frames 0 to {last} alone can be run, these were reached"
        raise NotConverged(f"{where}: {why}; {reached}")
    return replace(solution, steps=steps)


def _row(path: _LoadPath, instant: Instant, step: fem.LoadStep) -> LoadStepRow:
    return LoadStepRow(
        body=path.body.name,
        frame=instant.number,
        factor=instant.factor,
        moved_mm=1e3 * _greatest(step.u),
        linear_mm=1e3 * _greatest(path.linear.displacement(tuple(step.factors))),
        iterations=len(step.iterations),
        solver_iterations=sum(one.solver_iterations for one in step.iterations),
        substeps=step.substeps,
        error_estimate=step.error_estimate,
        stored_J=step.strain_energy,
        work_J=step.external_work,
    )


def _greatest(u: Float) -> float:
    return float(np.linalg.norm(u, axis=1).max(initial=0.0))


def _changed(rows: Sequence[LoadStepRow]) -> str:
    """What large displacements have changed, where most moves."""
    row = max(rows, key=lambda row: row.linear_mm)
    return (
        f"greatest displacement {row.moved_mm:.4f} mm in frame {row.frame}, "
        f"{row.linear_mm:.4f} mm by linear theory"
    )


def _forces(path: _LoadPath, motion: Stepped, state: State | None) -> dict[str, Any]:
    """N, in a state: those of the supports, and the sum of the loads."""
    if state is None:
        return {}
    weights = np.array(state[: len(path.model.load_cases)])
    applied = external_forces(path.model, motion.displacement(state), weights).sum(axis=0)
    return {"reactions": motion.reactions(state).tolist(), "applied": applied.tolist()}
