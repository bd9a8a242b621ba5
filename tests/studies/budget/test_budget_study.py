"""Budgets of whole measurements: intervals hold the truth as often as they say."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import norm, qmc

from gpusim import measure
from gpusim.arrays.array_types import Float
from gpusim.errors import InputError
from gpusim.measure.calibration.calibration import CalibratedCamera
from gpusim.optics.camera.pinhole import Camera
from gpusim.pipeline.measurements.dic.rig import Rig, rig_of
from gpusim.scene import Scene
from gpusim.studies import Study
from gpusim.studies.budget import SourceDraws, UncertaintyBudget
from gpusim.studies.budget.budget_study import budget_samples, uncertainty_budget
from gpusim.studies.budget_tables import BudgetTable
from gpusim.studies.study import study
from gpusim.studies.study_tables import StudyTable
from gpusim.studies.table import SampleTable, column_name
from tests.support.shifted_plate import shifted_plate

SIZES = {"noise": np.full(8, 0.004), "lens": np.array([0.2, 0.3, 0.3] * 2),
         "pose": np.array([0.03, 0.03, 0.03, 1e-4, 1e-4, 1e-4])}  # fmt: skip
"""Standard uncertainties: px; px of focal length and principal point; mm and rad."""


def cameras() -> list[Camera]:
    lens = ((24.0, 16.0), 30.0, (600, 400))
    return [
        Camera.from_lens(*lens, (x, 0.0, 0.5), (0.0, 0.0, 0.0), up=(0.0, 1.0, 0.0), name=name)
        for name, x in (("left", -0.1), ("right", 0.1))
    ]


def wrong(rig: Rig, lens: Float, pose: Float) -> Rig:
    """The pair as it is calibrated if all of that is off."""
    found: list[CalibratedCamera] = []
    for camera, own in zip(rig, lens.reshape(2, 3), strict=True):
        K = camera.K.copy()
        K[[0, 1, 0, 1], [0, 1, 2, 2]] += own[[0, 0, 1, 2]]
        found.append(replace(camera, K=K))
    off = np.eye(4)
    off[:3, 3], off[:3, :3] = pose[:3], Rotation.from_rotvec(pose[3:]).as_matrix()
    pair = replace(found[1], camera_from_rig=off @ found[1].camera_from_rig)
    return found[0], pair


def errors(values: dict[str, Float]) -> Float:
    """Of a displacement (N, 3) mm that a pair measures of one point."""
    pair, place, moved = cameras(), np.array([0.02, 0.01, 0.0]), np.array([1e-2, 6e-3, 1.5e-2])
    pixels = np.array([[one.project(p[None]) for p in (place, place + moved)] for one in pair])
    true = (rig_of(pair)[0].camera_from_rig[:3, :3]
            @ pair[0].camera_from_world[:3, :3] @ (1e3 * moved))  # fmt: skip
    result = []
    for noise, lens, pose in zip(*values.values(), strict=True):
        seen = pixels + noise.reshape(2, 2, 1, 2)
        rig = wrong(rig_of(pair), lens, pose)
        before, after = measure.triangulate(rig, seen[:, :, 0]).points
        result.append(after - before - true)
    return np.array(result)


def drawn(count: int, seed: int) -> dict[str, Float]:
    points = qmc.Sobol(sum(map(len, SIZES.values())), rng=seed).random(count)
    parts = np.split(norm.ppf(points), np.cumsum([len(one) for one in SIZES.values()])[:-1], axis=1)
    return {name: size * part for (name, size), part in zip(SIZES.items(), parts, strict=True)}


def test_intervals_of_a_pair_hold_the_truth() -> None:
    """Of 1,000 runs with other noise, lenses and poses 93.5 to 96.5 %."""
    values = drawn(256, 1)
    nothing = {name: 0.0 * one for name, one in values.items()}
    sources = tuple(
        SourceDraws(name, tuple(f"{name}.{k}" for k in range(len(SIZES[name]))), values[name],
                    errors(nothing | {name: values[name]}))
        for name in SIZES
    )  # fmt: skip
    quantities = tuple((name, "mm") for name in "XYZ")
    nominal = errors({name: one[:1] for name, one in nothing.items()})[0]
    budget = UncertaintyBudget(quantities, nominal, sources, errors(values))
    np.testing.assert_allclose(nominal, 0.0, atol=1e-9)
    np.testing.assert_allclose(budget.joint_uncertainty, budget.combined, rtol=0.05)
    assert (np.abs(budget.shares.sum(axis=0) - 1.0) < 1e-12).all()
    other = errors(drawn(1024, 2))[:1000]
    held = np.abs(other - budget.bias) <= budget.expanded
    assert (np.abs(held.mean(axis=0) - 0.95) <= 0.015).all()
    held = (other >= budget.interval[0]) & (other <= budget.interval[1])  # of 256 draws alone
    assert (np.abs(held.mean(axis=0) - 0.95) <= 0.025).all()


def plate() -> Scene:
    """A spot of the plate, square before one camera: 2 / 3 mm per pixel."""
    scene = shifted_plate(
        (0.3, 0.0, 0.0), {"camera": "left", "mm_per_px": 1.0},
        **{"camera.left.resolution_px": [96, 72], "camera.left.focal_mm": 27.5},
    )  # fmt: skip
    document = scene.document
    document["sensor"] |= {"full_well_e": 1000.0}  # noise that nobody asks for
    document["measure"] = [{"name": "spot", "type": "point", "camera": "left", "subset_px": 31,
                            "mm_per_px": 2.0 / 3.0, "points_mm": [[-20.0, 0.0, 0.0]]}]  # fmt: skip
    return Scene.from_document(document)


def test_a_budget_as_a_study(tmp_path: Path) -> None:
    """Made once, told on a page; a second call makes nothing."""
    own = {"name": "shake", "keys": ["camera.left.moved_um"], "normal": 20.0,
           "set": {"camera.left.moved_um": [0.0, 0.0, 0.0]}}  # fmt: skip
    tables = BudgetTable.model_validate({"draws": 5, "sources": ["light"], "source": [own]})
    made = Study(StudyTable(scene="-", budget=tables), plate(), tmp_path, backend="numpy")
    table = study(made, tmp_path / "out")
    assert len(table) == 1 + 3 * 5 and set(table["status"]) == {"done"}
    told = json.loads((tmp_path / "out" / "report.json").read_text())
    across = next(one for one in told["quantities"] if one["name"].endswith(", u"))
    shake = next(one for one in across["sources"] if one["name"] == "shake")
    # a camera that goes right by 20 um sees the plate, in its own plane, go left by 20 um
    assert shake["uncertainty"] == pytest.approx(0.020, rel=0.5)
    assert shake["parameters"][0]["sensitivity"] == pytest.approx(-1e-3, rel=0.1)
    assert shake["share"] > 0.9 and "mend shake first" in across["advice"]
    assert across["joint_uncertainty"] == pytest.approx(across["combined"], rel=0.05)
    assert any("isn't identifiable" in one for one in told["remarks"])
    page = tmp_path / "out" / "report.html"
    before = page.read_text()
    again = study(made, tmp_path / "out")
    np.testing.assert_array_equal(again["seconds"], table["seconds"])
    assert page.read_text() == before


def test_draws_in_which_nothing_is_measured_are_told(tmp_path: Path) -> None:
    """Half of them look past the plate; with 5 draws too few are left to speak of the spread."""
    away = {"name": "away", "keys": ["camera.left.target_mm"],
            "choices": [[-20.0, 0.0, 0.0], [400.0, 0.0, 0.0]]}  # fmt: skip
    tables = BudgetTable.model_validate({"draws": 8, "sources": [], "source": [away]})
    made = Study(StudyTable(scene="-", budget=tables), plate(), tmp_path, backend="numpy")
    table = study(made, tmp_path / "out")
    told = uncertainty_budget(made, table)
    assert any(one.startswith("4 of 8 draws of away don't count, with no") for one in told.remarks)
    few = table["sample"] < 1 + 4
    lost = SampleTable(table.columns, table.parameters, table.quantities)
    for quantity in table.quantities:
        lost.columns[column_name(quantity, "error")] = np.where(few, table.of(quantity), np.nan)
    with pytest.raises(InputError, match=r"got 6 of 8 draws of away .*; expected at least 3"):
        uncertainty_budget(made, lost)


def test_noise_is_in_what_draws_it_alone() -> None:
    """Whatever its source is called, and whichever sensor it is of."""
    document = plate().document
    document["camera"][0]["sensor"] = {"full_well_e": 2000.0, "read_noise_e": 4.0}
    sources = [
        {"name": "grain", "keys": ["sensor.seed"], "seeds": True},
        {"name": "read-out", "keys": ["camera.left.sensor.read_noise_e"], "percent": 10.0},
    ]
    tables = BudgetTable.model_validate({"draws": 5, "sources": ["light"], "source": sources})
    made = Study(StudyTable(scene="-", budget=tables), Scene.from_document(document), Path())
    noisy = dict[str, set[bool]]()
    for sample in budget_samples(made):
        sensor = sample.scene(made).sensor_of("left")
        noisy.setdefault(sample.values["source"], set()).add(sensor.full_well_e is not None)
    assert noisy == {"": {False}, "light": {False}, "grain": {True}, "read-out": {True},
                     "all together": {True}}  # fmt: skip


def test_a_scene_without_measures(tmp_path: Path) -> None:
    tables = BudgetTable.model_validate({"draws": 5, "sources": ["light"]})
    scene = plate().replace("measure", [])
    made = Study(StudyTable(scene="-", budget=tables), scene, tmp_path, backend="numpy")
    with pytest.raises(InputError, match=r"scene 'plate'; got 0 measures; expected a \[\[measure"):
        study(made, tmp_path / "out")
