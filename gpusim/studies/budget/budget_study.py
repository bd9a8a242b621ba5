"""A budget as a study: its samples are the scene as it is, each source's draws, and those of all
sources together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from gpusim._version import __version__
from gpusim.arrays.array_types import Float
from gpusim.files.atomic_files import write_text
from gpusim.files.output_folder import inside
from gpusim.graph.stage import digest
from gpusim.optics.calibration.formats import calibration_text
from gpusim.pipeline.scene_objects.cameras import build_camera
from gpusim.scene import Scene
from gpusim.scene.effects import EFFECTS, without_effects
from gpusim.studies.budget.draws import Overrides, SourceValues, draw, together
from gpusim.studies.budget.identifiability import remarks
from gpusim.studies.budget.page import write_budget
from gpusim.studies.budget.sources import JOINT, sources_of
from gpusim.studies.budget.uncertainty import SourceDraws, UncertaintyBudget
from gpusim.studies.budget_tables import BudgetTable
from gpusim.studies.samples import Sample
from gpusim.studies.study_tables import Study
from gpusim.studies.table import SampleTable
from gpusim.validation import require

_STEPS = {"bits", "black_level_DN"}  # keys of a sensor that make steps of grey, or move them
_SENSOR = {"noise": EFFECTS["noise"].changes["sensor"].keys() - _STEPS, "quantisation": _STEPS}
"""Effects that aren't there while other sources are drawn, and what changes them."""
_LEAST = 3  # draws of which there is a standard deviation to speak of
RIG = "budget/rig.yml"  # the cameras as pairs measure with them
# units of what counts or judges, and what names have that tell how well something is measured
_NO_QUANTITIES = "1", "px^2"
_QUALITY = ("RMS", "bias", "deviation", "noise", "resolution", "error", "motion of a static")


def budget_samples(study: Study) -> Sequence[Sample]:
    """The samples of a study's budget. Raises InputError for a source that the scene hasn't got."""
    tables, base = _tables(study), study.scene
    where, got = f"budget: scene {base.name!r}", f"{len(base.measures)} measures"
    require(bool(base.measures), where, got, "a [[measure]]")
    drawn = draw(base, sources_of(base, tables), tables)
    whole = {key: value for one in drawn for key, value in one.nominal.items()}
    head = digest([__version__, study.backend, base.digest(), tables.calibration])
    effects, samples = {one.name: _of_sensor(one) for one in drawn}, list[Sample]()
    alone = [(one.name, one.overrides) for one in drawn]
    for name, changes in [("", [{}]), *alone, (JOINT, together(drawn))]:
        # other sources are drawn without noise and steps of grey: what they do would move the
        # pattern over these, which would count with each of them
        kept = effects if name == JOINT else {name: effects.get(name, set())}
        common = _with_sensors(base, whole, set[str]().union(*kept.values()))
        for number, change in enumerate(changes):
            overrides = common | change
            key = digest([head, name, number, overrides])
            samples.append(Sample(len(samples), 0, {"source": name}, overrides, key))
    return samples


def _of_sensor(source: SourceValues) -> set[str]:
    """Which of noise and steps of grey a source changes."""
    keys = {*source.nominal, *source.overrides[0]}
    return {name for name in _SENSOR
            if name == source.name or any(_changes(key, name) for key in keys)}  # fmt: skip


def _changes(key: str, effect: str) -> bool:
    """Whether a key of the scene is one of a sensor that an effect is made of."""
    path = key.split(".")
    return "sensor" in path[:-1] and path[-1] in _SENSOR[effect]


def _with_sensors(scene: Scene, nominal: Overrides, kept: set[str]) -> Overrides:
    """What sources change, where none is drawn, and sensors with noise and steps of grey as far as
    these are ``kept``; noise hides the steps, so they stay with it."""
    off = [] if "noise" in kept else [*_SENSOR.keys() - kept]
    document = without_effects(scene.document, off)
    own = {f"camera.{one['name']}.sensor": one["sensor"] for one in document["camera"]
           if one.get("sensor") is not None}  # fmt: skip
    there = {key: value for key, value in nominal.items()
             if not ("noise" in off and _changes(key, "noise"))}  # fmt: skip
    return {"sensor": document["sensor"]} | own | there


def with_rig(study: Study, out: Path) -> Study:
    """The study of a scene whose pairs measure by the cameras that it describes, whatever becomes
    of these; writes their file into ``out``."""
    scene = study.scene
    if study.tables.budget is None or study.tables.budget.calibration == "scene":
        return study
    pairs = [one for one in scene.measures if hasattr(one, "calibration") and len(one.views) == 2]
    if not pairs:
        return study
    path = inside(out, RIG)
    cameras = [build_camera(one, scene.input) for one in scene.cameras]
    write_text(path, calibration_text(cameras, "opencv", "mm", str(path)))
    for spec in pairs:
        if getattr(spec, "calibration", None) in (None, "true"):
            scene = scene.replace(f"measure.{spec.name}.calibration", str(path))
    return replace(study, scene=scene)


def uncertainty_budget(study: Study, table: SampleTable) -> UncertaintyBudget:
    """The uncertainty by what became of `budget_samples`. Raises InputError where nothing was
    measured that has a true value."""
    tables, scene = _tables(study), study.scene
    quantities = _counted(table)
    got = next((one for one in table["error"] if one), "no number with a true value")
    require(bool(quantities), f"budget: scene {scene.name!r}", got, "measured numbers")
    errors = np.column_stack([table.of(one) for one in quantities])

    def of(source: str) -> Float:
        return np.asarray(errors[table["source"] == source])

    known = [
        SourceDraws(one.name, one.parameters, one.values, of(one.name), one.degrees_of_freedom)
        for one in draw(scene, sources_of(scene, tables), tables)
    ]
    gone = list[str]()
    measured = np.ones(len(quantities), dtype=bool)
    for name in [*(one.name for one in known), JOINT]:
        lost = np.count_nonzero(np.isnan(of(name)), axis=0)
        measured &= lost <= tables.draws - _LEAST
        for count in sorted({*lost[lost > 0].tolist()}):
            what = "; ".join(quantities[q][0] for q in np.flatnonzero(lost == count))
            gone.append(f"{count} of {tables.draws} draws of {name} don't count, with no {what}.")
    expected = f"at least {_LEAST} draws of each source with a number"
    require(bool(measured.any()), f"budget: scene {scene.name!r}", " ".join(gone), expected)
    return UncertaintyBudget(
        tuple(one for one, kept in zip(quantities, measured, strict=True) if kept),
        of("")[0, measured],
        tuple(replace(one, errors=one.errors[:, measured]) for one in known),
        of(JOINT)[:, measured],
        coverage=tables.coverage,
        remarks=(*_known_by_files(scene), *remarks(scene), *gone),
    )


def _known_by_files(scene: Scene) -> list[str]:
    """Of cameras whose lens and pose sources don't know, in sentences."""
    return [
        f"Camera {one.name!r} is described by a file: that its lens and pose aren't known exactly "
        "doesn't count." for one in scene.cameras if one.calibration
    ]  # fmt: skip


def report_budget(study: Study, table: SampleTable, out: Path) -> None:
    """Write the page of a budget into ``out``. Raises as `uncertainty_budget`."""
    write_budget(study.scene.name, uncertainty_budget(study, table), out)


def _tables(study: Study) -> BudgetTable:
    assert study.tables.budget is not None
    return study.tables.budget


def _counted(table: SampleTable) -> tuple[tuple[str, str], ...]:
    """Quantities that are measured, not how well, in the first sample."""
    return tuple(
        one for one in table.quantities
        if one[1] not in _NO_QUANTITIES and not any(word in one[0] for word in _QUALITY)
        and np.isfinite(table.of(one)[0])
    )  # fmt: skip
