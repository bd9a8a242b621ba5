"""``identify_files`` and ``gpusim identify``: modes of a film, and the files that tell of them."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest
from typer.testing import CliRunner

import gpusim as gs
from gpusim.applications import IdentificationSettings, identify_files
from gpusim.arrays.array_types import Float
from gpusim.cli import app
from tests.support.modal_response import free_decay
from tests.support.moving_pattern import MovingPattern

RATE = 100.0
HERTZ, DAMPING = np.array([9.0, 23.0]), np.array([0.01, 0.006])


@pytest.fixture(scope="module")
def film() -> Float:
    """A pattern let go: along x at 9 Hz, along y at 23 Hz."""
    times = np.arange(160) / RATE
    motion = free_decay(2 * np.pi * HERTZ, DAMPING, times, np.array([0.6, 0.4]))
    return MovingPattern(height=66, width=80).frames(motion)


def test_modes_of_a_film(film: Float, tmp_path: Path) -> None:
    settings = IdentificationSettings(grid=4, rate_Hz=RATE, modes=2, excitation="release")
    told: list[float] = []
    done = identify_files(film, tmp_path / "out", settings, progress=lambda *a: told.append(a[1]))
    np.testing.assert_allclose(done.modes.frequency_Hz, HERTZ, rtol=1e-3)
    np.testing.assert_allclose(done.modes.damping, DAMPING, rtol=0.05)
    shapes = done.modes.shapes
    assert np.abs(shapes[0, :, 1]).max() < 0.02 < 0.98 < shapes[0, :, 0].min()
    assert np.abs(shapes[1, :, 0]).max() < 0.02 < 0.98 < shapes[1, :, 1].min()
    assert told[-1] == 1.0 and len(told) == 160
    assert sum(done.report["lost"].values()) + done.report["measured"] == done.report["points"]
    table = np.genfromtxt(tmp_path / "out/modes.csv", delimiter=",", names=True)
    np.testing.assert_allclose(table["frequency_Hz"], done.modes.frequency_Hz, rtol=1e-8)
    rows = np.genfromtxt(tmp_path / "out/shapes.csv", delimiter=",", names=True)
    assert len(rows) == 2 * done.report["measured"]
    with h5py.File(tmp_path / "out/modes.h5") as file:
        assert file["displacement"].shape == done.series.displacement.shape
        assert file["displacement"].attrs["unit"] == "px" and file["times"].attrs["unit"] == "s"
        np.testing.assert_array_equal(file["modes/shapes"], shapes)
    drawn = cv2.imread(str(tmp_path / "out/mode_2.png"))
    blue = np.any(np.ptp(drawn.astype(int), axis=2) > 60)
    assert blue and all(path.exists() for path in done.files)


def test_noise_is_no_texture(film: Float, tmp_path: Path) -> None:
    noise = np.random.default_rng(2).normal(size=(len(film), 66, 160))
    half = np.concatenate([film, np.full_like(film, 90.0)], axis=2) + noise
    settings = IdentificationSettings(grid=10, rate_Hz=RATE, modes=2, excitation="release")
    done = identify_files(half, tmp_path, settings)
    assert done.series.points[:, 0].max() < 80 + 21 // 2  # a subset at the border shows some of it
    assert done.report["measured"] >= 15
    np.testing.assert_allclose(done.modes.frequency_Hz, HERTZ, rtol=1e-3)


def test_command(film: Float, tmp_path: Path) -> None:
    pictures = np.clip(np.rint(film * 100), 0, 65535).astype(np.uint16)
    gs.write_video(tmp_path / "film.mkv", list(pictures), frame_rate=RATE)
    arguments = ["identify", str(tmp_path / "film.mkv"), "-o", str(tmp_path / "out"), "--json"]
    (tmp_path / "out").mkdir()
    (tmp_path / "out/mode_2.png").write_bytes(b"of a run before")
    options = ["--point", "40,33", "--point", "30,30", "--modes", "1", "--band", "15,40",
               "--excitation", "release", "--displacements", "phase"]  # fmt: skip
    done = CliRunner().invoke(app, [*arguments, *options])
    assert done.exit_code == 0, done.output
    report = json.loads(done.stdout)
    assert report["modes"][0]["frequency_Hz"] == pytest.approx(HERTZ[1], rel=1e-3)
    assert report["rate_Hz"] == pytest.approx(RATE) and report["points"] == 2
    assert [path.name for path in (tmp_path / "out").glob("*.png")] == ["mode_1.png"]
    wrong = CliRunner().invoke(app, [*arguments[:-1], "--band", "15;40"])
    assert wrong.exit_code == 2 and "--band: got '15;40'; expected LOW,HIGH" in wrong.stderr
    text = CliRunner().invoke(app, [*arguments[:-1], *options[:4], "--excitation", "release",
                                    "--modes", "2"])  # fmt: skip
    assert text.exit_code == 0 and "Hz" in text.stdout and "23.000" in text.stdout


def test_wrong_files(tmp_path: Path) -> None:
    flat = np.full((70, 40, 50), 9, np.uint8)
    with pytest.raises(gs.InputError, match=r"none found in all pictures \(\d+ no_texture\)"):
        identify_files(flat, tmp_path / "out", IdentificationSettings(rate_Hz=10.0))
    with pytest.raises(gs.InputError, match="rate_Hz"):
        IdentificationSettings(rate_Hz=-1.0)
    assert not (tmp_path / "out").exists()
