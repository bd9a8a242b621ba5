"""Large displacements: which bodies linear theory is too far off for, and their equilibria."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim import fem
from gpusim.arrays.array_types import Float
from gpusim.errors import NotConverged
from gpusim.graph.runner import Inputs
from gpusim.graph.session import Session
from gpusim.graph.stage import StageResult
from gpusim.motion import Motion, State, Stepped, Superposed
from gpusim.pipeline.checks.linear_theory import LinearError, linear_error, with_stretching
from gpusim.pipeline.notes import notes_of
from gpusim.pipeline.scene_objects.load_steps import STEPS, step_arrays, stepped_motion
from gpusim.pipeline.scene_objects.modelling import BodyModel, displaced_model
from gpusim.pipeline.scene_objects.moving_bodies import MovingBodies, moving_bodies
from gpusim.pipeline.scene_objects.solution import SceneSolution, support_forces
from gpusim.pipeline.stages.mechanics import save_arrays, solver_arguments
from gpusim.report import LoadStepRow
from gpusim.scene import Scene
from gpusim.scene.amplitudes import load_groups
from gpusim.scene.frames import FrameTable, Instant

SMALL = 0.002
"""Of a displacement: what linear theory may be off by where nobody says how bodies are solved."""


@dataclass(frozen=True, eq=False)
class _LoadPath:
    """What a body goes through: ``states``, in the order of the frames that have them first,
    ``instants``. ``weights`` (K, L): of the load cases of its ``model``; ``linear``: its motion by
    linear theory."""

    body: str
    model: fem.Model
    states: Sequence[State]
    instants: Sequence[Instant]
    weights: Float
    linear: Superposed


def equilibria(scene: Scene, inputs: Inputs, session: Session) -> StageResult:
    """Of the bodies that linear theory is too far off for, and what speaks for it."""
    geometry, table = inputs.row
    frames = FrameTable(table)
    objects = moving_bodies(scene, inputs, [one.shown for one in frames])
    solved: SceneSolution = inputs["solution"]
    objects.motions = [solved.superposed(number) for number in range(len(scene.bodies))]
    facts, rows, warnings = dict[str, str](), list[LoadStepRow](), list[str]()
    arrays, forces = dict[str, npt.NDArray[Any]](), dict[str, Any]()
    for number, body in enumerate(scene.bodies):
        made: BodyModel = inputs[f"model/{body.name}"]
        path = _load_path(objects, number, frames, made.model, session)
        why, error = _choice(geometry, objects, number, path)
        if error is not None and error.doubtful:
            warnings.append(f"body {body.name!r}: {error.doubtful}")
        if error is not None and not why:
            facts[f"linear statics, {body.name}"] = error.fact
            continue
        solution = _solved(path, scene, number, session, inputs)
        found = [_row(path, solution.steps[k], k) for k in range(len(path.states))]
        facts[f"nonlinear statics, {body.name}"] = f"{why}; {_changed(found)}"
        warnings += [f"body {body.name!r}: {text}" for text in solution.warnings]
        reactions = np.stack([step.reactions for step in solution.steps])
        motion = Stepped(
            path.states,
            np.stack([step.u for step in solution.steps]),
            support_forces(reactions, path.model, made.support),
        )
        forces[body.name] = _forces(path, motion, frames[frames.last_moved].shown.states[number])
        arrays |= step_arrays(motion, [step.stress for step in solution.steps], number)
        rows += found
    notes = notes_of(warnings, facts, session.adapter)
    notes |= {"steps": [asdict(row) for row in rows], "forces": forces}
    iterations = sum(row.iterations for row in rows)
    words = f"{len(rows)} load steps, {iterations} iterations" if rows else "linear theory will do"
    return StageResult({STEPS: partial(save_arrays, arrays)} if arrays else {}, notes, words)


def motion(scene: Scene, inputs: Inputs, session: Session) -> Motion:
    """Of one body: its equilibria, or its load cases superposed."""
    number, name = inputs.row
    (said,) = inputs.notes("equilibria")
    if name not in said["forces"]:
        solved: SceneSolution = inputs["solution"]
        return solved.superposed(number)
    with np.load(inputs.read("equilibria", STEPS).stream(), allow_pickle=False) as stored:
        return stepped_motion(stored, number)


def _choice(
    geometry: str, objects: MovingBodies, number: int, path: _LoadPath
) -> tuple[str, LinearError | None]:
    """Why a body is solved at large displacements ("" if it isn't), and how far off linear theory
    is where that decides."""
    if not path.states:  # nothing moves it
        return "", linear_error(objects, number)
    if geometry == "nonlinear":
        return "asked for", None
    for material in objects.bodies[number].body.materials:
        if material.finite_strain:
            return f"linear theory doesn't know material {material.name!r}", None
    error, body = linear_error(objects, number), objects.bodies[number].body
    state = objects.frames[error.frame].states[number]
    if error.off <= SMALL and state is not None:  # at rest: forces that move nothing
        u, weights = path.linear.displacement(state), np.array(state)
        error = with_stretching(error, u, path.model, weights, body.formulation)
    return (f"by linear theory it {error.fact}" if error.off > SMALL else ""), error


def _load_path(
    objects: MovingBodies, number: int, frames: FrameTable, model: fem.Model, session: Session
) -> _LoadPath:
    first: dict[State, Instant] = {}
    for instant in frames:
        state = instant.shown.states[number]
        if state is not None:
            first.setdefault(state, instant)
    parts, linear = objects.bodies[number], objects.motions[number]
    assert isinstance(linear, Superposed)
    groups = load_groups(parts.body, tuple(one.factor for one in frames), session.options.skip)
    weights = np.array([state[: len(groups)] for state in first])
    model = displaced_model(parts, model, groups)
    instants = tuple(first.values())
    return _LoadPath(parts.body.name, model, tuple(first), instants, weights, linear)


def _solved(
    path: _LoadPath, scene: Scene, number: int, session: Session, inputs: Inputs
) -> fem.Solution:
    """Of a whole path, without the steps that nobody asked for. Raises NotConverged, naming the
    first frame that has no equilibrium."""
    body = scene.bodies[number]
    asked = solver_arguments(scene.solver, body, session.options, inputs.progress)
    steps: tuple[fem.LoadStep, ...] = ()
    try:
        solution = fem.solve(path.model, geometry="nonlinear", factors=path.weights, **asked)
        steps, why = tuple(step for step in solution.steps if step.wanted), solution.message
    except NotConverged as error:
        why = str(error)
    if len(steps) < len(path.states):
        missing = path.instants[len(steps)]
        where = f"solve, body {path.body!r}, frame {missing.number} (load {missing.factor:g})"
        reached = "no frame was reached"
        if steps:
            last = path.instants[len(steps) - 1].number
            reached = f"load_factors of frames 0 to {last} alone can be run, these were reached"
        raise NotConverged(f"{where}: {why}; {reached}")
    return replace(solution, steps=steps)


def _row(path: _LoadPath, step: fem.LoadStep, number: int) -> LoadStepRow:
    instant, linear = path.instants[number], path.linear.displacement(tuple(path.weights[number]))
    return LoadStepRow(
        body=path.body,
        frame=instant.number,
        factor=instant.factor,
        moved_mm=1e3 * _greatest(step.u),
        linear_mm=1e3 * _greatest(linear),
        iterations=len(step.iterations),
        solver_iterations=sum(one.solver_iterations for one in step.iterations),
        substeps=step.substeps,
        error_estimate=step.error_estimate,
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
    model, weights = path.model, path.weights[list(path.states).index(state)]
    applied = weights @ model.load_cases.sum(axis=1)
    for load in model.loads:
        points = model.mesh.points + motion.displacement(state)
        applied += weights[load.case] * load.forces(points).sum(axis=0)
    return {"reactions": motion.reactions(state).tolist(), "applied": applied.tolist()}
