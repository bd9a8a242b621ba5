"""``track_files`` and ``gpusim track``: known motions of markers and points in films."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from typer.testing import CliRunner

import gpusim as gs
from gpusim.applications import CorrelationSettings, track_files
from gpusim.arrays.array_types import Float
from gpusim.cli import app
from gpusim.errors import InputError
from gpusim.files.output_folder import claim
from tests.support.measure_images import Marker, board, speckles

WIDTH, HEIGHT, RATE, FRAMES = 260, 120, 200.0, 10
PLACES = np.array([[50.3, 30.6], [110.1, 34.2], [170.7, 28.9]])
HIDDEN = range(4, 7)  # frames in which the second marker isn't seen
SETTINGS = CorrelationSettings(backend="numpy", subset=21, formats=("csv", "h5"))
NUMPY = ("--backend", "numpy", "--subset", "21")


def motion(k: int) -> Float:
    """(3, 2) px of the markers in a frame; points move as the first."""
    return np.outer([1.0, 1.5, 2.0], [3.0 * np.sin(0.5 * k), 1.2 * np.sin(0.9 * k)])


def picture(k: int, away: float = 0.0, hides: bool = True) -> np.ndarray:
    """Markers above, speckles below; a card before one of the markers."""
    rng = np.random.default_rng([k, int(away)])
    markers = [
        Marker(x, y, 16, 16).moved(u - away, v, 0.01 * k)
        for (x, y), (u, v) in zip(PLACES, motion(k), strict=True)
    ]
    image = board(WIDTH, HEIGHT, markers)
    shift = motion(k)[0] - [away, 0.0]
    image[65:] = speckles(width=WIDTH, height=HEIGHT, shift=(shift[0], shift[1]))[65:]
    if hides and k in HIDDEN:
        image[15:55, 85:145] = 120
    return np.clip(np.rint(image + rng.normal(0, 1, image.shape)), 0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("film") / "film.mkv"
    return gs.write_video(path, [picture(k) for k in range(FRAMES)], frame_rate=RATE)


def table(path: Path) -> Any:
    """The rows of a CSV file, without its comments."""
    lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    return np.genfromtxt(lines, delimiter=",", names=True, dtype=None, encoding="utf-8")


def test_markers_and_points_of_a_film(film: Path, tmp_path: Path) -> None:
    done = track_files(
        film, tmp_path, SETTINGS, points=[[60, 90]], markers_px=(10, 30), mm_per_px=0.5
    )
    moved = np.array([one.displacement for one in done.results])
    true = np.array([np.vstack([motion(k), motion(k)[:1]]) for k in range(FRAMES)])
    lost = np.zeros((FRAMES, 4), dtype=bool)
    lost[HIDDEN, 1] = True
    assert (np.isnan(moved).all(axis=2) == lost).all(), "and it is found again behind the card"
    error = (moved - true)[~lost]
    sigma = np.array([one.sigma for one in done.results])[~lost]
    assert np.abs(error).max() <= 0.025 and (moved[0] == 0.0)[:3].all()
    assert 0.4 <= np.std(error[sigma > 0] / sigma[sigma > 0, None]) <= 1.6
    assert done.report["warnings"] == ["not found in some of 10 pictures: 2 in 3"]

    rows = table(tmp_path / "tracks.csv")
    assert len(rows) == 4 * FRAMES
    second = rows[rows["id"] == 2]
    np.testing.assert_allclose(second["time_s"], np.arange(FRAMES) / RATE)
    np.testing.assert_allclose(second["u_px"], moved[:, 1, 0], atol=1e-7)
    np.testing.assert_allclose(second["V_mm"], 0.5 * moved[:, 1, 1], atol=1e-7)
    assert (second["status"][HIDDEN] == "LOW_CORRELATION").all()
    with h5py.File(tmp_path / "tracks.h5") as file:
        units = {name: file[name].attrs["unit"] for name in ("time", "x", "u", "sigma", "U")}
        assert units == {"time": "s", "x": "px", "u": "px", "sigma": "px", "U": "mm"}
        np.testing.assert_array_equal(file["u"][:], moved[..., 0].ravel())
    assert all(path.exists() for path in done.files) and (tmp_path / "U_mm.png").exists()


def test_two_cameras_give_space(tmp_path: Path) -> None:
    """Seen from 500 mm by cameras 40 mm apart, of 400 px focal length."""
    K = np.array([[400.0, 0, 129.5], [0, 400.0, 59.5], [0, 0, 1]])
    pose = np.eye(4)
    pose[0, 3] = -0.04
    rig = [
        gs.Camera(WIDTH, HEIGHT, K, name="left"),
        gs.Camera(WIDTH, HEIGHT, K, None, pose, "right"),
    ]
    gs.write_calibration(tmp_path / "rig.yaml", rig, "kalibr")
    for side, away in (("left", 0.0), ("right", 32.0)):
        frames = [picture(k, away, hides=False) for k in range(3)]
        gs.write_video(tmp_path / f"{side}.mkv", frames, frame_rate=RATE)
    films = [str(tmp_path / f"{side}.mkv") for side in ("left", "right")]
    arguments = [
        "track",
        "--stereo",
        str(tmp_path / "rig.yaml"),
        *films,
        "-o",
        str(tmp_path / "out"),
    ]
    done = CliRunner().invoke(
        app, [*arguments, "--markers", "10,30", "--line", "80,90,120,90,2", *NUMPY, "--json"]
    )
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout)["images"][2]["measured"] == 5
    rows = table(tmp_path / "out/tracks.csv")
    last = rows[rows["frame"] == 2]
    true = np.vstack([motion(2), motion(2)[:1], motion(2)[:1]]) * 500 / 400
    assert np.abs(np.column_stack([last["U_mm"], last["V_mm"]]) - true).max() <= 0.03
    assert np.abs(last["W_mm"]).max() <= 0.5 and np.abs(last["Z_mm"] - 500).max() <= 1.0
    wrong = CliRunner().invoke(app, ["track", *films, "-o", str(tmp_path / "other")])
    assert wrong.exit_code == 2 and "VIDEO...; got 2; expected a video" in wrong.stderr


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (["--point", "6O,90"], "--point: got '6O,90'; expected X,Y in pixels"),
        (["--point", "60,90,1"], "--point: got '60,90,1'; expected X,Y"),
        (["--point", "260,90"], "--point; got 260,90; expected places in 260 x 120 px"),
        (["--point", "nan,90"], "--point; got nan,90"),
        (["--line", "1,2,30,40,1e9"], "--line N; got 1e+09; expected 2 to 1000 points"),
        (["--markers", "40,60"], "markers; got none; expected some 40 to 60 px wide"),
        (["--markers", "5,60"], "--markers; got (5.0, 60.0); expected (lowest, highest) width"),
        (["--mm-per-px=-1"], "mm_per_px; got -1.0; expected above 0"),
        (["--stereo", "rig.yaml"], "VIDEO...; got 1; expected a video, with --stereo two"),
    ],
)
def test_what_is_wrong_is_said_before_any_work(
    film: Path, tmp_path: Path, options: list[str], text: str
) -> None:
    done = CliRunner().invoke(app, ["track", str(film), "-o", str(tmp_path / "out"), *options])
    assert done.exit_code == 2 and text in done.stderr and done.stderr.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_files_and_folders_that_cannot_be_used(film: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"nothing\.mkv: not found"):
        track_files(tmp_path / "nothing.mkv", tmp_path / "out")
    with claim(tmp_path / "used"), pytest.raises(InputError, match="in use"):
        track_files(film, tmp_path / "used")
    with pytest.raises(InputError, match="got none; expected one of both cameras"):
        track_files(film, tmp_path / "out", right=film)
