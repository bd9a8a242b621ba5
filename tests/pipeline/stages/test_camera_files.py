"""Calibration files that a run writes: when they are made, and what is said of them."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import gpusim as gs
from gpusim.cli import app
from gpusim.errors import SceneError
from gpusim.plan.plan import make_plan
from gpusim.scene import Scene

DOCUMENT: dict[str, Any] = {
    "schema": 1,
    "name": "rig",
    "prop": [{"name": "wall", "center_mm": [0.0, 0.0, 0.0], "normal": [0.0, -1.0, 0.0],
              "size_mm": [400.0, 300.0],
              "paint": [{"name": "wall", "type": "plain", "albedo": 0.5}]}],
    "camera": [
        {"name": name, "sensor_mm": [5.7, 3.3], "resolution_px": [57, 33], "focal_mm": 8.0,
         "position_mm": [x, -600.0, 10.0], "target_mm": [0.0, 0.0, 0.0], "distortion": lens}
        for name, x, lens in (("left", -110.0, [-0.1, 0.05, 0.004, -0.003]), ("right", 130.0, []))
    ],
    "analysis": {"load_factors": [0.0]},
    "output": {"calibration": ["opencv", "matchid", "vic", "dice", "kalibr"]},
}  # fmt: skip


def scene(path: str = "", value: Any = None) -> Scene:
    made = Scene.from_document(copy.deepcopy(DOCUMENT))
    return made.replace(path, value) if path else made


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("rig") / "out"
    gs.run(scene(), out, backend="numpy")
    return out


def test_a_run_writes_what_the_function_writes(done: Path, tmp_path: Path) -> None:
    cameras = list(scene().cameras().values())
    written = gs.write_calibration_files(tmp_path, cameras, DOCUMENT["output"]["calibration"])
    assert {path.name for path in (done / "calibration").iterdir()} == set(written)
    for name in written:
        assert (done / "calibration" / name).read_bytes() == (tmp_path / name).read_bytes()


def test_the_cameras_of_a_run_are_in_its_files(done: Path) -> None:
    """A second scene sees by them what the first one saw."""
    points = np.random.default_rng(1).uniform(-0.05, 0.05, (30, 3))
    for which, name in enumerate(("left", "right")):
        changes = {"calibration": str(done / "calibration" / "dice.xml"),
                   "calibration_camera": which}  # fmt: skip
        table = {"name": name, "resolution_px": [57, 33], **changes}
        again = Scene.from_document({**copy.deepcopy(DOCUMENT), "camera": [table], "output": {}})
        seen = again.cameras()[name].project(points)
        np.testing.assert_allclose(seen, scene().cameras()[name].project(points), atol=1e-9)


def test_what_a_refitted_lens_is_off_by_is_told(done: Path) -> None:
    report = json.loads((done / "report.json").read_text())
    fit = gs.fit_lens(scene().cameras()["left"], "vic")
    assert fit.rms > 0.01
    assert f"calibration files, camera left: {fit.words}" in report["warnings"]
    facts = report["facts"]
    assert facts["calibration for vic"] == f"camera left: {fit.words}"
    assert {
        facts[f"calibration for {name}"] for name in ("opencv", "matchid", "dice", "kalibr")
    } == {"exact"}
    assert 'href="calibration"' in (done / "report.html").read_text()


@pytest.mark.parametrize(
    ("path", "value", "again"),
    [
        ("camera.right.focal_mm", 8.5, True),
        ("output.calibration", ["vic"], True),
        ("sensor.seed", 5, False),
        ("output.truth", ["depth"], False),
        ("prop.wall.size_mm", [410.0, 300.0], False),
        ("analysis.load_factors", [0.0, 0.0], False),
    ],
)
def test_files_depend_on_cameras_and_formats_alone(
    done: Path, path: str, value: Any, again: bool
) -> None:
    plan = make_plan(scene(path, value), done, "numpy")
    assert plan["export"].state == ("run" if again else "reused")


def test_faults_are_those_of_the_scene() -> None:
    with pytest.raises(SceneError, match=r"output.calibration: needs a camera; got no camera"):
        scene("camera", [])
    with pytest.raises(SceneError, match=r"output\.calibration\.0"):
        scene("output.calibration", ["gom"])
    one = DOCUMENT["camera"][1]
    with pytest.raises(SceneError, match=r"few cameras; got 11 cameras; expected at most 10"):
        scene("camera", [{**one, "name": f"c{number}"} for number in range(11)])


def test_the_command_says_how_many_and_how_good(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(scene().to_toml())
    result = CliRunner().invoke(
        app, ["run", str(path), "-o", str(tmp_path / "out"), "--backend", "numpy"]
    )
    assert result.exit_code == 0, result.stderr
    assert "9 files, off by" in result.stdout
