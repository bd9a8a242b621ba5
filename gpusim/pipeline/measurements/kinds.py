"""What a kind of measurement has to provide, and the kinds that there are, by their ``type``.

A kind is its table (`gpusim.scene.description.measure_table.MeasureTable`) and what measures by it:
one module, which ends with `register`. Scene files, plans, runs, reports and error budgets then
know it; none of them knows a kind by name. What they ask:

- of the table, before any work: ``references`` and ``faults`` (what it names, what is wrong there),
  ``pictures(frames)`` (camera and frame of every picture that it looks at), ``uses_calibration``
  (whether it needs the board's corners), ``compares_variants``, ``least_frames``, ``seconds``;
- of the `Kind`: to check, to measure, to compare, and to read again what was kept;
- of the `Result`: its warnings, files, and what it says in the report.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from gpusim.errors import GpusimError
from gpusim.pipeline.measurements.results import Result
from gpusim.pipeline.measurements.sources import Sources
from gpusim.pipeline.scene_objects.moving_bodies import SceneObjects
from gpusim.pipeline.scene_objects.surfaces import BodyParts
from gpusim.scene import Scene
from gpusim.scene.description.model import MeasureTable
from gpusim.scene.measure_kinds import add_kind
from gpusim.surface import Surface


@dataclass(frozen=True)
class Unloaded:
    """A scene's things before any picture: ``bodies``, every surface; ``blind``: camera -> why it
    sees nothing. ``strict``: the first picture shows just this, so that what can't be measured here
    is an error."""

    bodies: Sequence[BodyParts]
    surfaces: Sequence[Surface]
    blind: Mapping[str, str]
    strict: bool


@dataclass(frozen=True)
class Kind:
    """A kind of measurement. A ``spec`` is a table of its class, from a scene.

    ``measure(spec, scene, objects, sources)``: does it; it sees the pictures and corners of
    ``sources``, and takes from ``objects`` the truth alone. ``result``: the class of what that
    returns, which reads it again. ``checks(spec, scene, unloaded)``: warnings before any picture;
    raises InputError for what can't be measured. ``compare(spec, scene, read)``: of a kind that
    compares variants, instead of ``measure``; ``read(variant, measure)`` gives the result of
    another measure in one of them.
    """

    table: type[MeasureTable]
    result: type[Result]
    measure: Callable[[Any, Scene, SceneObjects, Sources], Result] | None = None
    checks: Callable[[Any, Scene, Unloaded], list[str]] = lambda *_: []
    compare: Callable[[Any, Scene, Callable[[str, str], Result]], Result] | None = None


_kinds: dict[str, Kind] = {}


def register(kind: Kind) -> None:
    """Let scenes have it. Raises InputError for a ``type`` that another kind has."""
    add_kind(kind.table)
    _kinds[kind.table.kind()] = kind


def kind_of(spec: MeasureTable) -> Kind:
    """The kind of one of a scene's measures; gpusim's own are imported when they are asked for."""
    if spec.type not in _kinds:
        import_module(f"gpusim.pipeline.measurements.{spec.package or spec.type}")
    return _kinds[spec.type]


def measured(spec: MeasureTable, scene: Scene, objects: SceneObjects, sources: Sources) -> Result:
    """Do one measurement."""
    measure = kind_of(spec).measure
    if measure is None:
        raise GpusimError(f"measure {spec.name!r}: compares variants; the scene has none")
    return measure(spec, scene, objects, sources)
