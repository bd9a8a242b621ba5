"""Kinds of analysis: what moves a scene's bodies, and which stages find that out.

A kind is registered under the name that ``[analysis] type`` has for it.
"""

from __future__ import annotations

import importlib
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from gpusim.errors import InputError
from gpusim.scene.amplitudes import load_groups
from gpusim.scene.description.analysis.analysis_table import TABLES, AnalysisTable
from gpusim.scene.description.analysis.vibrations import OscillationTable
from gpusim.scene.description.scene_table import Body, SceneTable
from gpusim.scene.faults import schema_places

if TYPE_CHECKING:
    from gpusim.scene.scene import Scene

States = Sequence[tuple[float, ...] | None]


@dataclass(frozen=True)
class AnalysisKind:
    """One kind.

    table : of its keys.
    states : of a scene (whether multiples of a load are one case: its second argument), per body
        what its motion depends on in each frame, as plain data; None where it is at rest.
    stages : "module:function" that gives the stages which end in ``motion/<body>``, a
        `gpusim.motion.Motion` each.
    unsolved : why nothing is solved; "" where a model of each body is.
    """

    table: type[AnalysisTable]
    states: Callable[[Scene, bool], Sequence[States]]
    stages: str
    unsolved: str = ""

    def make_stages(self, build: Any) -> Any:
        """The stages, of what they are made with (`gpusim.plan.stage_builder.StageBuilder`)."""
        module, name = self.stages.split(":")
        return getattr(importlib.import_module(module), name)(build)


def add_analysis(name: str, kind: AnalysisKind) -> None:
    """Let scenes have ``[analysis] type = name``. Raises InputError for a name that another has."""
    if name in ANALYSES:
        raise InputError(f"kind of analysis: type; got {name!r} twice; expected a new one")
    ANALYSES[name], TABLES[name] = kind, kind.table
    SceneTable.model_rebuild(force=True)
    schema_places.cached_schema.cache_clear()


def kind_of(scene: Scene) -> AnalysisKind:
    """The kind of a scene's analysis."""
    return ANALYSES[scene.analysis.type]


def _weights(scene: Scene, scaled: bool) -> Sequence[States]:
    """Statics: the amplitude of each load case."""
    factors = scene.analysis.load_factors
    bodies = []
    for body in scene.bodies:
        groups = load_groups(body, factors, scaled)
        rows = list(zip(*(group.amplitude for group in groups), strict=True))
        acts = [bool(group.loads or group.supports) for group in groups]
        states = [
            row if any(w and act for w, act in zip(row, acts, strict=True)) else None
            for row in rows
        ]  # fmt: skip
        bodies.append(_told_apart(states, rows) if body.has_history else states)
    return bodies


def _told_apart(states: States, rows: Sequence[tuple[float, ...]]) -> States:
    """Of a body with history: where loads come back once it was loaded, states have the number of
    the visit after the weights of ``rows``."""
    visits: Counter[tuple[float, ...]] = Counter()
    found: list[tuple[float, ...] | None] = []
    for state, row, before in zip(states, rows, (None, *rows), strict=False):
        if state is None and not visits:
            found.append(None)
            continue
        visits[row] += row != before
        found.append((*row, float(visits[row])))
    if max(visits.values(), default=1) == 1:
        return [None if state is None else state[:-1] for state in found]
    return found


def _times(scene: Scene, scaled: bool) -> Sequence[States]:
    """Displacements that are given: the time."""
    return [[(time,) for time in scene.analysis.frame_values] for _ in scene.bodies]


def _instants(scene: Scene, scaled: bool) -> Sequence[States]:
    """Of bodies that something moves in time: the time."""
    return [
        [(time,) if _driven(scene, body) else None for time in scene.analysis.frame_values]
        for body in scene.bodies
    ]


def _shapes(scene: Scene, scaled: bool) -> Sequence[States]:
    """Modes: number and phase (turns), or of frames in time all of them and the time (s); number 0
    where a body that is loaded doesn't vibrate."""
    table = scene.analysis
    assert isinstance(table, OscillationTable)
    rest = (0.0, 0.0) if getattr(table, "prestress", False) else None
    states = [rest] * (table.word != "time") + [*table.oscillations]
    return [states for _ in scene.bodies]


def _steady(scene: Scene, scaled: bool) -> Sequence[States]:
    """The same of bodies that something drives."""
    moving = zip(scene.bodies, _shapes(scene, scaled), strict=True)
    still = [None] * len(scene.analysis.frame_values)
    return [states if _driven(scene, body) else still for body, states in moving]


def _driven(scene: Scene, body: Body) -> bool:
    return bool(body.loads) or scene.analysis.moves_ground


_STAGES, _VIBRATIONS = "gpusim.plan.motion_stages:", "gpusim.plan.vibration_stages:"
ANALYSES = {
    "static": AnalysisKind(TABLES["static"], _weights, f"{_STAGES}static_stages"),
    "field": AnalysisKind(
        TABLES["field"], _times, f"{_STAGES}field_stages", unsolved="displacements are given"
    ),
    "modal": AnalysisKind(TABLES["modal"], _shapes, f"{_VIBRATIONS}oscillation_stages"),
    "transient": AnalysisKind(TABLES["transient"], _instants, f"{_VIBRATIONS}transient_stages"),
    "harmonic": AnalysisKind(TABLES["harmonic"], _steady, f"{_VIBRATIONS}oscillation_stages"),
    "buckling": AnalysisKind(TABLES["buckling"], _shapes, f"{_VIBRATIONS}oscillation_stages"),
}
"""By the name that ``[analysis] type`` has."""
