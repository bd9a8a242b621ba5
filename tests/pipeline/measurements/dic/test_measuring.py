"""Digital image correlation asked for in a scene: what it finds in the scene's own pictures, beside
the truth."""

from __future__ import annotations

import copy
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy

import gpusim as gs
from gpusim.errors import InputError, SceneError
from gpusim.pipeline.checks.warnings import build_objects, geometry_warnings
from gpusim.pipeline.measurements.dic import FullFieldResult
from gpusim.pipeline.measurements.dic.statistics import scores
from gpusim.pipeline.measurements.results import rms
from gpusim.plan.plan import make_plan
from tests.support.report_figures import figures_drawn
from tests.support.shifted_plate import shifted_plate
from tests.support.speckled_plate import speckled_plate

PAIR = {"cameras": ["left", "right"], "lens": "pinhole"}
MEASURES: tuple[dict[str, Any], ...] = (
    {"camera": "right"},
    {"camera": "right", "mm_per_px": 0.25, "strain": "none"},
    {"camera": "right", "plane_pose": 0, "lens": "pinhole", "roi": {"where": {"x_max_mm": 1.0}}},
    {**PAIR, "formats": ["csv", "h5", "mat"]},
)
NOISE = {"bits": 12, "exposure": "auto", "full_well_e": 20_000.0, "read_noise_e": 20.0}
"""About 12 of 4095 levels where it is bright."""
Get = Callable[[int], FullFieldResult]


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> tuple[gs.Report, Path]:
    out = tmp_path_factory.mktemp("dic") / "out"
    with figures_drawn():
        return gs.run(speckled_plate(*MEASURES, sensor=NOISE), out), out


@pytest.fixture
def found(done: tuple[gs.Report, Path]) -> Get:
    return lambda number: FullFieldResult.read(done[1] / "measure", f"field{number}")


def errors(result: FullFieldResult, names: list[str], truth: str = "levelled") -> np.ndarray:
    return result.values("measured", names)[-1] - result.values(truth, names)[-1]


def test_one_camera_measures_in_pixels(found: Get) -> None:
    result = found(0)
    assert result.quantities == ["u_px", "v_px", "exx", "eyy", "exy"]
    assert result.ok.mean() > 0.98
    # from the finite elements: the plate gets longer by 1.5 px, and thinner
    assert 1.2 < np.ptp(result.values("true", ["u_px"])) < 1.7
    assert rms(errors(result, ["u_px", "v_px"])) < 4e-3
    assert np.abs(np.nanmean(errors(result, ["u_px", "v_px"]), axis=0)).max() < 1e-3
    raw = rms(errors(result, ["u_px", "v_px"], "true"))
    assert raw == pytest.approx(rms(result.raw_px), rel=1e-12) and raw > rms(result.rest_px)


def test_noise_is_what_the_uncertainties_say(found: Get) -> None:
    for number in (0, 3):
        assert 0.8 < np.nanmean(scores(found(number)) ** 2) < 1.2, number


def test_lengths_of_one_camera(found: Get) -> None:
    scaled, laid, pixels = found(1), found(2), found(0)
    assert scaled.axes == ("+x", "-y") and not scaled.strains
    both = scaled.ok & pixels.ok
    assert np.array_equal(
        scaled.table["measured_u_mm"][both], 0.25 * pixels.table["measured_u_px"][both]
    )
    # the target lies on the plate, which gets thinner by a few um
    assert rms(errors(laid, ["u_mm", "v_mm"])) < 1.5e-3
    assert np.abs(np.nanmean(errors(laid, laid.strains), axis=0)).max() < 2.5e-5


def test_a_pair_measures_shape_displacement_and_strain(found: Get) -> None:
    result = found(3)
    assert result.displacements == ["U_mm", "V_mm", "W_mm"]
    assert result.rest_px.shape == (1, 2, len(result.table.points), 2)
    assert rms(result.rest_px) < 4e-3
    assert np.abs(np.nanmean(result.rest_px, axis=(0, 2))).max() < 1e-3
    # the free end moves by F L / (E A) and a little more for the hole
    stretch = 50e3 * 0.12 / (70e9 * 0.06 * 0.004)
    assert 1.0 < np.nanmax(result.table["measured_U_mm"]) / (1e3 * stretch) < 1.3
    assert np.abs(np.nanmean(errors(result, ["exx", "eyy", "exy"]), axis=0)).max() < 2.5e-5
    place = result.table["measured_Z_mm"][0] - result.table["true_Z_mm"][0]
    assert rms(place) < 0.02
    assert result.table["true_Z_mm"][0] == pytest.approx(4.0, abs=1e-9)


def test_files_hold_the_maps_on_their_grid(done: tuple[gs.Report, Path], found: Get) -> None:
    result, folder = found(3), done[1] / "measure"
    rows = (folder / "field3.csv").read_text().splitlines()
    assert rows[0].split(",")[:5] == ["point", "status", "hidden", "x_px", "y_px"]
    assert len(rows) == 1 + len(result.table.points)
    stored = scipy.io.loadmat(folder / "field3.mat")
    with h5py.File(folder / "field3.h5") as file:
        assert file["measured_W_mm"].attrs["unit"] == "mm"
        maps = {name: data[...] for name, data in file.items()}
    assert {"true_exx", "levelled_U_mm", "difference_V_mm", "measured_X_mm"} <= set(maps)
    column, row = maps["column_px"], maps["row_px"]
    k = 777
    x, y = (result.table[f"{one}_px"][0, k] for one in "xy")
    at = 0, int(np.searchsorted(row, y)), int(np.searchsorted(column, x))
    assert column[at[2]] == x and row[at[1]] == y
    for name in ("true_exx", "levelled_U_mm"):
        assert maps[name][at] == result.table[name][0, k] == stored[name][at]
    assert np.isnan(maps["true_exx"]).any()  # the hole
    assert not (folder / "field0.h5").exists()


def test_the_report_says_what_was_measured(done: tuple[gs.Report, Path], found: Get) -> None:
    report, out = done
    told = {item.name: item for item in reversed(report.measurements)}
    first = next(item for item in report.measurements if item.name.startswith("field3"))
    assert first.name == "field3: largest displacement" and first.verdict == "good"
    assert told["field3: RMS error of displacements"].unit == "mm"
    assert told["field0: noise x resolution, beside the least of such subsets"].error_relative < 0.3
    resolution = told["field0: spatial resolution of displacements (10 % loss)"]
    assert resolution.measured == pytest.approx(3.99 * 21, rel=3e-3)
    numbers = json.loads((out / "report.json").read_text())
    assert sum(row["name"].startswith("field3") for row in numbers["measurements"]) > 10
    page = (out / "report.html").read_text()
    assert "field3: displacement in frame 1" in page and "field0: strain in frame 1" in page


def test_a_frame_at_rest_tells_the_noise(tmp_path: Path) -> None:
    frames = {"analysis": {"load_factors": [0.0, 0.0, 1.0]}, "sensor": NOISE}
    report = gs.run(speckled_plate({"camera": "left", "frames": [1]}, **frames), tmp_path)
    told = {item.name: item.measured for item in report.measurements}
    still = told["field0: noise floor (frames at rest)"]
    assert still == pytest.approx(told["field0: noise floor (median sigma)"], rel=0.3)
    assert still == told["field0: RMS error in the picture"] > 1e-3


@pytest.mark.drawn
def test_settings_are_chosen_from_the_picture(tmp_path: Path) -> None:
    scene = speckled_plate(
        {"camera": "left", "settings": "best", "subset_px": 31, "step_px": 10},
        sensor=NOISE, analysis={"load_factors": [0.0, 0.0, 1.0]},
    )  # fmt: skip
    report = gs.run(scene, tmp_path)
    result = FullFieldResult.read(tmp_path / "measure", "field0")
    # the same as `gpusim dic --advise` says of these pictures, which don't know the hole's outline
    pictures = [
        gs.export.read_image(tmp_path / f"images/left/{number:04d}.png") for number in (0, 1)
    ]
    x, y = (result.table[f"{axis}_px"][0] for axis in "xy")
    roi = int(x.min()), int(y.min()), int(x.max()), int(y.max())
    advice = gs.measure.advise(pictures[0], still=pictures[1], roi=roi)
    assert abs(result.subset_px / advice.settings["subset"] - 1) < 0.3
    assert result.shape == advice.settings["shape"] == "quadratic"
    assert f"subset {result.subset_px}, step {result.step_px}" in result.advice
    page = (tmp_path / "report.html").read_text()
    assert "field0: settings" in page and "Chosen for this picture" in page
    assert (tmp_path / "figures/field0-settings.png").is_file()
    assert not report.warnings


def test_noise_is_not_learnt_from_a_frame_in_which_a_prop_moved(tmp_path: Path) -> None:
    """The load factor is the same, but the plate went on by 1.5 px."""
    noise = {"bits": 8, "exposure": "auto", "full_well_e": 10_000.0, "read_noise_e": 3.0}
    best = {"camera": "left", "settings": "best", "subset_px": 31, "step_px": 10}
    chosen = []
    for number, factors in enumerate(([0.0, 0.0], [0.0, 1.0])):
        scene = shifted_plate((1.0, 0.5, 0.0), best, sensor=noise,
                              analysis={"load_factors": factors})  # fmt: skip
        gs.run(scene, tmp_path / str(number))
        chosen.append(FullFieldResult.read(tmp_path / str(number) / "measure", "field").advice)
    assert chosen[0] == chosen[1] != ""


@pytest.mark.parametrize(
    ("roi", "keys", "text"),
    [
        ([[60, 30], [80, 30], [80, 50], [60, 50]], {"camera": "left"}, "points; got 1 on one line"),
        ([[80, 30], [150, 30], [150, 46], [80, 46]],
         {"cameras": ["left", "right"], "calibration": "true", "step_px": 11, "strain": "none"},
         r"points; got \d on one line"),
    ],
)  # fmt: skip
def test_too_few_points_are_told_before_any_work(
    roi: list[list[int]], keys: dict[str, Any], text: str
) -> None:
    table = {"subset_px": 9, "step_px": 100, "roi": {"polygon_px": roi}, **keys}
    scene = shifted_plate((1.0, 0.5, 2.0), table)
    with pytest.raises(InputError, match=f"measure 'field': {text}; expected three or more"):
        geometry_warnings(build_objects(scene))


@pytest.mark.drawn
def test_one_point_is_enough_without_strains(tmp_path: Path) -> None:
    roi = {"polygon_px": [[60, 30], [80, 30], [80, 50], [60, 50]]}
    table = {"camera": "left", "subset_px": 9, "step_px": 100, "roi": roi, "strain": "none",
             "mm_per_px": 2.0 / 3.0}  # fmt: skip
    gs.run(shifted_plate((1.0, 0.5, 0.0), table), tmp_path)
    result = FullFieldResult.read(tmp_path / "measure", "field")
    assert result.ok.tolist() == [[True]]
    assert result.table["measured_u_mm"][0, 0] == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize(
    ("camera", "axes", "moved"),
    [
        ({"up": [0.0, 1.0, 0.0]}, ("+x", "-y"), (1.0, -0.5)),
        ({"up": [1.0, 0.0, 0.0]}, ("-y", "-x"), (-0.5, -1.0)),
        ({"up": [0.6, 0.8, 0.0]}, ("the picture's right", "the picture's down"), (0.5, -1.0)),
    ],
)  # fmt: skip
def test_a_scale_reads_along_the_axes_of_the_picture(
    camera: dict[str, Any], axes: tuple[str, str], moved: tuple[float, float], tmp_path: Path
) -> None:
    """A camera rolled by 37 degrees sees 1 mm along x and 0.5 mm along y as 0.5 and -1 mm."""
    table = {"camera": "left", "mm_per_px": 0.66667, "strain": "none"}
    roll = {f"camera.left.{key}": value for key, value in camera.items()}
    gs.run(shifted_plate((1.0, 0.5, 0.0), table, **roll), tmp_path)
    result = FullFieldResult.read(tmp_path / "measure", "field")
    assert result.axes == axes
    for kind in ("true", "measured"):
        values = result.values(kind, ["u_mm", "v_mm"])[0]
        assert np.nanmean(values, axis=0) == pytest.approx(moved, abs=1e-3), kind


def test_a_tilted_surface_is_read_too_short(tmp_path: Path) -> None:
    """Along axes that lie in the surface: what a camera at 20 degrees sees of 1 mm is error."""
    table = {"camera": "left", "mm_per_px": 0.66667, "strain": "none"}
    away = 200.0 * np.array([np.sin(np.radians(20.0)), np.cos(np.radians(20.0))])
    tilt = {"camera.left.position_mm": [-20.0, -away[0], away[1]]}
    gs.run(shifted_plate((0.0, 1.0, 0.0), table, **tilt), tmp_path)
    result = FullFieldResult.read(tmp_path / "measure", "field")
    assert result.axes == ("+x", "-y")
    assert result.table["true_v_mm"] == pytest.approx(-1.0, abs=1e-12)
    assert np.nanmedian(result.table["measured_v_mm"]) == pytest.approx(-0.94, abs=0.02)


def test_advice_needs_a_large_region(tmp_path: Path) -> None:
    corners = [[100.0, 100.0], [180.0, 100.0], [180.0, 180.0], [100.0, 180.0]]
    measure = {"camera": "left", "settings": "best", "roi": {"polygon_px": corners}}
    scene = speckled_plate({**measure, "subset_px": 31, "step_px": 10})
    with pytest.raises(InputError, match=r"measure 'field0': settings = \"best\": .*101"):
        gs.run(scene, tmp_path)


def test_a_blank_surface_is_told(tmp_path: Path) -> None:
    body = copy.deepcopy(speckled_plate().document["body"])
    body[0]["paint"] = [{"name": "plain", "type": "plain", "albedo": 0.5}]
    with figures_drawn():
        report = gs.run(speckled_plate({"camera": "left"}, body=body), tmp_path)
    (warning,) = report.warnings
    assert re.fullmatch(
        r"measure 'field0': (\d+) of \1 points lost in frame 1: \1 no texture", warning
    )
    assert report.measurements[0].verdict == "bad"
    frames = {"load_factors": [0.0, 0.5, 1.0]}
    report = gs.run(speckled_plate({"camera": "left"}, body=body, analysis=frames), tmp_path)
    (warning,) = report.warnings
    assert re.search(r"lost in frame \d \(more than 2 % in 2 frames\): \d+ no texture$", warning)


@pytest.mark.parametrize(
    ("measure", "text"),
    [
        ({}, "how many cameras measure; got neither"),
        ({"camera": "left", "cameras": ["left", "right"]}, "how many cameras measure; got both"),
        ({"camera": "left", "subset_px": 20}, "subset_px: even; got 20"),
        ({"camera": "left", "settings": "best"}, 'subset_px: chosen by settings = "best"; got 21'),
        ({**PAIR, "mm_per_px": 0.1}, "mm_per_px: of one camera, but cameras are given"),
        ({"camera": "left", "mm_per_px": 0.1, "plane_pose": 0}, "lengths are told twice"),
        (
            {"camera": "left", "plane_pose": 9},
            "plane_pose: no such pose; got 9; expected less than",
        ),
        ({"camera": "left", "frames": [1, 4]}, "no such frame; got 4; expected from 1 to 1"),
        ({"camera": "left", "roi": {"paint": "speckles"}}, "no such paint"),
        ({**PAIR, "strain": "small"}, "not of a surface in space"),
        ({"camera": "middle"}, "no such camera"),
    ],
)
def test_what_cannot_be_measured_is_told_before_any_work(
    measure: dict[str, Any], text: str
) -> None:
    with pytest.raises(SceneError, match=text):
        speckled_plate(measure)


def test_a_pair_needs_a_target() -> None:
    with pytest.raises(SceneError, match=r"needs images of a target; got no \[calibration\]"):
        scene = speckled_plate(PAIR).document
        gs.Scene.from_document({k: v for k, v in scene.items() if k != "calibration"})


@pytest.mark.parametrize(
    ("measure", "changes", "text"),
    [
        ({"camera": "left", "roi": {"polygon_px": [[1, 1], [9, 1], [9, 9]]}}, {},
         "roi; got no pixel of camera 'left' in frame 0"),
        ({"camera": "left"}, {"target_mm": [0.0, 0.0, 900.0]}, "camera 'left' sees no surface"),
    ],
)  # fmt: skip
def test_a_region_that_is_not_seen_is_told_before_any_work(
    measure: dict[str, Any], changes: dict[str, Any], text: str
) -> None:
    first, *rest = speckled_plate().document["camera"]
    scene = speckled_plate(measure, camera=[{**first, **changes}, *rest])
    with pytest.raises(InputError, match=text):
        geometry_warnings(build_objects(scene))


def test_plans_know_what_is_needed() -> None:
    plan = make_plan(speckled_plate({"camera": "left"}, PAIR))
    assert "measure" in {stage.name for stage in plan.stages}
