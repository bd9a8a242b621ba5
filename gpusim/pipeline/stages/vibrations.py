"""Bodies that vibrate or buckle: their modes, steady vibrations, and motions in time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
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
from gpusim.motion import Oscillation, Transient
from gpusim.pipeline.notes import notes_of
from gpusim.pipeline.scene_objects.modelling import linear_at_rest
from gpusim.pipeline.scene_objects.vibrations import (
    VIBRATION,
    oscillation_arrays,
    stored_vibration,
)
from gpusim.pipeline.stages.mechanics import save_arrays, solve_bodies
from gpusim.report import Chart
from gpusim.scene import Scene
from gpusim.scene.description.model import Body

MASSES = tuple(f"{what}_{axis}_percent" for what in ("mass", "inertia") for axis in "xyz")
"""Of a body, what a mode takes up: its mass, and its moments of inertia."""
RESPONSES = 401
"""Frequencies of a curve in the report."""


@dataclass
class Vibrations:
    """Of all bodies: what is stored, and what is said of it."""

    arrays: dict[str, npt.NDArray[Any]] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    facts: dict[str, str] = field(default_factory=dict)
    modes: list[dict[str, Any]] = field(default_factory=list)
    charts: list[Chart] = field(default_factory=list)

    def take(self, body: Body, result: Any, fact: str) -> None:
        """Warnings, and how it was found, of a result of `gpusim.fem`. Raises NotConverged."""
        if not getattr(result, "converged", True):
            raise NotConverged(f"solve, body {body.name!r}: {result.message}")
        self.warnings += [f"body {body.name!r}: {text}" for text in result.warnings]
        self.facts[f"solved, {body.name}"] = fact

    def take_modes(
        self, number: int, body: Body, columns: Mapping[str, Float], shapes: Float, rest: Float
    ) -> None:
        """Shapes (n, N, 3) of a body about ``rest``, and what is said of each: ``columns`` (n,)."""
        length = np.linalg.norm(shapes, axis=2).max(axis=1, initial=1e-300)
        rates = columns.get("frequency_Hz", np.zeros(len(shapes)))
        numbers = range(1, len(shapes) + 1)
        motion = Oscillation(numbers, shapes / length[:, None, None], rates, rest)
        self.arrays |= oscillation_arrays(motion, number)
        rows = zip(*(values.tolist() for values in columns.values()), strict=True)
        self.modes += [
            {"body": body.name, "mode": k, **dict(zip(columns, row, strict=True))}
            for k, row in enumerate(rows, 1)
        ]

    def result(self, session: Session, words: str) -> StageResult:
        """Of the stage."""
        said = {"modes": self.modes, "charts": [asdict(one) for one in self.charts]}
        notes = notes_of(self.warnings, self.facts, session.adapter) | said
        return StageResult({VIBRATION: partial(save_arrays, self.arrays)}, notes, words)


def modes(scene: Scene, inputs: Inputs, session: Session) -> StageResult:
    """The lowest modes of each body, or those of a band."""
    count, band, prestressed, options = inputs.row
    found = Vibrations()
    for number, body in enumerate(scene.bodies):
        model, solution = linear_model(inputs, body), None
        rest = np.zeros(model.mesh.points.shape)
        if prestressed:
            (solution,) = solve_bodies(scene.solver, [body], [model], session.options,
                                       inputs.progress)  # fmt: skip
            rest = solution.u
        wanted = {"band": tuple(band)} if band else {"count": count}
        result = _elastic(model, body, wanted, {**options, "prestress": solution})
        free = int(np.count_nonzero(result.frequencies == 0.0))
        found.take(body, result, f"{len(result.frequencies) - free} modes, {result.method}")
        if free:
            found.facts[f"free, {body.name}"] = ", ".join(result.rigid)
        shares = 100.0 * result.effective_mass / np.maximum(result.total_mass, 1e-300)
        columns = {"frequency_Hz": result.frequencies, "error": result.error_estimate}
        columns |= {name: shares[:, k].round(4) for k, name in enumerate(MASSES)}
        elastic = {name: values[free:] for name, values in columns.items()}
        found.take_modes(number, body, elastic, result.shapes[free:], rest)
    return found.result(session, f"{len(found.modes)} modes")


def buckling(scene: Scene, inputs: Inputs, session: Session) -> StageResult:
    """The lowest critical load factors of each body."""
    found = Vibrations()
    for number, body in enumerate(scene.bodies):
        model = linear_model(inputs, body)
        result = fem.buckling(model, inputs.row[0], formulation=body.formulation)
        found.take(body, result, f"{len(result.factors)} critical loads, {result.method}")
        columns = {"load_factor": result.factors, "error": result.error_estimate}
        rest = np.zeros(model.mesh.points.shape)
        found.take_modes(number, body, columns, result.shapes, rest)
    return found.result(session, f"{len(found.modes)} critical loads")


def harmonic(scene: Scene, inputs: Inputs, session: Session) -> StageResult:
    """The steady vibration of each body at some frequencies, and how it varies over a band."""
    frequencies, band, damping, options = inputs.row
    found, shown = Vibrations(), len(frequencies)
    curve = np.linspace(band[0], band[1], RESPONSES) if band else np.zeros(0)
    for number, body in enumerate(scene.bodies):
        model = linear_model(inputs, body)
        result = fem.harmonic(
            model, [*frequencies, *curve], damping=damping_of(damping),
            formulation=body.formulation, **options,
        )  # fmt: skip
        lacking = float(result.truncation.max())
        found.facts[f"solved, {body.name}"] = f"modes lack {lacking:.1e} of the response at most"
        u = np.tensordot(result.coordinates[:shown], result.shapes, axes=1)
        rest = np.zeros(model.mesh.points.shape)
        motion = Oscillation(range(1, shown + 1), u, np.array(frequencies), rest)
        found.arrays |= oscillation_arrays(motion, number)
        if band:
            node = int((np.abs(u) ** 2).sum(axis=(0, 2)).argmax())
            answer = np.abs(result.coordinates[shown:] @ result.shapes[:, node])
            curves = {axis: (1e3 * answer[:, k]).tolist() for k, axis in enumerate("xyz")}
            found.charts.append(
                Chart(f"Response, {body.name}", f"Amplitude of {place_of(model, node)}.",
                      "Frequency (Hz)", "Amplitude (mm)", curve.tolist(), curves, log=True)
            )  # fmt: skip
    return found.result(session, f"{shown} frequencies, {RESPONSES if band else 0} of a curve")


def vibration(scene: Scene, inputs: Inputs, session: Session) -> Oscillation | Transient | None:
    """The motion of one body, from its file."""
    number, name = inputs.row
    with np.load(inputs.read("solve", VIBRATION).stream(), allow_pickle=False) as stored:
        return stored_vibration(stored, number, name, scene.analysis)


def linear_model(inputs: Inputs, body: Body) -> fem.Model:
    """What a body is solved as, about its state at rest."""
    return linear_at_rest(inputs[f"model/{body.name}"].model)


def _elastic(
    model: fem.Model, body: Body, wanted: Mapping[str, Any], options: Mapping[str, Any]
) -> fem.Modes:
    """Modes, rigid-body ones beside those that are ``wanted``."""
    asked, free = dict(wanted), 0
    while True:
        result = fem.modes(model, formulation=body.formulation, **asked, **options)
        if "count" not in asked or len(result.rigid) <= free:
            return result
        free = len(result.rigid)
        asked["count"] = wanted["count"] + free


def damping_of(given: Mapping[str, float]) -> Any:
    """What an [analysis] damping says; nothing where it is empty."""
    if "ratio" in given:
        return fem.ModalDamping(given["ratio"])
    if "loss_factor" in given:
        return fem.StructuralDamping(given["loss_factor"])
    rates = [given.get(f"rayleigh_{key}", 0.0) for key in ("mass_per_s", "stiffness_s")]
    return fem.Rayleigh(*rates) if given else None


def place_of(model: fem.Model, node: int) -> str:
    """The place of a node, in words."""
    return "the point at ({:.4g}, {:.4g}, {:.4g}) mm".format(*(1e3 * model.mesh.points[node]))
