"""Videos in containers: every codec in any order, times, damage that is found, sizes that lie."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError
from gpusim.files import video_container
from gpusim.files.video_container import checksums_agree

COUNT = 9
RNG = np.random.default_rng(5)
WAVES = [
    np.uint8(128 + 90 * np.sin(np.arange(66) / 5 + k) * np.cos(np.arange(57) / 7 - k)[:, None])
    for k in range(COUNT)
]
NOISE = [RNG.integers(0, 4096, (57, 33)).astype(np.uint16) for _ in range(COUNT)]


def encoded(
    path: Path,
    codec: str,
    pixels: str,
    options: Mapping[str, str] = {},
    shown: Sequence[int] = range(COUNT),
    rate: int = 50,
    **container_options: str,
) -> Path:
    """A video by FFmpeg alone, its frames shown at ``shown`` / ``rate``; H.264 takes even sides."""
    rows = 57 if pixels == "gray" else 56
    with av.open(str(path), "w", options=container_options) as container:
        stream: Any = container.add_stream(codec, rate=rate, options=dict(options))
        stream.width, stream.height, stream.pix_fmt = 66, rows, pixels
        for number, wave in zip(shown, WAVES, strict=True):
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(wave[:rows]), format="gray")
            frame = frame.reformat(format=pixels)
            frame.pts = number
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


LONG = {"g": "4", "bf": "2"}
"""Groups of four frames, some of which need later ones."""


@pytest.mark.parametrize(
    ("name", "codec", "pixels", "options", "loss"),
    [
        ("film.mp4", "libx264", "yuv420p", LONG, 0.5),
        ("film.mkv", "libx264", "yuv420p", LONG, 0.5),
        ("film.mkv", "ffv1", "gray", {"g": "4"}, 0),
        ("film.mov", "png", "gray", {}, 0),
        ("film.avi", "mpeg4", "yuv420p", LONG, 0.5),
        ("film.avi", "rawvideo", "yuv420p", {}, 0.1),
    ],
)
def test_frames_are_found_in_any_order(
    name: str, codec: str, pixels: str, options: dict[str, str], loss: float, tmp_path: Path
) -> None:
    video = gs.read_video(encoded(tmp_path / name, codec, pixels, options))
    assert len(video) == COUNT
    in_order = list(video)
    for number in (4, 3, 8, 0, 5, 6, 1, 1):
        np.testing.assert_array_equal(video[number], in_order[number])
    for number, frame in enumerate(in_order):
        grey = (frame if frame.ndim == 2 else frame[..., 1]).astype(int)
        away = [np.abs(grey - wave[: len(grey)]).mean() for wave in WAVES]
        nearest, second = np.argsort(away)[:2]
        assert nearest == number and away[nearest] <= loss * away[second]
    np.testing.assert_allclose(video.times, np.arange(COUNT) / 50, atol=1e-12)
    assert bool(video.times_guessed) == (name == "film.avi")


def test_one_after_the_other_the_file_is_gone_through_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun: list[int] = []
    begin = video_container._Decoder._begin
    monkeypatch.setattr(
        video_container._Decoder, "_begin", lambda self, key: (begun.append(key), begin(self, key))
    )
    video = gs.read_video(encoded(tmp_path / "film.mkv", "libx264", "yuv420p", LONG))
    list(video)
    assert begun == [0]
    assert [video[number].shape for number in (1, 2, 6, 8)] and begun == [0, 0, 4, 8]


def test_threads_may_read_at_once(tmp_path: Path) -> None:
    video = gs.read_video(gs.write_video(tmp_path / "film.mkv", NOISE, frame_rate=100.0))
    wrong = []

    def read(seed: int) -> None:
        for number in np.random.default_rng(seed).permutation(COUNT):
            if (video[int(number)] != NOISE[number]).any():
                wrong.append(number)

    threads = [threading.Thread(target=read, args=(seed,)) for seed in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert wrong == []


def test_a_flipped_bit_is_found_by_its_checksum(tmp_path: Path) -> None:
    """FFmpeg decodes it to other pixels without a word."""
    path = gs.write_video(tmp_path / "film.mkv", NOISE, frame_rate=100.0)
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 16
    path.write_bytes(data)
    video = gs.read_video(path)
    assert "1 frames are damaged: 5" in video.notes[0]
    with pytest.raises(InputError, match="frame 5: damaged; got ValueError: another checksum"):
        video[4]
    whole = [k for k in range(COUNT) if k != 4]
    np.testing.assert_array_equal([video[k] for k in whole], [NOISE[k] for k in whole])


def test_checksums_are_those_of_the_bits_as_they_are_sent(tmp_path: Path) -> None:
    path = gs.write_video(tmp_path / "film.mkv", NOISE, frame_rate=100.0)
    with av.open(str(path)) as container:
        packets = [bytes(one) for one in container.demux(video=0) if one.size]
    assert all(map(checksums_agree, packets))
    for at in (0, 100, len(packets[0]) - 1):
        wrong = bytearray(packets[0])
        wrong[at] ^= 1
        assert not checksums_agree(bytes(wrong))
    plain = encoded(tmp_path / "plain.mkv", "ffv1", "gray", {"level": "3", "slicecrc": "0"})
    video = gs.read_video(plain)  # has none
    assert video.notes == () and (video[3] == WAVES[3]).all()


def test_of_a_cut_file_the_whole_frames_are_there(tmp_path: Path) -> None:
    path = gs.write_video(tmp_path / "film.mkv", NOISE, frame_rate=100.0)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    video = gs.read_video(path)
    assert 2 < len(video) < 6 and f"{len(video)} frames of 9" in video.notes[0]
    np.testing.assert_array_equal(list(video), NOISE[: len(video)])


def test_a_lost_frame_moves_no_others_time(tmp_path: Path) -> None:
    path = gs.write_video(tmp_path / "film.mkv", NOISE, times=1.0 + np.arange(COUNT) / 100)
    with av.open(str(path)) as container:
        packets = [bytes(one) for one in container.demux(video=0) if one.size]
    data = bytearray(path.read_bytes())
    block = data.find(packets[3]) - 4  # its track, time and flags
    data[block] ^= 2  # of another track
    path.write_bytes(data)
    for _ in range(2):
        video = gs.read_video(path)
        kept = [k for k in range(COUNT) if k != 3]
        np.testing.assert_array_equal(list(video), [NOISE[k] for k in kept])
        np.testing.assert_allclose(video.times, 1.0 + np.array(kept) / 100, atol=1e-12)
        assert "8 frames of 9" in video.notes[0]
        (tmp_path / "film.times.csv").unlink(missing_ok=True)


def test_times_are_those_of_the_camera_where_a_film_is_slowed(tmp_path: Path) -> None:
    path = gs.write_video(tmp_path / "film.mkv", NOISE, times=3.0 + np.arange(COUNT) / 20000)
    (tmp_path / "film.times.csv").unlink()
    video = gs.read_video(path)
    np.testing.assert_allclose(video.times, 3.0 + np.arange(COUNT) / 20000, atol=1e-12)
    with av.open(str(path)) as container:
        assert container.streams.video[0].average_rate == 25


@pytest.mark.parametrize("shown", [range(COUNT), [0, 1, 4, 5, 8, 9, 12, 13, 16]])
def test_milliseconds_of_a_steady_film_are_no_jitter(shown: Any, tmp_path: Path) -> None:
    video = gs.read_video(encoded(tmp_path / "film.mkv", "ffv1", "gray", shown=shown, rate=60))
    atol = 1e-12 if shown == range(COUNT) else 0.0006
    np.testing.assert_allclose(video.times, np.array(shown) / 60, atol=atol)
    assert video.notes == ()


def test_a_frame_that_an_avi_leaves_out_moves_no_others_time(tmp_path: Path) -> None:
    shown = [0, 1, 2, 4, 5, 6, 7, 8, 9]
    video = gs.read_video(encoded(tmp_path / "film.avi", "ffv1", "gray", shown=shown))
    np.testing.assert_allclose(video.times, np.array(shown) / 50, atol=1e-12)
    np.testing.assert_array_equal(list(video), WAVES)
    assert video.times_guessed.endswith("50 frames a second")


def muxed(path: Path, codec: str, width: int, height: int, data: bytes) -> Path:
    """A container around three frames that say what they like."""
    with av.open(str(path), "w") as container:
        stream = container.add_mux_stream(codec, rate=25, width=width, height=height)
        for number in range(3):
            packet = av.Packet(data)
            packet.stream, packet.time_base = stream, Fraction(1, 25)
            packet.pts = packet.dts = number
            packet.is_keyframe = True
            container.mux(packet)
    return path


@pytest.mark.parametrize(
    ("name", "codec"), [("film.mkv", "ffv1"), ("film.avi", "rawvideo"), ("film.mkv", "mjpeg")]
)
def test_a_size_of_which_no_memory_is_asked_for(name: str, codec: str, tmp_path: Path) -> None:
    path = muxed(tmp_path / name, codec, 65535, 65535, b"\x10" * 999)
    with pytest.raises(InputError, match=f"video: {path}"):
        gs.read_video(path)[0]


@pytest.mark.parametrize(
    ("name", "table", "place"), [("film.mov", b"stsz", 12), ("film.mp4", b"trun", 8)]
)
def test_a_table_of_more_frames_than_bytes_is_refused(
    name: str, table: bytes, place: int, tmp_path: Path
) -> None:
    """FFmpeg would make 24 bytes of each of them."""
    options = {"movflags": "frag_keyframe+empty_moov"} if table == b"trun" else {}
    path = encoded(tmp_path / name, "png", "gray", **options)
    assert len(gs.read_video(path)) == COUNT
    data = bytearray(path.read_bytes())
    at = data.find(table) + place
    data[at : at + 4] = b"\x01\0\0\0"
    path.write_bytes(data)
    with pytest.raises(InputError, match="16777216 frames; expected fewer than bytes"):
        gs.read_video(path)


@pytest.mark.parametrize(
    "text", ["", "no film", "#EXTM3U\n#EXTINF:9,\nfile:///etc/passwd\n", "ffconcat version 1.0\n"]
)
def test_what_is_no_film_is_refused(text: str, tmp_path: Path) -> None:
    path = tmp_path / "film.mp4"
    path.write_text(text)
    with pytest.raises(InputError, match="can't be read as a video"):
        gs.read_video(path)


def test_a_film_of_sound_alone_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "film.mkv"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("pcm_s16le", rate=8000, layout="mono")
        sound = av.AudioFrame.from_ndarray(np.zeros((1, 800), np.int16), layout="mono")
        sound.rate = 8000
        container.mux(stream.encode(sound))
        container.mux(stream.encode())
    with pytest.raises(InputError, match="got no pictures"):
        gs.read_video(path)
