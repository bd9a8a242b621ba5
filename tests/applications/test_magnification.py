"""``magnify_files`` and ``gpusim magnify``: a film in, a film out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from typer.testing import CliRunner

import gpusim as gs
from gpusim.applications import magnify_files
from gpusim.cli import app
from tests.support.moving_pattern import MovingPattern

RATE = 60.0
ARGUMENTS = ["--band", "14,18", "--factor", "10"]


def test_film_in_film_out(tmp_path: Path) -> None:
    motion = 0.05 * np.sin(2 * np.pi * 15 * np.arange(40) / RATE)
    frames = MovingPattern(height=40, width=48).frames(np.stack([motion, 0 * motion], axis=1))
    pictures = np.clip(np.rint(frames), 0, 255).astype(np.uint8)
    gs.write_video(tmp_path / "film.mkv", list(pictures), frame_rate=RATE)
    path = magnify_files(tmp_path / "film.mkv", tmp_path / "large", (14, 18), 10)
    folder = gs.read_video(path.parent)
    assert len(folder) == 40 and folder[0].shape == (40, 48)
    assert np.allclose(folder.times, np.arange(40) / RATE)
    arguments = ["magnify", str(tmp_path / "film.mkv"), "-o", str(tmp_path / "large.mkv")]
    done = CliRunner().invoke(app, [*arguments, *ARGUMENTS])
    assert done.exit_code == 0, done.output
    video = gs.read_video(tmp_path / "large.mkv")
    assert all(np.array_equal(one, other) for one, other in zip(video, folder, strict=True))
    assert np.abs(video[17].astype(float) - pictures[17]).max() > 10
    deep = [16 * one.astype(np.uint16) for one in pictures]  # 12 bits, as bright as 8 in a preview
    preview = magnify_files(np.array(deep), tmp_path / "large.mp4", (14, 18), 10, rate_Hz=RATE)
    assert abs(gs.read_video(preview)[17].mean() - pictures[17].mean()) < 3
    wrong = CliRunner().invoke(app, [*arguments, "--band", "18,14", "--factor", "10"])
    assert wrong.exit_code == 2 and "--band-Hz" not in wrong.stderr and "band_Hz" in wrong.stderr
    other = CliRunner().invoke(app, [*arguments[:-1], str(tmp_path / "large.avi"), *ARGUMENTS])
    assert other.exit_code == 2 and "large.avi; expected a folder, or one of .mkv" in other.stderr
    assert not (tmp_path / "large.avi").exists()
