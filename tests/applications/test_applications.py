"""Applications from Python: plain arguments, results, and the list of what was written."""

from __future__ import annotations

import gc
import json
import weakref
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import tifffile
from typer.testing import CliRunner

import gpusim as gs
from gpusim.applications import (
    CorrelationSettings,
    calibrate_files,
    correlate_files,
    correlate_pairs,
    correlation_output,
    solve_deck,
)
from gpusim.cli import app
from gpusim.errors import InputError
from gpusim.files.output_folder import claim
from gpusim.measure import Chessboard
from tests.support.deck_texts import deck, step, write
from tests.support.example_files import write_example_files
from tests.support.measure_images import speckles

WIDTH, HEIGHT = 137, 101
K = np.array([[400.0, 0.0, 61.0], [0.0, 410.0, 53.0], [0.0, 0.0, 1.0]])
BASELINE, DISTANCE = 25.0, 800.0  # mm
DISPARITY = K[0, 0] * BASELINE / DISTANCE
SETTINGS = CorrelationSettings(subset=21, step=9, backend="numpy")


def pictures(shift: float = 0.0) -> Any:
    """Three pictures that move by (2, -1.025) px each."""
    return np.stack([
        np.rint(speckles(WIDTH, HEIGHT, shift=(2.0 * k - shift, -1.025 * k)) * 200)
        for k in range(3)
    ]).astype(np.uint16)  # fmt: skip


def written(folder: Path) -> set[Path]:
    return {path for path in folder.rglob("*") if path.is_file()}


def rig(folder: Path) -> Path:
    right = np.eye(4)
    right[0, 3] = -BASELINE / 1000.0  # Kalibr's unit is the metre
    cameras = [gs.Camera(WIDTH, HEIGHT, K, None, T, name) for T, name in
               ((np.eye(4), "left"), (right, "right"))]  # fmt: skip
    path = folder / "rig.yaml"
    gs.write_calibration(path, cameras, "kalibr")
    return path


def test_arrays_are_correlated_with_their_times(tmp_path: Path) -> None:
    stages = []
    frames = gs.read_frames(pictures(), times=[0.0, 0.25, 1.0])
    done = correlate_files(
        frames[0], frames[1:], tmp_path / "out", SETTINGS,
        progress=lambda stage, share, text: stages.append((stage, share, text)),
    )  # fmt: skip
    for number, result in enumerate(done.results, start=1):
        error = result.displacement[result.ok] - number * np.array([2.0, -1.025])
        assert result.ok.sum() > 60 and np.abs(error).max() < 0.02
    assert [row["time_s"] for row in done.report["images"]] == [0.25, 1.0]
    assert [row["image"] for row in done.report["images"]] == ["frame 1", "frame 2"]
    assert all(found is not None and found.ok.any() for found in done.strains)
    assert set(done.files) == written(tmp_path / "out") and done.failure == ""
    assert json.loads((tmp_path / "out" / "report.json").read_text()) == done.report
    assert "taken at (s)" in (tmp_path / "out" / "report.html").read_text()
    assert stages[-1][:2] == ("dic", 1.0)


def test_a_video_is_correlated_as_its_pictures_are(tmp_path: Path) -> None:
    path = gs.write_video(tmp_path / "film.mkv", pictures(), times=[0.0, 0.25, 1.0])
    path.write_bytes(path.read_bytes()[:-20_000])  # into the last frame
    done = correlate_files(f"{path}#1", path, tmp_path / "out", SETTINGS)
    for number, result in enumerate(done.results):
        error = result.displacement[result.ok] - number * np.array([2.0, -1.025])
        assert result.ok.sum() > 60 and np.abs(error).max() < 0.02
    assert [row.get("time_s") for row in done.report["images"]] == [0.0, 0.25]
    assert "2 frames of 3" in done.report["warnings"][0]
    with pytest.raises(InputError, match=r"2 frames; expected one: name it, as film\.mkv#1"):
        correlate_files(path, path, tmp_path / "out", SETTINGS)


def test_a_long_series_keeps_no_results(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    results: list[weakref.ref[Any]] = []
    most = 0

    def watched(path: Path, result: Any, *_: Any) -> Path:
        nonlocal most
        results.append(weakref.ref(result.displacement))
        gc.collect()  # figures hold what they show in circles
        most = max(most, sum(one() is not None for one in results))
        return path

    monkeypatch.setattr(correlation_output, "write_correlation", watched)
    frames = np.tile(pictures(), (3, 1, 1))
    settings = CorrelationSettings(subset=21, step=30, strain="none", backend="numpy")
    done = correlate_files(frames[0], frames, tmp_path / "out", settings, keep_results=False)
    assert done.results == [] and done.strains == [] and len(done.report["images"]) == 9
    assert most <= 3


def test_pairs_come_from_stacks(tmp_path: Path) -> None:
    for name, shift in (("left", 0.0), ("right", DISPARITY)):
        tifffile.imwrite(tmp_path / f"{name}.tif", pictures(shift), photometric="minisblack")
    sides = tmp_path / "left.tif", tmp_path / "right.tif"
    stages: list[tuple[float, str]] = []
    done = correlate_pairs(*sides, rig(tmp_path), tmp_path / "out", SETTINGS,
                           progress=lambda _, *stage: stages.append(stage))  # fmt: skip
    assert [share for share, _ in stages] == [0.0, 0.5, 1.0]
    assert [text.split(":")[0] for _, text in stages[1:]] == ["left.tif#2", "left.tif#3"]
    true = np.array([2.0 * DISTANCE / K[0, 0], -1.025 * DISTANCE / K[1, 1], 0.0])
    for number, result in enumerate(done.results, start=1):
        moved = np.median(result.displacement[result.ok], axis=0)
        np.testing.assert_allclose(moved, number * true, atol=0.02)
    assert [row["image"] for row in done.report["images"]] == [f"{sides[0]}#2", f"{sides[0]}#3"]
    assert set(done.files) == written(tmp_path / "out")
    shape = correlate_pairs(pictures()[:1], pictures(DISPARITY)[:1], rig(tmp_path),
                            tmp_path / "shape", SETTINGS)  # fmt: skip
    assert shape.strains == [None] and len(shape.results) == 1


def test_the_command_takes_a_folder_and_stacks_of_pairs(tmp_path: Path) -> None:
    (tmp_path / "series").mkdir()
    for number, picture in enumerate(pictures()):
        cv2.imwrite(str(tmp_path / "series" / f"{number}.png"), picture)
    for name, shift in (("left", 0.0), ("right", DISPARITY)):
        tifffile.imwrite(tmp_path / f"{name}.tif", pictures(shift), photometric="minisblack")
    fixed = ["-q", "--step", "30", "--strain", "none", "--backend", "numpy"]
    series = [tmp_path / "series" / "0.png", tmp_path / "series", "-o", tmp_path / "flat"]
    pairs = ["--stereo", rig(tmp_path), tmp_path / "left.tif", tmp_path / "right.tif",
             "-o", tmp_path / "space"]  # fmt: skip
    for words, count in ((series, 3), (pairs, 2)):
        done = CliRunner().invoke(app, ["dic", *map(str, words), *fixed])
        assert done.exit_code == 0, done.output
        report = json.loads((Path(words[-1]) / "report.json").read_text())
        assert len(report["images"]) == count and report["images"][-1]["measured"] > 0


@pytest.mark.parametrize(
    ("change", "python", "option"),
    [
        ({"strain_window": 4}, "`strain_window`: got 4", "--strain-window: got 4"),
        ({"strain": "small"}, "hencky, none with `rig`", "hencky, none with --stereo"),
        ({"calibration": "a.yml"}, "`calibration`: the cameras are in `rig`",
         "--calibration: the cameras are in --stereo"),
        ({"mask": "cut.png"}, "`mask`: cut.png: got 7x9 px", "--mask: cut.png: got 7x9 px"),
    ],
)  # fmt: skip
def test_errors_name_arguments_here_and_options_there(
    change: dict[str, Any],
    python: str,
    option: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, picture in zip(("left.png", "right.png"), pictures(), strict=False):
        cv2.imwrite(name, picture)
    cv2.imwrite("cut.png", np.zeros((9, 7), np.uint8))
    rig(tmp_path)
    with pytest.raises(InputError) as caught:
        correlate_pairs("left.png", "right.png", "rig.yaml", "out", CorrelationSettings(**change))
    assert python in str(caught.value)
    ((key, value),) = change.items()
    words = ["dic", "--stereo", "rig.yaml", "left.png", "right.png", "-o", "out"]
    done = CliRunner().invoke(app, [*words, f"--{key.replace('_', '-')}", str(value)])
    assert done.exit_code == 2 and option in done.output
    assert not Path("out").exists()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"formats": ("xlsx",)}, "`formats`: got xlsx; expected csv, npz, h5"),
        ({"strain": "large"}, "`strain`: got large; expected small, green-lagrange"),
        ({"strain_window": "wide"}, "strain_window; got 'wide'; expected"),
        ({"roi": "all"}, "roi; got 'all'; expected"),
        ({"window": 3}, "window"),
    ],
)
def test_wrong_settings_are_refused_before_any_work(
    change: dict[str, Any], message: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=message):
        correlate_files("nowhere.png", [], tmp_path / "out", CorrelationSettings(**change))
    assert not (tmp_path / "out").exists()


def test_unequal_numbers_of_pictures_are_no_pairs(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="lefts, rights: got 3 and 2 pictures; expected pairs"):
        correlate_pairs(pictures(), pictures()[1:], rig(tmp_path), tmp_path / "out", SETTINGS)


def test_a_folder_in_use_is_refused(tmp_path: Path) -> None:
    with claim(tmp_path / "out"), pytest.raises(InputError, match="in use by process"):
        correlate_files(pictures()[0], pictures(), tmp_path / "out", SETTINGS)
    assert not (tmp_path / "out").exists()


def test_a_deck_is_solved_and_a_step_that_does_not_converge_is_told(tmp_path: Path) -> None:
    path = write(tmp_path, deck(step("*CLOAD", "22, 3, -2."), step("*TEMPERATURE", "ALL, 10.")))
    done = solve_deck(path, tmp_path / "out", backend="numpy", stress=True)
    assert set(done.files) == written(tmp_path / "out") and done.failure == ""
    np.testing.assert_allclose(done.solutions[0].reactions.sum(axis=0), [0, 0, 2], atol=1e-9)
    assert done.report["steps"][0]["file"] == done.files[0].name == "solution_0001.vtu"
    strict = solve_deck(path, tmp_path / "out", backend="numpy", tolerance=1e-30)
    assert strict.report["status"] == "not converged" and len(strict.solutions) == 2
    assert strict.failure.startswith(f"{path}: step 1: ") and "expected 1e-30" in strict.failure


def test_cameras_are_calibrated_from_arrays(tmp_path: Path) -> None:
    write_example_files(tmp_path)
    frames = gs.read_frames([tmp_path / f"board-{number}.png" for number in range(4)])
    board = Chessboard(7, 6, 30.0)
    done = calibrate_files([list(frames)], board, tmp_path / "out", lens="pinhole")
    assert abs(done.calibration.cameras[0].K[0, 0] - 800) < 1
    assert set(done.files) == written(tmp_path / "out") and done.missed == []
    again = calibrate_files(frames, board, tmp_path / "again", lens="pinhole")
    assert again.calibration.rms == pytest.approx(done.calibration.rms, rel=1e-6)
    film = gs.write_video(tmp_path / "boards.cih", list(frames), frame_rate=2.0)
    filmed = calibrate_files(film, board, tmp_path / "filmed", lens="pinhole")
    assert filmed.calibration.rms == pytest.approx(done.calibration.rms, rel=1e-6)
    with pytest.raises(InputError, match="`formats`; got 'excel'"):
        calibrate_files([list(frames)], board, tmp_path / "out", formats=["excel"])
