"""``gpusim calibrate``: from pictures to files that other programs read."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import gpusim as gs
from gpusim.applications.calibration import stated
from gpusim.cli import app
from gpusim.export.images import write_image
from gpusim.measure import Chessboard
from tests.support.target_images import board_poses, board_surface

BOARD = Chessboard(9, 8, 40.0)
CAMERAS = [
    gs.Camera.from_lens((36, 24), 30, (600, 400), (100, -1000, 300), (300, 0, 290)),
    gs.Camera.from_lens((36, 24), 32, (600, 400), (600, -980, 300), (310, 0, 300)),
]


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory, device: gs.Device) -> Path:
    folder = tmp_path_factory.mktemp("pictures")
    for k, pose in enumerate(board_poses(5, np.array([300.0, 0.0, 290.0]), 3, 60.0)):
        for name, camera in zip(("left", "right"), CAMERAS, strict=True):
            (folder / name).mkdir(exist_ok=True)
            frame = gs.render([board_surface(BOARD, pose)], camera, background=0.3, device=device)
            write_image(folder / name / f"{k:02d}.png", gs.Sensor().expose(frame))
    write_image(folder / "left" / "99.png", np.full((400, 600), 90, np.uint8))
    write_image(folder / "right" / "99.png", np.full((400, 600), 90, np.uint8))
    return folder


@pytest.mark.drawn
def test_a_pair_is_calibrated_and_written(pictures: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    done = CliRunner().invoke(
        app,
        ["calibrate", str(pictures / "left"), "--with", str(pictures / "right"), "--board", "9x8",
         "--square-mm", "40", "--lens", "pinhole", "-o", str(out), "--format", "opencv",
         "--format", "kalibr"],
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    assert "not used: 99.png: no board found" in done.output
    content = json.loads((out / "calibration.json").read_text())
    assert content["rms_px"] <= 0.01 and len(content["cameras"]) == 2
    for own, camera in zip(content["cameras"], CAMERAS, strict=True):
        assert abs(own["K"][0][0] / camera.K[0, 0] - 1) <= 2e-4
    relative = CAMERAS[1].camera_from_world @ np.linalg.inv(CAMERAS[0].camera_from_world)
    assert abs(content["cameras"][1]["baseline_mm"] / np.linalg.norm(relative[:3, 3]) - 1) <= 2e-4
    assert (out / "report.html").is_file() and (out / "figures" / "calibration.png").is_file()
    for name in ("calibration-opencv.yml", "calibration-kalibr.yaml"):
        again = gs.read_calibration(out / name)
        assert np.abs(again[1].K - np.array(content["cameras"][1]["K"])).max() <= 1e-6


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (["--board", "9by8"], "COLUMNSxROWS"),
        (["--format", "excel"], "got 'excel'"),
        (["--format", "opencv", "--format", "kalibr"], "kalibr: can't hold 1 camera with --lens"),
        (["--lens", "fisheye"], "'fisheye' is not one of"),
        (["--with", "nowhere"], "nowhere: not found"),
    ],
)
def test_wrong_wishes_are_refused(
    pictures: Path, tmp_path: Path, change: list[str], message: str
) -> None:
    files = [str(pictures / "left" / f"{k:02d}.png") for k in range(3)]
    wishes = ["--board", "9x8", "--square-mm", "40", "-o", str(tmp_path / "out")]
    done = CliRunner().invoke(app, ["calibrate", *files, *wishes, *change])
    assert done.exit_code == 2
    assert message in " ".join(done.output.split())


def test_a_board_that_counts_inner_corners_is_told_from_one_picture(
    pictures: Path, tmp_path: Path
) -> None:
    files = [str(pictures / "left" / f"{k:02d}.png") for k in range(5)]
    wishes = ["--board", "8x7", "--square-mm", "40", "-o", str(tmp_path / "out")]
    done = CliRunner().invoke(app, ["calibrate", *files, *wishes])
    text = " ".join(done.output.split())
    assert done.exit_code == 2 and "00.png shows 9x8 fields" in text and "--board 9x8" in text


def test_a_picture_of_another_size_is_named(pictures: Path, tmp_path: Path) -> None:
    odd = tmp_path / "odd.png"
    write_image(odd, np.full((300, 600), 90, np.uint8))
    files = [str(pictures / "left" / f"{k:02d}.png") for k in range(2)]
    wishes = ["--board", "9x8", "--square-mm", "40", "-o", str(tmp_path / "out")]
    done = CliRunner().invoke(app, ["calibrate", *files, str(odd), *wishes])
    text = " ".join(done.output.split())
    assert done.exit_code == 2 and "odd.png: got 600x300 px; expected 600x400 as 00.png" in text


def test_of_a_runs_own_pictures_those_of_the_board_are_taken(
    pictures: Path, tmp_path: Path
) -> None:
    """Frames of the scene beside them are no pictures of a board that wasn't found."""
    folder = tmp_path / "left"
    folder.mkdir()
    for k in range(4):
        shutil.copy(pictures / "left" / f"{k:02d}.png", folder / f"calib-{k:04d}.png")
    for k in range(2):
        write_image(folder / f"{k:04d}.png", np.full((400, 600), 90, np.uint8))
    wishes = ["--board", "9x8", "--square-mm", "40", "--lens", "pinhole"]
    done = CliRunner().invoke(app, ["calibrate", str(folder), *wishes, "-o", str(tmp_path / "out")])
    assert done.exit_code == 0, done.output
    content = json.loads((tmp_path / "out" / "calibration.json").read_text())
    names = [image["file"] for image in content["cameras"][0]["images"]]
    assert names == [f"calib-{k:04d}.png" for k in range(4)]
    (camera,) = gs.read_calibration(tmp_path / "out" / "calibration.json")
    assert np.abs(camera.K - content["cameras"][0]["K"]).max() == 0.0


def test_a_value_is_stated_to_two_figures_of_its_uncertainty() -> None:
    assert stated(533.930243, 0.2692, "px") == "533.93 ± 0.27 px"
    assert stated(-0.28324, 0.0046) == "-0.2832 ± 0.0046"
    assert stated(83173.8, 347.0, "mm") == "83174 ± 347 mm"
    assert stated(12.5, float("nan"), "mm") == "12.5 mm"


def test_the_report_has_a_column_for_each_camera(pictures: Path, tmp_path: Path) -> None:
    done = CliRunner().invoke(
        app,
        ["calibrate", str(pictures / "left"), "--with", str(pictures / "right"), "--board", "9x8",
         "--square-mm", "40", "--lens", "radial", "-o", str(tmp_path)],
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    page = (tmp_path / "report.html").read_text()
    titles = re.findall(r"<th scope=\"col\"[^>]*>([^<]*)</th>", page)
    assert titles == ["parameter", "camera-1", "camera-2"]
    row = re.search(r"<th scope=\"row\">distance to the first</th>(.*)</tr>", page)
    assert row is not None and row[1].count("±") == 1
    assert not re.search(r"<th scope=\"row\">p1</th>", page) and "Run time" not in page
