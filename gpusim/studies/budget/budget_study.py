"""A budget as a study: its samples are the scene as it is, each source's draws, and those of all
sources together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from gpusim._version import __version__
from gpusim.arrays.array_types import Float
from gpusim.errors import InputError
from gpusim.files.atomic_files import write_text
from gpusim.files.output_folder import inside
from gpusim.graph.stage import digest
from gpusim.optics.calibration.formats import calibration_text
from gpusim.pipeline.scene_objects.cameras import build_camera
from gpusim.scene import Scene
from gpusim.studies.budget.budget_tables import BudgetTable
from gpusim.studies.budget.draws import Drawn, draw, together
from gpusim.studies.budget.identifiability import remarks
from gpusim.studies.budget.sources import sources_of
from gpusim.studies.budget.uncertainty import SourceDraws, UncertaintyBudget
from gpusim.studies.samples import Sample
from gpusim.studies.study_tables import Study
from gpusim.studies.table import SampleTable

RIG = "budget/rig.yml"
"""The cameras as pairs measure with them."""
JOINT = "all together"
_NO_QUANTITIES = "1", "px^2"
"""Units of what counts, or judges, rather than measures."""


@dataclass(frozen=True, eq=False)
class BudgetStudy:
    """The ``study`` of a scene in which pairs of cameras measure by the nominal ones, the ``drawn``
    sources, and the ``samples``: nothing drawn, then source by source, then all."""

    study: Study
    tables: BudgetTable
    drawn: tuple[Drawn, ...]
    samples: tuple[Sample, ...]

    @staticmethod
    def of(study: Study, tables: BudgetTable, out: Path) -> BudgetStudy:
        """Draw the sources of a scene's budget; writes the cameras of its pairs into ``out``.
        Raises InputError for a source that the scene hasn't got, SceneError for one whose first
        draw isn't a scene."""
        base = study.scene
        if tables.calibration == "nominal":
            base = _with_rig(base, out)
        study = replace(study, scene=base)
        drawn = draw(base, sources_of(base, tables), tables)
        rows: list[tuple[str, int, dict[str, Any]]] = [("", 0, {})]
        for name, changes in [*((one.name, one.overrides) for one in drawn),
                              (JOINT, together(drawn))]:  # fmt: skip
            rows += [(name, number, change) for number, change in enumerate(changes)]
        head = digest([__version__, study.backend, base.digest()])
        samples = tuple(
            Sample(k, number, {"source": name}, change, digest([head, change]))
            for k, (name, number, change) in enumerate(rows)
        )
        for sample in samples[1 :: tables.draws]:
            sample.scene(study)
        return BudgetStudy(study, tables, tuple(drawn), samples)

    def budget(self, table: SampleTable) -> UncertaintyBudget:
        """The uncertainty by the samples' results. Raises InputError where none was measured."""
        quantities = _counted(table)
        if not quantities:
            got = next((one for one in table["error"] if one), "no measure of a true number")
            raise InputError(
                f"budget: scene {self.study.scene.name!r}; got {got}; expected a [[measure]]"
            )
        errors = np.column_stack([table.of(one) for one in quantities])

        def of(source: str) -> Float:
            return errors[table["source"] == source]

        known = [
            SourceDraws(one.name, one.parameters, one.values, of(one.name), one.degrees_of_freedom)
            for one in self.drawn
        ]
        told = remarks(self.study.scene)
        failed = int(np.sum(table["status"] != "done"))
        if failed:
            told.append(f"{failed} of {len(table)} draws couldn't be measured and don't count.")
        return UncertaintyBudget(
            quantities, of("")[0], tuple(known), of(JOINT), self.tables.coverage, tuple(told)
        )


def _counted(table: SampleTable) -> tuple[tuple[str, str], ...]:
    """Quantities with a true value that isn't zero: what is measured, not how well."""
    return tuple(
        one for one in table.quantities
        if one[1] not in _NO_QUANTITIES and table.of(one, "truth")[0] not in (0.0, None)
        and np.isfinite(table.of(one)[0])
    )  # fmt: skip


def _with_rig(scene: Scene, out: Path) -> Scene:
    """The scene with pairs that measure by the cameras which it describes, whatever becomes of
    these."""
    pairs = [
        spec for spec in scene.measures if len(spec.views) == 2 and hasattr(spec, "calibration")
    ]
    if not pairs:
        return scene
    path = inside(out, RIG)
    cameras = [build_camera(one, scene.input) for one in scene.cameras]
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, calibration_text(cameras, "opencv", "mm", str(path)))
    for spec in pairs:
        if spec.calibration in (None, "true"):
            scene = scene.replace(f"measure.{spec.name}.calibration", str(path))
    return scene
