"""Damaged videos: the frames that are whole, or one error that names the file; never other pixels
where a file has checksums."""

from __future__ import annotations

import shutil
import time
import zlib
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

pytestmark = pytest.mark.hostile
RNG = np.random.default_rng(SEED)
FRAMES = [RNG.integers(0, 256, (57, 33)).astype(np.uint8) for _ in range(9)]
CODECS = {
    "h264.mp4": "libx264",
    "h264.mkv": "libx264",
    "mpeg4.avi": "mpeg4",
    "vp9.webm": "libvpx-vp9",
}
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
