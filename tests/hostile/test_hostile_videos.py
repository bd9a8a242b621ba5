"""Damaged videos: the frames that are whole, or one error that names the file; never other pixels
where a file has checksums."""

from __future__ import annotations

import shutil
import time
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError
from tests.files.test_video_container import LONG, encoded
from tests.hostile.amount import SEED, share
from tests.hostile.mutations import mutations
from tests.hostile.tiny_runs import LIMIT
from tests.support.cine_bytes import cine_bytes
from tests.support.moving_pattern import MovingPattern

pytestmark = pytest.mark.hostile
RNG = np.random.default_rng(SEED)
FRAMES = [RNG.integers(0, 256, (57, 33)).astype(np.uint8) for _ in range(9)]
CODECS = {
    "h264.mp4": "libx264",
    "h264.mkv": "libx264",
    "mpeg4.avi": "mpeg4",
    "vp9.webm": "libvpx-vp9",
}
MEASURED = 90  # frames
KINDS = ("ffv1.mkv", "shot.cih", "shot.cine", "png.mov", *CODECS)


def video(folder: Path, kind: str) -> Path:
    path = folder / kind
    if kind in CODECS:
        return encoded(path, CODECS[kind], "yuv420p", LONG if kind != "vp9.webm" else {})
    if kind == "png.mov":
        return encoded(path, "png", "gray")
    if kind == "shot.cine":
        path.write_bytes(cine_bytes(FRAMES, times=[k / 1000 for k in range(9)]))
        return path
    return gs.write_video(path, FRAMES, frame_rate=100.0)


def read(path: Path) -> list[Any]:
    """All frames, None for those that are refused one by one."""
    frames: list[Any] = []
    for number in range(min(len(found := gs.read_video(path)), 50)):
        try:
            frames.append(found[number])
        except InputError as error:
            assert path.stem in str(error) and "\n" not in str(error)
            frames.append(None)
    return frames


def followed(path: Path, out: Path) -> list[str]:
    settings = gs.applications.CorrelationSettings(subset=21, backend="numpy")
    done = gs.applications.track_files(path, out, settings, points=[[24, 20]])
    return list(done.report["warnings"])


def identified(path: Path, out: Path) -> list[str]:
    settings = gs.applications.IdentificationSettings(
        points=[[24, 20]], subset=15, rate_Hz=100.0, modes=1, excitation="release"
    )
    return list(gs.applications.identify_files(path, out, settings).report["warnings"])


def magnified(path: Path, out: Path) -> list[str]:
    film = gs.applications.magnify_files(path, out / "large.mkv", (8, 20), 5, rate_Hz=100.0)
    assert len(gs.read_video(film)) == len(gs.read_video(path))
    return list(gs.read_video(path).notes)


@pytest.mark.parametrize("measure", [followed, identified, magnified])
def test_damaged_videos_are_measured(
    measure: Callable[[Path, Path], list[str]], tmp_path: Path
) -> None:
    """The frames that are whole, which is said; or one error, and nothing is left of the work."""
    times = np.arange(MEASURED) / 100
    wave = np.exp(-times) * np.sin(2 * np.pi * 12 * times)
    pattern = MovingPattern(height=40, width=48).frames(np.stack([wave, 0 * wave], axis=1))
    frames = np.rint(20 + 200 * (pattern - pattern.min()) / np.ptp(pattern)).astype(np.uint8)
    whole = gs.write_video(tmp_path / "film.mkv", frames, times=times)
    assert measure(whole, tmp_path / "whole") == []
    path = tmp_path / "damaged.mkv"
    good = whole.read_bytes()
    cut = ("cut off", good[: len(good) * 3 // 4])
    rng = np.random.default_rng([SEED, zlib.crc32(measure.__name__.encode())])
    for number, (damage, data) in enumerate([cut, *mutations(good, rng, share(40))]):
        path.write_bytes(data)
        what, out = f"seed {SEED}, {measure.__name__} {number}: {damage}", tmp_path / str(number)
        begun = time.monotonic()
        try:
            told = measure(path, out)
        except InputError as error:
            assert "\n" not in str(error), what
            assert not out.exists() or not list(out.iterdir()), what
        else:
            fewer = len(gs.read_video(path)) < MEASURED
            assert told or not fewer, what
        assert time.monotonic() - begun < LIMIT, what


@pytest.mark.parametrize("kind", KINDS)
def test_damaged_videos(kind: str, tmp_path: Path) -> None:
    whole = video(tmp_path, kind)
    (tmp_path / "damaged").mkdir()
    path = tmp_path / "damaged" / kind
    if kind == "shot.cih":
        shutil.copy(whole.with_suffix(".mraw"), path.with_suffix(".mraw"))
    rng = np.random.default_rng([SEED, zlib.crc32(kind.encode())])
    for number, (damage, data) in enumerate(mutations(whole.read_bytes(), rng, share(100))):
        path.write_bytes(data)
        what = f"seed {SEED}, {kind} {number}: {damage}"
        begun = time.monotonic()
        try:
            frames = read(path)
        except InputError as error:
            assert path.stem in str(error) and "\n" not in str(error), what
            continue
        finally:
            assert time.monotonic() - begun < LIMIT, what
        there = [frame for frame in frames if frame is not None]
        assert all(frame.dtype.kind == "u" and frame.ndim in (2, 3) for frame in there), what
        if kind == "ffv1.mkv" and len(frames) == len(FRAMES):
            alike = [frame is None or (frame == given).all()
                     for frame, given in zip(frames, FRAMES, strict=True)]  # fmt: skip
            assert all(alike), what
