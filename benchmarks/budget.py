"""Uncertainty budgets: sums of squares beside draws of all sources together, and whether 95 %
intervals hold the truth: ``python -m benchmarks.budget crane plate coverage``.

``crane``: the beam of the paper's crane (Zdziebko & Holak, Sensors 2021, 21(18), 6046), seen alone
and with noise, all sources that it has. ``plate``: an extensometer on a plate that moves before a
calibrated pair. ``coverage``: a budget of noise and of a scale that is known to 0.5 % is drawn,
then the plate is measured ``--runs`` times by other draws of both; each result, less the budget's
mean error, has its expanded uncertainty around it; how often that holds the truth is counted.
"""

from __future__ import annotations

import argparse
import copy
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from gpusim.scene import Scene, load_scene
from gpusim.studies import SampleTable, Study
from gpusim.studies.budget import UncertaintyBudget
from gpusim.studies.budget.budget_study import uncertainty_budget
from gpusim.studies.budget_tables import BudgetTable
from gpusim.studies.study import study
from gpusim.studies.study_tables import StudyTable
from tests.support.shifted_plate import DOCUMENT

NOISE = {"bits": 8, "exposure": "auto", "full_well_e": 10_000.0, "read_noise_e": 8.0}
CRANE = {
    "camera.front.resolution_px": [1680, 200], "camera.front.sensor_mm": [36.0, 30.0 / 7.0],
    "camera.front.focal_mm": 58.0, "camera.front.position_mm": [315.0, -1020.0, 560.0],
    "camera.front.target_mm": [315.0, -20.0, 560.0], "measure.deflection.groups": ["beam"],
    "measure.deflection.static": [], "prop": [], "body.crane.mesh.element_mm": 6.0,
    "light": [], "output": {}, "sensor": NOISE,
}  # fmt: skip
PAIR = {"name": "gauge", "type": "extensometer", "cameras": ["left", "right"], "subset_px": 31,
        "calibration": "true", "ends_mm": [[-25.0, 0.0, 0.0], [25.0, 0.0, 0.0]]}  # fmt: skip
ONE = {"name": "spot", "type": "point", "camera": "left", "mm_per_px": 2.0 / 3.0, "subset_px": 21,
       "points_mm": [[-20.0, 0.0, 0.0]]}  # fmt: skip
CALIBRATION = ["noise", "focal length", "principal point", "position", "orientation"]
SCALE = {"name": "scale", "keys": ["measure.spot.mm_per_px"], "percent": 0.5}


def plate(measure: dict[str, Any], shift: list[float], **changes: Any) -> Scene:
    """The plate of the tests with a measure."""
    document = copy.deepcopy(DOCUMENT)
    document["prop"][0]["poses"] = [{"position_mm": one} for one in ([0.0, 0.0, 0.0], shift)]
    document["camera"] = document["camera"][: len(measure.get("cameras", [0]))]
    overrides = {"sensor": NOISE, **changes}
    return Scene.from_document({**document, "measure": [measure]}, overrides=overrides)


def measured(scene: Scene, workers: int, backend: str, **tables: Any) -> tuple[Study, SampleTable]:
    """The samples of a scene's budget."""
    own = StudyTable(scene=scene.source, budget=BudgetTable.model_validate(tables))
    made = Study(own, scene, Path(), "budget", backend)
    with TemporaryDirectory() as folder:
        return made, study(made, folder, workers=workers)


def print_budget(title: str, budget: UncertaintyBudget) -> None:
    """A row for each quantity."""
    print(f"\n{title}\n\n| quantity | RSS | all together | ratio | k | largest source | share |")
    print("|---|---|---|---|---|---|---|")
    for q, (name, unit) in enumerate(budget.quantities):
        first = int(np.argmax(budget.uncertainties[:, q]))
        print(
            f"| {name}, {unit} | {budget.combined[q]:.4g} | {budget.joint_uncertainty[q]:.4g} "
            f"| {budget.joint_uncertainty[q] / budget.combined[q]:.3f} "
            f"+- {budget.ratio_uncertainty[q]:.3f} | {budget.factor[q]:.3f} "
            f"| {budget.sources[first].name} | {100 * budget.shares[first, q]:.0f} % |"
        )
    for text in budget.remarks:
        print(f"\n{text}")


def print_coverage(draws: int, runs: int, workers: int) -> None:
    """How often intervals hold the truth, of other draws than those of the budget."""
    small = {"camera.left.resolution_px": [96, 72], "camera.left.focal_mm": 27.5}
    scene = plate(ONE, [0.3, 0.2, 0.0], **small)
    tables = {"sources": ["noise"], "source": [SCALE]}
    made, table = measured(scene, workers, "numpy", draws=draws, **tables)
    budget = uncertainty_budget(made, table)
    print_budget(f"One camera, {draws} draws of each source", budget)
    other = scene.replace("sensor.seed", 1_000_000)
    both = [{"name": "both", "keys": ["sensor.seed"], "seeds": True}, SCALE | {"name": "both"}]
    _, table = measured(other, workers, "numpy", draws=runs, seed=1, sources=[], source=both)
    print(f"\nCoverage of {runs} runs\n\n| quantity | held by 95 % | by the joint interval |")
    print("|---|---|---|")
    for q, quantity in enumerate(budget.quantities):
        error = table.of(quantity)[table["source"] == "all together"]
        held = np.abs(error - budget.bias[q]) <= budget.expanded[q]
        low, high = budget.interval[:, q]
        drawn = (error >= low) & (error <= high)
        print(f"| {quantity[0]} | {100 * held.mean():.1f} % | {100 * drawn.mean():.1f} % |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="*", default=["crane", "plate", "coverage"])
    parser.add_argument("--draws", type=int, default=32, help="of each source")
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--workers", type=int, default=1)
    given = parser.parse_args()
    start, workers = time.process_time(), given.workers
    if "crane" in given.parts:
        scene = load_scene(Path(__file__).parent.parent / "examples" / "crane.toml", CRANE)
        made, table = measured(scene, workers, "gpu", draws=given.draws)
        print_budget(f"Crane, {given.draws} draws of each source", uncertainty_budget(made, table))
    if "plate" in given.parts:
        scene = plate(PAIR, [0.3, 0.2, 0.5])
        made, table = measured(scene, workers, "gpu", draws=given.draws, sources=CALIBRATION)
        title = f"Stereo plate, {given.draws} draws of each source"
        print_budget(title, uncertainty_budget(made, table))
    if "coverage" in given.parts:
        print_coverage(8 * given.draws, given.runs, workers)
    print(f"\n{time.process_time() - start:.0f} s of a processor, without workers")


if __name__ == "__main__":
    main()
