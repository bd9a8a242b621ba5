"""Large strains and turns, given as a field, measured without a hint."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gpusim as gs
from gpusim.pipeline.measurements.dic import FullFieldResult
from gpusim.pipeline.measurements.results import rms

MIDDLE = np.array([30.0, 15.0, 0.5])


def measured(
    folder: Path, gradients: list[np.ndarray], resolution: tuple[int, int], **measure: Any
) -> tuple[gs.Report, FullFieldResult]:
    """A sheet of 60 x 30 mm, 4 px/mm, with an even displacement gradient in each frame."""
    sheet = gs.mesh.box(size=(60.0, 30.0, 1.0), divisions=(6, 3, 1))
    cells = {f"cells_{kind}": nodes for kind, _, nodes in sheet.blocks()}
    motion = np.array([(sheet.points - MIDDLE) @ one.T for one in gradients])
    times = np.arange(float(len(gradients)))
    np.savez(folder / "motion.npz", points=sheet.points, displacement=motion, times=times, **cells)
    wide, high = resolution
    speckle = {"name": "speckle", "type": "speckle", "where": {"normal": "+z"}, "albedo": 0.8,
               "diameter_mm": 1.2, "softness_mm": 0.15, "spread": 0.3}  # fmt: skip
    document = {
        "schema": 1, "name": "sheet",
        "body": [{"name": "sheet", "field": {"file": "motion.npz", "unit": "mm"},
                  "paint": [speckle]}],
        "camera": [{"name": "top", "sensor_mm": [0.02 * wide, 0.02 * high],
                    "resolution_px": [wide, high], "focal_mm": 20.0, "up": [0.0, 1.0, 0.0],
                    "position_mm": [30.0, 15.0, 251.0], "target_mm": [30.0, 15.0, 1.0]}],
        "analysis": {"type": "field", "times": times.tolist()},
        "sensor": {"bits": 12, "exposure": "auto"}, "output": {},
        "measure": [{"name": "field", "type": "dic", "camera": "top", "subset_px": 31,
                     "step_px": 10, **measure}],
    }  # fmt: skip
    report = gs.run(gs.Scene.from_document(document, folder=folder), folder / "out")
    return report, FullFieldResult.read(folder / "out" / "measure", "field")


def test_tension_by_45_percent_is_followed(tmp_path: Path) -> None:
    stretches = [np.diag([e, -0.3 * e, 0.0]) for e in np.linspace(0.0, 0.45, 6)]
    inside = [[3.0, 3.0, 1.0], [57.0, 3.0, 1.0], [57.0, 27.0, 1.0], [3.0, 27.0, 1.0]]
    report, result = measured(
        tmp_path, stretches, (380, 140), reference="updated", roi={"polygon_mm": inside}
    )
    assert result.ok.all(), (report.warnings, [result.reasons(k) for k in range(5)])
    assert result.ok.size > 5 * 150
    for name, k in (("exx", 0), ("eyy", 1)):
        found = result.table[f"measured_{name}"].mean(axis=1)
        exact = [one[k, k] + 0.5 * one[k, k] ** 2 for one in stretches[1:]]
        assert np.abs(found - exact).max() <= 2e-4, name
    series = {one.name for one in report.series}
    assert series >= {"field: RMS error", "field: mean exx"}
    assert len((tmp_path / "out/measure/field.csv").read_text().splitlines()) == 1 + result.ok.size


@pytest.mark.parametrize("degrees", [170.0])
def test_a_turn_needs_no_hint(tmp_path: Path, degrees: float) -> None:
    angle = np.radians(degrees)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0],
                     [0.0, 0.0, 1.0]])  # fmt: skip
    _, result = measured(tmp_path, [np.zeros((3, 3)), turn - np.eye(3)], (290, 290))
    assert result.ok.mean() > 0.98
    assert np.nanmax(result.table["true_u_px"]) > 200.0
    assert rms(result.rest_px) <= 5e-3
    assert np.nanmean(np.abs(result.table["measured_exy"])) < 3e-4
