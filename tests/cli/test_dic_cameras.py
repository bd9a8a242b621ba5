"""``gpusim dic`` with calibrations: the lens undone, and pairs measured in space."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

import gpusim as gs
from gpusim.cli import app
from tests.support.measure_images import speckles

WIDTH, HEIGHT = 137, 101
K = np.array([[400.0, 0.0, 61.0], [0.0, 410.0, 53.0], [0.0, 0.0, 1.0]])
LENS = np.array([-0.9, 0.4, 0.002, -0.003, 0.0])
MOTION = np.array([1.5, -0.75])  # px
DISTANCE, BASELINE = 800.0, 25.0  # mm: a disparity of 12.5 px


def picture(path: Path, shift: tuple[float, float] = (0.0, 0.0)) -> str:
    image = speckles(WIDTH, HEIGHT, shift=shift)
    cv2.imwrite(str(path), np.rint(image * 200).astype(np.uint16))
    return str(path)


def rows(path: Path) -> list[dict[str, str]]:
    lines = (line for line in path.read_text().splitlines() if not line.startswith("#"))
    return [row for row in csv.DictReader(lines) if row["status"] == "OK"]


def numbers(table: list[dict[str, str]], *names: str) -> np.ndarray:
    return np.array([[float(row[name]) for name in names] for row in table])


def run(*arguments: object) -> object:
    fixed = ["--backend", "numpy", "--subset", "21", "--step", "9"]
    return CliRunner().invoke(app, ["dic", *(str(a) for a in arguments), *fixed])


def test_the_lens_is_undone(tmp_path: Path) -> None:
    calibration = tmp_path / "camera.yml"
    gs.write_calibration(calibration, [gs.Camera(WIDTH, HEIGHT, K, LENS, name="one")], "opencv")
    files = [picture(tmp_path / "a.png"), picture(tmp_path / "b.png", (1.5, -0.75))]
    done = run(*files, "-o", tmp_path / "out", "--calibration", calibration)
    assert done.exit_code == 0, done.output
    table = rows(tmp_path / "out" / "0001_b.csv")
    assert len(table) >= 60
    place = numbers(table, "x_px", "y_px")

    def undone(points: np.ndarray) -> np.ndarray:
        return cv2.undistortPoints(points[:, None], K, LENS, None, None, K).reshape(-1, 2)

    true = undone(place + MOTION) - undone(place)
    assert np.abs(true - MOTION).max() >= 0.02  # the lens matters
    assert np.abs(numbers(table, "u_px", "v_px") - true).max() <= 4e-3
    strain = [row for row in table if row["exx"]]
    # what moves stiffly in the picture is strained in space
    place = numbers(strain, "x_px", "y_px")
    step = np.array([2.0, 0.0])
    ends = [undone(place + s) for s in (-step, step)]
    moved = [undone(place + s + MOTION) for s in (-step, step)]
    before, after = (np.linalg.norm(e[1] - e[0], axis=1) for e in (ends, moved))
    assert np.abs(numbers(strain, "exx")[:, 0] - (after / before - 1)).max() <= 1e-3


def test_pairs_are_measured_in_space(tmp_path: Path) -> None:
    right = np.eye(4)
    right[0, 3] = -BASELINE / 1000.0  # Kalibr's unit is the metre
    cameras = [gs.Camera(WIDTH, HEIGHT, K, None, T, name) for T, name in
               ((np.eye(4), "left"), (right, "right"))]  # fmt: skip
    calibration = tmp_path / "rig.yaml"
    gs.write_calibration(calibration, cameras, "kalibr")
    disparity = K[0, 0] * BASELINE / DISTANCE
    files = [
        picture(tmp_path / f"{side}{k}.png", (2.0 * k - away, -1.025 * k))
        for k in range(2)
        for side, away in (("l", 0.0), ("r", disparity))
    ]
    done = run("--stereo", calibration, *files, "-o", tmp_path / "out", "--strain", "hencky")
    assert done.exit_code == 0, done.output
    assert "mean W" in done.output
    table = rows(tmp_path / "out" / "0001_l1.csv")
    assert len(table) >= 50
    space = numbers(table, "X_mm", "Y_mm", "Z_mm")
    x, y = numbers(table, "x_px", "y_px").T
    true = np.column_stack([(x - 61.0) / 400.0, (y - 53.0) / 410.0, np.ones(x.size)]) * DISTANCE
    # 0.003 px of 12.5 are 0.2 mm along the line of sight
    assert np.median(np.abs(space - true), axis=0) == pytest.approx(0.0, abs=0.2)
    moved = numbers(table, "U_mm", "V_mm", "W_mm")
    assert np.abs(np.median(moved, axis=0) - [4.0, -2.0, 0.0]).max() <= 0.02
    assert np.abs(numbers([row for row in table if row["exx"]], "exx", "eyy")).max() <= 2e-3
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["images"][0]["U_mean"] == pytest.approx(4.0, abs=0.01)
    for side in range(2):
        gs.write_video(tmp_path / f"{side}.mkv", gs.read_frames(files[side::2]), frame_rate=100.0)
    films = [tmp_path / f"{side}.mkv" for side in range(2)]
    again = run("--stereo", calibration, *films, "-o", tmp_path / "films", "--strain", "hencky")
    assert again.exit_code == 0, again.output
    same = rows(tmp_path / "films" / "0001_0.csv")
    assert (
        numbers(same, "U_mm", "sigma_X_mm").tolist()
        == numbers(table, "U_mm", "sigma_X_mm").tolist()
    )
    shape = run("--stereo", calibration, *files[:2], "-o", tmp_path / "shape")
    assert shape.exit_code == 0, shape.output
    assert (
        np.abs(numbers(rows(tmp_path / "shape" / "0001_l0.csv"), "U_mm", "V_mm", "W_mm")).max()
        == 0.0
    )


def test_wrong_calibrations_are_refused(tmp_path: Path) -> None:
    one, two = tmp_path / "one.yml", tmp_path / "two.yml"
    gs.write_calibration(one, [gs.Camera(WIDTH, HEIGHT, K, name="one")], "opencv")
    gs.write_calibration(two, [gs.Camera(WIDTH + 1, HEIGHT, K, name="two")], "opencv")
    files = [picture(tmp_path / f"{name}.png") for name in "abcd"]
    cases = {
        ("--stereo", one, *files): "got 1 cameras; expected 2",
        ("--stereo", one, *files[:3]): "got 3 pictures; expected pairs",
        ("--stereo", one, "--strain", "small", *files): "--strain",
        ("--stereo", one, "--calibration", one, *files): "one of the two",
        ("--calibration", two, *files): "camera 'two' with 138x101 px; expected 137x101",
        ("--calibration", files[0], *files): "calibration file",
        ("--apart-px", "-1", *files): "apart_px",
    }
    for arguments, words in cases.items():
        done = run(*arguments, "-o", tmp_path / "out")
        assert done.exit_code == 2, (arguments, done.output)
        assert words in " ".join(done.output.split()), done.output
    assert not (tmp_path / "out").exists()
