"""Markers in space from two cameras, calibrated by the run's own chessboard images."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import SceneError
from gpusim.pipeline import run
from gpusim.pipeline.measurements.marker_tracking import FirstPicture
from gpusim.pipeline.measurements.stereo import StereoResult
from tests.support.documented_tables import documented_columns, head
from tests.support.report_figures import figures_drawn

LENS = {"sensor_mm": [36.0, 24.0], "resolution_px": [1050, 700], "focal_mm": 50.0}
TILTS = ([20, 5, -25], [-25, -10, 15], [15, 12, 28], [-18, 0, -20], [28, -8, 5], [-10, 15, 30])
CHANGES: dict[str, Any] = {
    "camera": [
        {"name": "left", **LENS, "position_mm": [20.0, -470.0, 40.0],
         "target_mm": [120.0, 0.0, 5.0]},
        {"name": "right", **LENS, "focal_mm": 52.0, "position_mm": [230.0, -480.0, 30.0],
         "target_mm": [120.0, 0.0, 5.0]},
    ],
    "body.bar.load.push.force_N": [0.0, 25.0, -40.0],
    "analysis.load_factors": [0.0, -0.6, 1.0],
    "calibration": {
        "board": "board",
        "pose": [
            {"position_mm": [110.0 + 12 * k, -20.0 + 15 * (k % 3), 20.0 - 9 * k],
             "rotation_deg": [float(angle) for angle in tilt]}
            for k, tilt in enumerate(TILTS)
        ],
    },
    "measure": [
        {"name": "space", "type": "stereo", "cameras": ["left", "right"], "groups": ["side"],
         "static": ["static"], "lens": "pinhole"}
    ],
}  # fmt: skip
BOARD = {
    "name": "board", "center_mm": [120.0, 0.0, 5.0], "normal": [0.0, -1.0, 0.0],
    "size_mm": [170.0, 155.0],
    "paint": [{"name": "fields", "type": "checker", "albedo": 0.9, "cell_mm": 15.0, "columns": 9,
               "rows": 8, "origin_mm": [52.5, 0.0, -55.0]}],
}  # fmt: skip


def scene_of(checkout: Path, **more: Any) -> gs.Scene:
    path = checkout / "examples" / "cantilever.toml"
    props = gs.load_scene(path).document["prop"]
    return gs.load_scene(path, {**CHANGES, "prop": [*props, BOARD], **more})


@pytest.fixture(scope="module")
def done(
    checkout: Path, tmp_path_factory: pytest.TempPathFactory
) -> tuple[gs.Scene, gs.Report, Path]:
    scene, out = scene_of(checkout), tmp_path_factory.mktemp("stereo") / "out"
    with figures_drawn():
        return scene, run(scene, out), out


def test_displacement_in_space(done: tuple[gs.Scene, gs.Report, Path]) -> None:
    scene, report, out = done
    total = report.measurements[0]
    assert total.name == "space: side-08, total" and total.truth > 1.0
    assert abs(total.error_relative) <= 1e-3 and total.verdict == "good"
    result = StereoResult.read(out / "measure", "space")
    assert set(result.status) == {"OK"}
    error = result.measured_mm - result.true_mm
    assert np.abs(error).max() <= 0.004  # mm; 0.3 mm/px. measured: 0.001
    # where the unloaded markers are, in the structure's own axes
    assert np.abs(result.found_mm - result.position_mm).max() <= 0.02
    assert result.table["epipolar_px"].max() <= 0.05
    assert (result.rig_motion_mm <= 0.002).all()  # static markers
    sigma = result.table.vectors("sigma")
    assert sigma.shape == (2, 8, 3) and (sigma > 0).all() and sigma.max() <= 0.02
    # the frame before is measured as well, and linear statics gives its truth
    half, whole = result.table.vectors("true")
    assert half == pytest.approx(-0.6 * whole, rel=1e-9, abs=1e-12)
    assert np.abs(result.table.vectors("measured")[0] - half).max() <= 0.004
    assert result.moved_px.shape == (2, 2, 8, 2)
    assert {one.figure for one in report.series} == {"space: side, total displacement"}
    assert [one.x.tolist() for one in report.series] == 8 * [[-0.6, 1.0]]
    assert len(result.boards_mm) == len(TILTS) == result.view_rms_px.shape[1]
    assert scene.measures[0].name == "space"


def test_calibration_is_that_of_the_cameras(done: tuple[gs.Scene, gs.Report, Path]) -> None:
    _, report, _ = done
    row = {m.name.removeprefix("space: "): m for m in report.measurements}
    assert row["calibration, reprojection error"].measured <= 0.005
    for name in ("left, fx", "right, fx", "right, baseline"):
        assert abs(row[name].error_relative) <= 2e-4
    for name in ("left, cx", "left, cy", "right, cx", "right, cy"):
        assert abs(row[name].error) <= 0.2
    assert abs(row["right, angle"].error) <= 0.005


def test_files_and_rerun(done: tuple[gs.Scene, gs.Report, Path], checkout: Path) -> None:
    scene, first, out = done
    for name in ("measure/space.csv", "measure/space-cameras.csv", "figures/space-rig.png",
                 "figures/space-space.png", "figures/space-calibration.png",
                 "images/left/calib-0005.png"):  # fmt: skip
        assert (out / name).stat().st_size > 0
    for ending, frame in (("", "frame,"), ("-cameras", "")):
        documented = documented_columns(checkout, f"measure/<stereo>{ending}.csv")
        assert head(out / f"measure/space{ending}.csv") == frame + documented
    # exposed for the first pose, others are brighter
    warnings = json.loads((out / "report.json").read_text())["warnings"]
    assert [w for w in warnings if "% of its pixels saturated" not in w] == []
    assert [w.split("calib-")[0] for w in warnings] == ["image ", "image "]
    again = run(scene, out)
    assert [s.name for s in again.stages if s.state == "run"] == []
    assert again.measurements == first.measurements


@pytest.mark.slow
def test_a_new_lens_leaves_the_other_camera_alone(
    done: tuple[gs.Scene, gs.Report, Path], checkout: Path, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    _, _, earlier = done
    out = tmp_path / "out"
    shutil.copytree(earlier, out)
    followed = []

    find = FirstPicture.of

    def followed_from(what: str, marks: Any, camera: Any, *rest: Any) -> Any:
        followed.append(camera.name)
        return find(what, marks, camera, *rest)

    monkeypatch.setattr(FirstPicture, "of", followed_from)
    left, right = CHANGES["camera"]
    scene = scene_of(checkout, camera=[{**left, "focal_mm": 48.0}, right])
    report = run(scene, out)
    assert followed == ["left"]
    own = [stage for stage in report.stages if stage.name.startswith("render/right")]
    assert len(own) == 3 + len(TILTS) and {stage.state for stage in own} == {"reused"}
    assert abs(report.measurements[0].error_relative) <= 1e-3
    before, after = (StereoResult.read(folder / "measure", "space") for folder in (earlier, out))
    assert np.array_equal(before.points_px[1], after.points_px[1])
    assert np.array_equal(before.moved_px[:, 1], after.moved_px[:, 1])
    assert np.abs(before.points_px[0] - after.points_px[0]).max() > 1.0
    run(scene, out, fresh=True)
    assert followed == ["left", "left", "right"]


def test_a_scene_without_a_target_is_refused(checkout: Path) -> None:
    path = checkout / "examples" / "cantilever.toml"
    changes = {k: v for k, v in CHANGES.items() if k != "calibration"}
    with pytest.raises(SceneError, match=r"measure\.[a-z]+: needs images of a target"):
        gs.load_scene(path, changes)
    wrong = [{**CHANGES["measure"][0], "cameras": ["left", "middle"]}]
    with pytest.raises(SceneError, match="no such camera"):
        scene_of(checkout, measure=wrong)


def test_example_is_valid(checkout: Path) -> None:
    scene = gs.load_scene(checkout / "examples" / "crane_stereo.toml")
    assert scene.calibration is not None and len(scene.calibration.poses) == 21
    assert [camera.focal for camera in scene.cameras] == [0.03, 0.032]


@pytest.mark.slow
def test_a_charuco_board_calibrates_as_well(checkout: Path, tmp_path: Path) -> None:
    paint = {
        "name": "fields",
        "type": "charuco",
        "albedo": 0.9,
        "square_mm": 18.0,
        "marker_mm": 11.0,
        "columns": 8,
        "rows": 7,
        "origin_mm": [48.0, 0.0, -58.0],
    }
    path = checkout / "examples" / "cantilever.toml"
    props = gs.load_scene(path).document["prop"]
    board = {**BOARD, "paint": [paint]}
    report = run(scene_of(checkout, prop=[*props, board]), tmp_path / "out")
    row = {m.name.removeprefix("space: "): m for m in report.measurements}
    assert abs(row["side-08, total"].error_relative) <= 1e-3
    assert row["calibration, reprojection error"].measured <= 0.01
    for name in ("left, fx", "right, fx", "right, baseline"):
        assert abs(row[name].error_relative) <= 5e-4
