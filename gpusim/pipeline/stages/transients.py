"""Motions of bodies in time: at the instants that cameras look at, and as curves of a report."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from gpusim import fem
from gpusim.arrays.array_types import Float
from gpusim.errors import NotConverged
from gpusim.fem.dynamics.modal_superposition import ModalMotion
from gpusim.fem.model.history import ENERGIES
from gpusim.graph.runner import Inputs
from gpusim.graph.session import Session
from gpusim.graph.stage import StageResult
from gpusim.motion import Course, Transient
from gpusim.pipeline.scene_objects.modelling import linear_at_rest
from gpusim.pipeline.scene_objects.vibrations import ground_of, vibration_arrays
from gpusim.pipeline.stages.mechanics import solver_arguments
from gpusim.pipeline.stages.vibrations import (
    Vibrations,
    damping_of,
    moving_models,
    named,
    place_of,
)
from gpusim.report import Chart
from gpusim.scene import Scene

FINE = 1e-7
"""Of the greatest displacement: what a motion may be off by between its instants."""
MOST_HALVINGS = 12
CORNER = 1e-6
"""Of the time around a frame: how long a corner of a motion takes."""
CURVE = 1001
"""Instants of a curve in the report."""
LOOKS = 100
"""Instants at which the node is looked for that moves most."""


def transient(scene: Scene, inputs: Inputs, session: Session) -> StageResult:
    """The motion of each body at the instants of frames, and around them."""
    _, asked = inputs.row
    frames, around, how = np.array(asked["frames"]), asked["around"], asked["how"]
    step = how.get("step")
    ground, found = ground_of(scene), Vibrations()
    for number, body, made in moving_models(scene, inputs):
        model = linear_at_rest(made.model) if how["geometry"] == "linear" else made.displaced
        times, amplitudes, start = asked["histories"][number]
        initial = None
        if start:
            solver = solver_arguments(scene.solver, body, session.options, inputs.progress)
            u = _equilibrium(model, start, how["geometry"], solver, body.name)
            initial = u, np.zeros_like(u)
        instants = curve = _instants(frames, around, times[-1], around if step is None else step)
        if step is None:  # those of modes cost next to nothing
            curve = np.union1d(instants, np.linspace(0.0, times[-1], CURVE))
        with named(body):
            history = fem.transient(
                model, times=curve, loads=fem.Record(np.array(times), np.array(amplitudes).T),
                damping=damping_of(asked), initial=initial, base=ground,
                formulation=body.formulation, **how,
            )  # fmt: skip
        found.take(body, history, f"{history.message}; energy to {history.energy.drift:.1e}")
        if history.modal is None:
            motion = Transient(Course(instants, np.asarray(history.u), np.asarray(history.v)))
        else:
            motion = _superposed(history.modal, instants, around)
            assert motion.natural is not None
            frequency, damping = motion.natural[:, motion.natural[0] > 0.0]
            columns = {"frequency_Hz": frequency, "damping_percent": 100.0 * damping}
            found.tell_modes(body, range(1, len(frequency) + 1), columns)
        motion = motion if ground is None else _on_ground(motion, ground)
        found.arrays |= vibration_arrays(motion, number)
        found.charts += _charts(body.name, history, ground is not None)
    return found.result(session, "; ".join(dict.fromkeys(found.facts.values())))


def _equilibrium(
    model: fem.Model, weights: Sequence[float], geometry: str, solver: dict[str, Any], name: str
) -> Float:
    """(N, 3) under the load cases by their ``weights``. Raises NotConverged, with the body's
    ``name``."""
    if geometry == "nonlinear":
        solver |= {"geometry": geometry, "factors": [weights]}
    solution = fem.solve(model, **solver)
    if not solution.converged:
        raise NotConverged(f"solve, body {name!r}: {solution.message}")
    u = solution.u.reshape(-1, *model.mesh.points.shape)
    return u[-1] if geometry == "nonlinear" else np.tensordot(weights, u, axes=1)


def _on_ground(motion: Transient, ground: fem.Record) -> Transient:
    """A motion relative to the ground, which rests until it is accelerated, as a camera that stands
    still sees it."""
    from scipy.interpolate import make_interp_spline

    acceleration, course = make_interp_spline(ground.times, ground.values, k=1), motion.course
    x, v, a = (acceleration.antiderivative(order)(course.times) for order in (2, 1, 0))
    if motion.shapes is None:
        return Transient(
            Course(course.times, course.values + x[:, None], course.rates + v[:, None])
        )
    along = np.zeros((3, *motion.shapes.shape[1:]))
    along[[0, 1, 2], :, [0, 1, 2]] = 1.0
    assert course.accelerations is not None  # of shapes they are known
    known = ((course.values, x), (course.rates, v), (course.accelerations, a))
    moved = Course(course.times, *(np.hstack(pair) for pair in known))
    return Transient(moved, np.concatenate([motion.shapes, along]), motion.natural)


def _instants(frames: Float, around: float, end: float, spacing: float) -> Float:
    """Frames, and what is at most ``around`` s before and after them, so far apart; from 0 to an
    ``end``."""
    count = 2 * int(np.ceil(around / spacing)) + 1 if around else 1
    times = frames[:, None] + around * np.linspace(-1.0, 1.0, count)
    return np.unique(np.clip(np.append(times, [0.0, end]), 0.0, end))


def _superposed(modal: ModalMotion, instants: Float, around: float) -> Transient:
    """Modes at so many instants that what is between those near frames is known as well."""
    from scipy.interpolate import BPoly

    size = np.linalg.norm(modal.shapes, axis=2).max(axis=1)
    instants = np.union1d(instants, _kinks(modal.static.times, instants, around))
    for _ in range(MOST_HALVINGS):
        known = modal.coordinates(instants)[:3]
        near = np.diff(instants) <= around * (1.0 + 1e-9)
        middle = (0.5 * (instants[:-1] + instants[1:]))[near]
        if not len(middle):
            break
        between = BPoly.from_derivatives(instants, np.stack(known, axis=1))(middle)
        off = np.abs(between - modal.coordinates(middle)[0]) @ size
        if off.max() <= FINE * (np.abs(known[0]) @ size).max():
            break
        instants = np.union1d(instants, middle)
    angular = modal.modes.angular
    natural = np.stack([angular, 0.5 * modal.modes.damping / np.maximum(angular, 1e-300)])
    natural[0] /= 2.0 * np.pi
    return Transient(Course(instants, *modal.coordinates(instants)[:3]), modal.shapes, natural)


def _kinks(kinks: Float, instants: Float, around: float) -> Float:
    """Those between ``instants`` near frames, and just before each: what has no inertia turns a
    corner there, and its rate is known on one side at a time."""
    number = np.searchsorted(instants, kinks).clip(1, len(instants) - 1)
    near = kinks[np.diff(instants)[number - 1] <= around * (1.0 + 1e-9)]
    corners: Float = np.append(near, near - CORNER * around)
    return corners.clip(instants[0], instants[-1])


def _charts(name: str, history: fem.History, shaken: bool) -> list[Chart]:
    """How the node moves that moves most, and where the energy is."""
    times: Any = history.times.tolist()
    looked = np.unique(np.linspace(0, len(times) - 1, LOOKS).astype(int))
    node = int(np.max([np.linalg.norm(history.u[k], axis=1) for k in looked], axis=0).argmax())
    moved = 1e3 * np.asarray(history.u[:, node])
    motion = {axis: moved[:, k].tolist() for k, axis in enumerate("xyz")}
    energy = {key.replace("_", " "): getattr(history.energy, key).tolist() for key in ENERGIES}
    place = place_of(history.model, node)
    about = "Relative to the ground." if shaken else ""
    return [
        Chart(f"Motion, {name}", f"Of {place}, which moves most. {about}".strip(), "Time (s)",
              "Displacement (mm)", times, motion),
        Chart(f"Energy, {name}", about, "Time (s)", "Energy (J)", times, energy),
    ]  # fmt: skip
