"""Mechanics of a run: models, their solution, the motions that follow, stress by frame."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO
from zipfile import ZipFile

import numpy as np
import numpy.typing as npt

from gpusim import fem
from gpusim.arrays.array_types import Float
from gpusim.errors import NotConverged
from gpusim.export.body_state import KNOWN
from gpusim.files.input_file import open_input
from gpusim.graph.runner import Inputs
from gpusim.graph.session import Session
from gpusim.graph.stage import StageResult
from gpusim.motion import Given, Motion, Stepped, Superposed
from gpusim.pipeline.checks.resources import check_field
from gpusim.pipeline.notes import Notes
from gpusim.pipeline.scene_objects.load_steps import STEPS, step_fields, stepped_motion
from gpusim.pipeline.scene_objects.modelling import (
    BodyModel,
    build_model,
    linear_at_rest,
    temperature,
)
from gpusim.pipeline.scene_objects.moving_bodies import MovingBodies, moving_bodies
from gpusim.pipeline.scene_objects.solution import SceneSolution, solver_seconds
from gpusim.pipeline.scene_objects.surfaces import MeshedBody
from gpusim.plan.stages import RunOptions
from gpusim.report import StressPeak
from gpusim.scene import Scene
from gpusim.scene.amplitudes import LoadGroup
from gpusim.scene.description import model as m
from gpusim.scene.frames import FrameTable
from gpusim.validation import require

DISPLACEMENT, STRESS = "solution/displacement.npz", "solution/stress.npz"


def model(scene: Scene, inputs: Inputs, session: Session) -> BodyModel:
    """What a body is solved as, a load case a group of its loads."""
    (body,) = scene.bodies
    meshed: MeshedBody = inputs[f"mesh/{body.name}"]
    cases, may_be_free = inputs.row
    groups = tuple(LoadGroup((), tuple(loads), tuple(supports)) for loads, supports in cases)
    return build_model(MeshedBody(body, meshed.mesh, meshed.skin), groups, may_be_free)


def solve_scene(scene: Scene, inputs: Inputs, session: Session) -> StageResult:
    """All bodies solved; what a report says of it, as well."""
    made: list[BodyModel] = [inputs[f"model/{body.name}"] for body in scene.bodies]
    models = [linear_at_rest(one.model) for one in made]
    found = solve_bodies(scene.solver, scene.bodies, models, session.options, inputs.progress)
    solved = SceneSolution.of(found, [one.model for one in made], [one.support for one in made])
    notes = asdict(Notes(solved.warnings, solved.facts, session.adapter))
    session.kept[f"seconds of {inputs.key}"] = solver_seconds(found)
    return StageResult(
        {DISPLACEMENT: partial(save_arrays, solved.arrays())},
        notes | {"solution": solved.said()},
        f"{solved.iterations} iterations, estimated error {solved.error_estimate:.1e}",
    )


def solution(scene: Scene, inputs: Inputs, session: Session) -> SceneSolution:
    """The solution, from its file."""
    with np.load(inputs.read("solve", DISPLACEMENT).stream(), allow_pickle=False) as stored:
        return SceneSolution.from_arrays(stored)


def motion(scene: Scene, inputs: Inputs, session: Session) -> Motion:
    """Of one body: its equilibria, or its load cases superposed."""
    number, name = inputs.row
    if inputs.has("equilibria") and name in inputs.notes("equilibria")[0]["forces"]:
        with np.load(inputs.read("equilibria", STEPS).stream(), allow_pickle=False) as stored:
            return stepped_motion(stored, number)
    solved: SceneSolution = inputs["solution"]
    return solved.superposed(number)


def given(scene: Scene, inputs: Inputs, session: Session) -> Given:
    """The motion of a body whose displacements another program has found."""
    meshed: MeshedBody = inputs[f"mesh/{inputs.row}"]
    assert meshed.field is not None
    check_field(meshed.field, scene.analysis.frame_values)
    return Given(meshed.field.at)


def stress(scene: Scene, inputs: Inputs, session: Session) -> StageResult:
    """Stress of every body in every frame that moves."""
    frames = FrameTable(inputs.row)
    objects = moving_bodies(scene, inputs, [one.shown for one in frames])
    models = [inputs[f"model/{body.name}"].model for body in scene.bodies]
    place = inputs.new_file(STRESS)
    with stored_steps(inputs) as steps:
        bodies = _Solved(objects, models, steps)
        peaks = write_stresses(place, bodies, frames, session.options.skip, inputs.progress)
    most = max((peak.von_mises for peak in peaks), default=0.0)
    notes = asdict(Notes()) | {"peaks": [asdict(peak) for peak in peaks]}
    return StageResult({STRESS: place}, notes, f"greatest von Mises stress {most / 1e6:.4g} MPa")


def solve_bodies(
    solver: m.SolverTable,
    bodies: Sequence[m.Body],
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
    for body, model in zip(bodies, models, strict=True):
        solution = fem.solve(model, **solver_arguments(solver, body, options, progress))
        if not solution.converged:
            where = f"solve, body {body.name!r}: stopped after {solution.iterations} iterations"
            reached = f"an estimated displacement error of {solution.error_estimate:.2e}"
            expected = f"{solver.tolerance:.1e}: {solution.message}"
            raise NotConverged(f"{where} at {reached}; expected {expected}")
        solutions.append(solution)
    return solutions


def solver_arguments(
    solver: m.SolverTable, body: m.Body, options: RunOptions, progress: Callable[[float, str], None]
) -> dict[str, Any]:
    """Keyword arguments of `gpusim.fem.solve`; ``progress`` as `solve_bodies` has it."""

    def note(iterations: int, estimate: float) -> None:
        done = min(0.99, max(0.0, np.log(max(estimate, 1e-300)) / np.log(solver.tolerance)))
        progress(done, f"{body.name}: iteration {iterations}, {estimate:.1e}")

    asked = {**dict(solver), "formulation": body.formulation, **options.for_solver()}
    return {**asked, "progress": note}


class Stresses:
    """Nodal stress (N, 6) Pa and the share of the error (M,) of each cell, from a file; of bodies
    at large displacements nodal strain as well.

    A frame in which nothing has moved has none. See ``gpusim.fem.Stress`` for what they are.
    """

    def __init__(self, source: Path | BinaryIO) -> None:
        self._source = open_input(source) if isinstance(source, Path) else source
        try:
            self._stored = np.load(self._source, allow_pickle=False)  # arrays as they are needed
        except BaseException:
            self._source.close()
            raise

    def close(self) -> None:
        """Let go of the file."""
        self._stored.close()
        self._source.close()

    def of(self, body: int, frame: int, parts: MeshedBody) -> dict[str, Any]:
        """By the names of `KNOWN`: nodal stress and the elements' shares of the error, zero in a
        frame without; and the strain of a body at large displacements."""
        nodes, cells = parts.mesh.node_count, parts.mesh.cell_count
        shapes = dict.fromkeys(KNOWN, (nodes, 6)) | {"plastic": (nodes,), "error": (cells,)}
        found: dict[str, Any] = {
            "stress": np.zeros((nodes, 6)),
            "error": np.zeros(cells),
        }
        for name, shape in shapes.items():
            if f"{name}{body}_{frame}" in self._stored:
                values = self._stored[f"{name}{body}_{frame}"]
                expected = f"{shape}: delete the output folder's solution/stress.npz"
                where = f"stress of body {parts.body.name!r}"
                require(values.shape == shape, where, f"shape {values.shape}", expected)
                found[name] = values
        return found


@dataclass(frozen=True, eq=False)
class _Solved:
    """Bodies that move, the ``models`` that they were solved as, and what is kept of the load
    ``steps`` of those at large displacements."""

    objects: MovingBodies
    models: Sequence[fem.Model]
    steps: Mapping[str, npt.NDArray[Any]]


def write_stresses(
    path: Path,
    solved: _Solved,
    frames: FrameTable,
    scaled: bool,
    progress: Callable[[float, str], None],
) -> list[StressPeak]:
    """Recover the stress of every body in every frame that moves, and keep it; returns the peak of
    each body in the last of them.

    A linear body with one load group has the same stress in all frames, but for a factor:
    ``scaled``.
    """
    moving = [instant.number for instant in frames if not instant.shown.still]
    objects, peaks = solved.objects, list[StressPeak]()
    with ZipFile(path, "w") as archive:
        for number, (parts, model) in enumerate(zip(objects.bodies, solved.models, strict=True)):
            if isinstance(objects.motions[number], Stepped):
                fields = _copied_stress(archive, solved, number, moving)
                if fields:
                    share = float(np.linalg.norm(fields["error"]))
                    peaks.append(_peak(parts, fem.von_mises(fields["stress"]), share))
                continue
            last: tuple[float, fem.Stress] | None = None
            for step, frame in enumerate(moving):
                done = (number + step / len(moving)) / len(objects.bodies)
                progress(done, f"{parts.body.name}: frame {frame}")
                weights = objects.frames[frame].states[number] or (0.0,)
                multiple = scaled and isinstance(objects.motions[number], Superposed)
                if last is not None and len(weights) == 1 and multiple:
                    found, factor = last[1], weights[0] / last[0]
                else:
                    found, factor = _recovered(objects, number, model, frame), 1.0
                    if weights[0]:
                        last = weights[0], found
                _store(archive, f"stress{number}_{frame}", factor * found.nodal)
                _store(archive, f"error{number}_{frame}", found.error_share)
            if moving:
                von_mises = abs(factor) * found.von_mises
                peaks.append(_peak(parts, von_mises, found.error_relative))
    return peaks


def _copied_stress(
    archive: ZipFile, solved: _Solved, number: int, moving: Sequence[int]
) -> dict[str, Any]:
    """What the load steps of a body have, by frame; gives the last one's."""
    fields: dict[str, Any] = {}
    for frame in moving:
        state = solved.objects.frames[frame].states[number]
        fields = step_fields(solved.steps, number, state)
        for name, values in fields.items():
            _store(archive, f"{name}{number}_{frame}", values)
    return fields


def _recovered(objects: MovingBodies, number: int, model: fem.Model, frame: int) -> fem.Stress:
    body = objects.scene.bodies[number]
    u = objects.displacement(number, frame)
    return fem.stress(model, u, body.formulation, temperature=temperature(body, frame) or None)


def save_arrays(arrays: dict[str, npt.NDArray[Any]], path: Path) -> None:
    with open(path, "wb") as stream:
        np.savez(stream, allow_pickle=False, **arrays)


def _peak(parts: MeshedBody, von_mises: Float, error: float) -> StressPeak:
    node = int(np.argmax(von_mises))
    x, y, z = parts.mesh.points[node].tolist()
    return StressPeak(parts.body.name, float(von_mises[node]), (x, y, z), error)


@contextmanager
def stored_steps(inputs: Inputs) -> Iterator[Mapping[str, npt.NDArray[Any]]]:
    """What is kept of load steps; nothing where every body is linear."""
    if not inputs.has("equilibria") or not inputs.notes("equilibria")[0]["steps"]:
        yield {}
        return
    with inputs.open("equilibria", STEPS) as source, np.load(source, allow_pickle=False) as stored:
        yield stored


def _store(archive: ZipFile, name: str, values: npt.NDArray[Any]) -> None:
    """One array of an .npz file, written as soon as it is there."""
    with archive.open(f"{name}.npy", "w", force_zip64=True) as entry:
        np.lib.format.write_array(entry, values, allow_pickle=False)
