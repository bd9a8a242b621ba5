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
from gpusim.scene.description.analysis import ANALYSIS_TYPES, AnalysisType
from gpusim.scene.faults import schema_places

if TYPE_CHECKING:
    from gpusim.scene.scene import Scene

States = Sequence[tuple[float, ...] | None]


@dataclass(frozen=True)
class AnalysisKind:
    """One kind.

    type : what its table is.
    states : of a scene (whether multiples of a load are one case: its second argument), per body
        what its motion depends on in each frame, as plain data; None where it is at rest.
    stages : "module:function" that gives the stages which end in ``motion/<body>``, a
        `gpusim.motion.Motion` each.
    unsolved : why nothing is solved; "" where a model of each body is.
    """

    type: AnalysisType
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
    ANALYSES[name], ANALYSIS_TYPES[name] = kind, kind.type
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
    return [[(time,) for time in scene.analysis.load_factors] for _ in scene.bodies]


ANALYSES = {
    "static": AnalysisKind(
        ANALYSIS_TYPES["static"], _weights, "gpusim.plan.motion_stages:static_stages"
    ),
    "field": AnalysisKind(
        ANALYSIS_TYPES["field"], _times, "gpusim.plan.motion_stages:field_stages",
        unsolved="displacements are given",
    ),
}  # fmt: skip
"""By the name that ``[analysis] type`` has."""
