"""Recordings of Vision Research, made byte by byte."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError
from tests.support.cine_bytes import cine_bytes

RNG = np.random.default_rng(50)
GREY = [RNG.integers(0, 256, (13, 8)).astype(np.uint8) for _ in range(4)]
CODES = [RNG.integers(0, 1024, (13, 8)).astype(np.uint16) for _ in range(4)]
COLOR = [RNG.integers(0, 65536, (13, 8, 3)).astype(np.uint16) for _ in range(4)]
TIMES = [-0.00025, 0.0, 0.00025, 0.0005]


@pytest.mark.parametrize(
    ("frames", "bits", "notes"),
    [(GREY, 8, 0), (CODES, 16, 0), (CODES, 12, 0), (CODES, 10, 1), (COLOR, 16, 0)],
)
def test_frames_are_as_they_are_stored(
    frames: list[Any], bits: int, notes: int, tmp_path: Path
) -> None:
    path = tmp_path / "shot.cine"
    path.write_bytes(cine_bytes(frames, bits=bits, times=TIMES, note=b"what a camera writes"))
    video = gs.read_video(path)
    np.testing.assert_array_equal(list(video), frames)
    assert video[0].dtype == frames[0].dtype and len(video.notes) == notes
    np.testing.assert_allclose(video.times, TIMES, rtol=0, atol=2.0**-32)
    assert not video.times_guessed


@pytest.mark.parametrize("times", [None, TIMES[::-1]])
def test_without_times_frames_are_counted_from_the_trigger(times: Any, tmp_path: Path) -> None:
    path = tmp_path / "shot.cine"
    path.write_bytes(cine_bytes(GREY, rate=5000, first=-2, times=times))
    video = gs.read_video(path)
    np.testing.assert_allclose(video.times, [-0.0004, -0.0002, 0, 0.0002], atol=1e-15)
    assert video.times_guessed.endswith("5000 frames a second")


def test_of_a_cut_file_the_whole_frames_are_there(tmp_path: Path) -> None:
    path = tmp_path / "shot.cine"
    path.write_bytes(cine_bytes(GREY)[:-1])
    video = gs.read_video(path)
    np.testing.assert_array_equal(list(video), GREY[:3])
    assert video.notes == (f"{path}: is cut off: 3 frames of 4",)


@pytest.mark.parametrize(
    ("at", "value", "message"),
    [
        (0, b"MZ", "begins with b'MZ'"),
        (4, b"\1", "frames in JPEG"),
        (48, b"\xff\xff\0\0\xff\xff\0\0", "65535 x 65535 px of 8 bits"),
        (58, b"\7", "of 7 bits"),
        (28, b"\xff\xff\xff\xff", "cut off"),
        (32, b"\xff\xff\xff\xff", "no whole frame of 4"),
        (84 + 768, bytes(4), "neither times nor a frame rate"),
    ],
)
def test_what_no_camera_writes_is_refused(
    at: int, value: bytes, message: str, tmp_path: Path
) -> None:
    data = bytearray(cine_bytes(GREY))
    data[at : at + len(value)] = value
    path = tmp_path / "shot.cine"
    path.write_bytes(data)
    with pytest.raises(InputError, match=message):
        gs.read_video(path)


def test_a_frame_whose_note_leads_elsewhere_is_none(tmp_path: Path) -> None:
    data = bytearray(cine_bytes(GREY))
    struct.pack_into("<I", data, len(data) - GREY[3].size - 8, 1 << 31)
    path = tmp_path / "shot.cine"
    path.write_bytes(data)
    video = gs.read_video(path)
    np.testing.assert_array_equal(video[2], GREY[2])
    assert len(video) == 3 and "3 frames of 4" in video.notes[0]


def test_a_file_that_is_shortened_meanwhile_is_told(tmp_path: Path) -> None:
    path = tmp_path / "shot.cine"
    path.write_bytes(cine_bytes(GREY))
    video = gs.read_video(path)
    path.write_bytes(cine_bytes(GREY)[:-9])
    with pytest.raises(InputError, match="frame 4; got 95 bytes; expected 104: the file was"):
        video[3]
