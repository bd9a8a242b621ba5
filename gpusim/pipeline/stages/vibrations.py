"""Bodies that vibrate or buckle: their modes, steady vibrations, and motions in time."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim import fem
from gpusim.arrays.array_types import Float
from gpusim.errors import InputError, NotConverged
from gpusim.graph.runner import Inputs
from gpusim.graph.session import Session
from gpusim.graph.stage import StageResult
from gpusim.motion import Oscillation, Transient
from gpusim.pipeline.notes import notes_of
from gpusim.pipeline.scene_objects.modelling import BodyModel, linear_at_rest
from gpusim.pipeline.scene_objects.vibrations import VIBRATION, stored_vibration, vibration_arrays
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
        rates, count = columns.get("frequency_Hz", np.zeros(len(shapes))), len(shapes)
        motion = Oscillation(range(1, count + 1), shapes / length[:, None, None], rates, rest)
        self.arrays |= vibration_arrays(motion, number)
        self.tell_modes(body, range(1, count + 1), columns)

    def tell_modes(self, body: Body, names: Iterable[Any], columns: Mapping[str, Float]) -> None:
        """A row for each mode of those ``names``."""
        values = [column.tolist() for column in columns.values()]
        for name, *row in zip(names, *values, strict=True):
            told = dict(zip(columns, row, strict=True))
            self.modes.append({"body": body.name, "mode": name, **told})

    def result(self, session: Session, words: str) -> StageResult:
        """Of the stage."""
        said = {"modes": self.modes, "charts": [asdict(one) for one in self.charts]}
        notes = notes_of(self.warnings, self.facts, session.adapter) | said
        return StageResult({VIBRATION: partial(save_arrays, self.arrays)}, notes, words)


def modal(scene: Scene, inputs: Inputs, session: Session) -> StageResult:
    """The lowest modes of each body, or those of a band."""
    _, asked = inputs.row
    found = Vibrations()
    for number, body, made in moving_models(scene, inputs):
        model, solution = linear_at_rest(made.model), None
        rest = np.zeros(model.mesh.points.shape)
        if asked["prestress"]:
            (solution,) = solve_bodies(scene.solver, [body], [model], session.options,
                                       inputs.progress)  # fmt: skip
            rest = solution.u
        with named(body):
            result = _elastic(model, body, asked, solution)
        free = int(np.count_nonzero(result.frequencies == 0.0))
        found.take(body, result, f"{len(result.frequencies) - free} modes, {result.method}")
        shares = 100.0 * result.effective_mass / np.maximum(result.total_mass, 1e-300)
        columns = {"frequency_Hz": result.frequencies, "error": result.error_estimate}
        columns |= {name: shares[:, k].round(4) for k, name in enumerate(MASSES)}
        rigid, elastic = (
            {name: values[rows] for name, values in columns.items()}
            for rows in (slice(free), slice(free, None))
        )
        found.tell_modes(body, result.rigid, rigid)
        found.take_modes(number, body, elastic, result.shapes[free:], rest)
    return found.result(session, f"{len(found.modes)} modes")


def buckling(scene: Scene, inputs: Inputs, session: Session) -> StageResult:
    """The lowest critical load factors of each body."""
    _, asked = inputs.row
    found = Vibrations()
    for number, body, made in moving_models(scene, inputs):
        model = linear_at_rest(made.model)
        with named(body):
            result = fem.buckling(model, asked["count"], formulation=body.formulation)
        found.take(body, result, f"{len(result.factors)} critical loads, {result.method}")
        columns = {"load_factor": result.factors, "error": result.error_estimate}
        rest = np.zeros(model.mesh.points.shape)
        found.take_modes(number, body, columns, result.shapes, rest)
    return found.result(session, f"{len(found.modes)} critical loads")


def harmonic(scene: Scene, inputs: Inputs, session: Session) -> StageResult:
    """The steady vibration of each body at some frequencies, and how it varies over a band."""
    _, asked = inputs.row
    frequencies, band = asked["frequencies_Hz"], asked.get("band_Hz")
    found, shown = Vibrations(), slice(len(frequencies))
    curve = np.linspace(band[0], band[1], RESPONSES) if band else np.zeros(0)
    shaker = shaker_of(asked.get("base_motion"))
    for number, body, made in moving_models(scene, inputs):
        model = linear_at_rest(made.model)
        with named(body):
            result = fem.harmonic(
                model, [*frequencies, *curve], loads=np.ones(len(model.load_cases)), base=shaker,
                damping=damping_of(asked), count=asked["count"], mass=asked["mass"],
                formulation=body.formulation,
            )  # fmt: skip
        lacking = float(result.truncation.max())
        found.facts[f"solved, {body.name}"] = f"modes lack {lacking:.1e} of the response at most"
        seen, still = result.absolute(), np.zeros(model.mesh.points.shape)
        u = np.tensordot(seen.coordinates[shown], seen.shapes, axes=1)
        motion = Oscillation(range(1, len(u) + 1), u, np.array(frequencies), still)
        found.arrays |= vibration_arrays(motion, number)
        if band:
            found.charts.append(_response(body, result, curve))
    return found.result(session, f"{len(frequencies)} frequencies, {len(curve)} of a curve")


def vibration(scene: Scene, inputs: Inputs, session: Session) -> Oscillation | Transient | None:
    """The motion of one body, from its file."""
    number, name = inputs.row
    with np.load(inputs.read("solve", VIBRATION).stream(), allow_pickle=False) as stored:
        return stored_vibration(stored, number, name, scene.analysis)


@contextmanager
def named(body: Body) -> Iterator[None]:
    """What goes wrong is told of a ``body``."""
    try:
        yield
    except (InputError, NotConverged) as error:
        raise type(error)(f"solve, body {body.name!r}: {error}") from None


def moving_models(scene: Scene, inputs: Inputs) -> Iterator[tuple[int, Body, BodyModel]]:
    """The bodies that move, with their numbers, and what they are solved as."""
    moved, *_ = inputs.row
    for number, body in enumerate(scene.bodies):
        if moved[number]:
            yield number, body, inputs[f"model/{body.name}"]


def _elastic(
    model: fem.Model, body: Body, asked: Mapping[str, Any], prestress: fem.Solution | None
) -> fem.Modes:
    """Modes that are ``asked`` for, and rigid-body ones beside them."""
    options = {"formulation": body.formulation, "mass": asked["mass"], "prestress": prestress}
    if "band_Hz" in asked:
        return fem.modes(model, band=tuple(asked["band_Hz"]), **options)
    free = 0
    while True:
        result = fem.modes(model, asked["count"] + free, **options)
        if len(result.rigid) <= free:
            return result
        free = len(result.rigid)


def _response(body: Body, result: fem.HarmonicResponse, frequencies: Float) -> Chart:
    """Over the last ``frequencies``, at the node that moves most at those before them."""
    first = len(result.frequencies) - len(frequencies)
    most = np.tensordot(result.coordinates[:first], result.shapes, axes=1)
    node = int((np.abs(most) ** 2).sum(axis=(0, 2)).argmax())
    amplitude = 1e3 * np.abs(result.coordinates[first:] @ result.shapes[:, node])
    about = "Amplitude of " + place_of(result.model, node)
    about += "." if result.base is None else ", relative to the shaker."
    return Chart(
        f"Response, {body.name}", about,
        "Frequency (Hz)", "Amplitude (mm)", frequencies.tolist(),
        {axis: amplitude[:, k].tolist() for k, axis in enumerate("xyz")}, log=True,
    )  # fmt: skip


def damping_of(asked: Mapping[str, Any]) -> Any:
    """What an [analysis] says of damping, if anything."""
    given = asked.get("damping", {})
    if "ratio" in given:
        return fem.ModalDamping(given["ratio"])
    if "loss_factor" in given:
        return fem.StructuralDamping(given["loss_factor"])
    rates = [given.get(f"rayleigh_{key}", 0.0) for key in ("mass_per_s", "stiffness_s")]
    return fem.Rayleigh(*rates) if given else None


def shaker_of(table: Mapping[str, Any] | None) -> Float | None:
    """(3,) m/s2, the amplitude of a shaker's acceleration; None where there is none."""
    if table is None:
        return None
    direction = np.array(table["direction"])
    return np.asarray(table["acceleration_m_s2"] / np.linalg.norm(direction) * direction)


def place_of(model: fem.Model, node: int) -> str:
    """The place of a node, in words."""
    return "the point at ({:.4g}, {:.4g}, {:.4g}) mm".format(*(1e3 * model.mesh.points[node]))
