"""Videos out: what is written is what was given, whole or not there."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import GpusimError, InputError
from gpusim.export.frame_writers import ContainerWriter
from gpusim.export.video import VideoSink

RNG = np.random.default_rng(4)


def frames(shape: tuple[int, ...], most: int, count: int = 4) -> list[Any]:
    kind = np.uint8 if most < 256 else np.uint16
    return [RNG.integers(0, most + 1, shape).astype(kind) for _ in range(count)]


@pytest.mark.parametrize("name", ["film.mkv", "film.cih", "film/*.png", "film/*.tif"])
@pytest.mark.parametrize(
    ("shape", "most", "bits"),
    [((57, 33), 255, None), ((57, 33), 65535, None), ((57, 33), 4095, 12), ((57, 33, 3), 255, None),
     ((57, 33, 3), 65535, None), ((1, 1), 255, 8)],
)  # fmt: skip
def test_what_is_written_is_read_bit_for_bit(
    name: str, shape: tuple[int, ...], most: int, bits: int | None, tmp_path: Path
) -> None:
    given, times = frames(shape, most), [0.1, 0.25, 1 / 3, 0.7]
    path = gs.write_video(tmp_path / name, given, times=times, bits=bits)
    video = gs.read_video(path.parent if "*" in name else path)
    for image, expected in zip(video, given, strict=True):
        np.testing.assert_array_equal(image, expected)
        assert image.dtype == expected.dtype
    assert video.times.tolist() == times and video.notes == ()
    assert [one for one in tmp_path.rglob(".*")] == []
    again = gs.write_video(tmp_path / "again.mkv", video)
    assert gs.read_video(again).times.tolist() == times


@pytest.mark.parametrize(("name", "pixels"), [("film.mp4", "yuv420p"), ("film.gif", "bgra")])
def test_previews_show_the_upper_bits(name: str, pixels: str, tmp_path: Path) -> None:
    ramp = np.add.outer(np.arange(57) * 50, np.arange(33) * 30).astype(np.uint16)
    path = gs.write_video(tmp_path / name, [ramp, ramp // 2], frame_rate=1000.0, bits=12)
    with av.open(str(path)) as container:
        shown = [one.to_ndarray(format="gray") for one in container.decode(video=0)]
        assert container.streams.video[0].average_rate == 25
    assert len(shown) == 2
    difference = shown[0][:57, :33].astype(int) - (ramp >> 4)
    assert np.abs(difference).max() <= (0 if name == "film.gif" else 6)
    assert shown[0].shape == ((57, 33) if name == "film.gif" else (58, 34))


def test_a_film_is_the_same_bytes_each_time(tmp_path: Path) -> None:
    """Of a first time of NumPy's, too; a run that is taken up can then be compared with another."""
    given = frames((57, 33), 255)
    for name in ("one.mkv", "two.mkv"):
        with VideoSink(tmp_path / name, 100.0) as sink:
            for number, image in enumerate(given):
                sink.append(image, np.float64(number))
    assert (tmp_path / "one.mkv").read_bytes() == (tmp_path / "two.mkv").read_bytes()
    assert gs.read_video(tmp_path / "two.mkv").times.tolist() == [0.0, 1.0, 2.0, 3.0]


def test_a_sink_takes_growing_times_alone(tmp_path: Path) -> None:
    for time in (0.5, np.nan):
        with pytest.raises(InputError, match=f"frame 1; got time {time} s; expected a later"):
            with VideoSink(tmp_path / "film.mkv", 10.0) as sink:
                sink.append(np.zeros((9, 7), np.uint8), 0.5)
                sink.append(np.zeros((9, 7), np.uint8), time)
    assert list(tmp_path.iterdir()) == []


def test_frames_are_made_when_they_are_asked_for(tmp_path: Path) -> None:
    made = []

    def film() -> Any:
        for number in range(5):
            made.append(number)
            assert not (tmp_path / "film.mkv").exists()
            yield np.full((9, 7), number, np.uint8)

    gs.write_video(tmp_path / "film.mkv", film(), frame_rate=10.0)
    assert made == [0, 1, 2, 3, 4] and (tmp_path / "film.mkv").exists()


@pytest.mark.parametrize("name", ["film.mkv", "film.cih", "film.mp4"])
def test_an_error_leaves_nothing_of_a_film_and_the_old_one_as_it_was(
    name: str, tmp_path: Path
) -> None:
    path = gs.write_video(tmp_path / name, frames((8, 8), 255), frame_rate=10.0)
    before = {one.name: one.read_bytes() for one in tmp_path.iterdir()}
    with pytest.raises(RuntimeError), VideoSink(path, 10.0) as sink:
        sink.append(np.zeros((8, 8), np.uint8), 0.0)
        raise RuntimeError
    assert {one.name: one.read_bytes() for one in tmp_path.iterdir()} == before


def test_a_frame_that_comes_back_otherwise_is_seen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write = ContainerWriter.write

    def wrong(self: ContainerWriter, image: Any) -> None:
        write(self, image ^ (self.count == 2))

    monkeypatch.setattr(ContainerWriter, "write", wrong)
    given = frames((57, 33), 255)
    with pytest.raises(GpusimError, match="frame 2 isn't as it was given"):
        gs.write_video(tmp_path / "film.mkv", given, frame_rate=10.0)
    assert list(tmp_path.iterdir()) == []
    gs.write_video(tmp_path / "film.mkv", given, frame_rate=10.0, verify=False)


@pytest.mark.parametrize("name", ["film.mkv", "film.cih", "film/*.png"])
def test_a_sink_that_is_closed_stays_so(name: str, tmp_path: Path) -> None:
    with VideoSink(tmp_path / name, 10.0) as sink:
        sink.append(ONE, 0.0)
        sink.close()
    before = {one: one.read_bytes() for one in tmp_path.rglob("*.*")}
    with pytest.raises(InputError, match="frame 1; got a sink that is closed"):
        sink.append(ONE, 0.1)
    sink.close()
    assert {one: one.read_bytes() for one in tmp_path.rglob("*.*")} == before


def test_the_times_of_an_older_film_go(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Even where those of the new one can't be written."""
    path = gs.write_video(tmp_path / "film.mkv", [ONE, ONE], times=[0.0, 7.0])

    def full(*_: Any) -> None:
        raise GpusimError("the disk is full")

    monkeypatch.setattr("gpusim.export.video.write_times", full)
    with pytest.raises(GpusimError, match="full"):
        gs.write_video(path, [ONE, ONE], times=[0.0, 0.1])
    assert gs.read_video(path).times.tolist() == [0.0, 0.1]


ONE = np.zeros((9, 7), np.uint8)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"path": "film.wmv"}, r"suffix '\.wmv'; expected \.mkv, \.mp4"),
        ({"path": "film.png"}, r"got film\.png; expected \*\.png"),
        ({"path": "old/*.png"}, r"pictures in the folder: \['a\.png'\]; expected a new"),
        ({"frames": []}, "got no frame"),
        (
            {"frames": [ONE, ONE[:5]]},
            r"frame 1; got shape \(5, 7\), uint8; expected shape \(9, 7\)",
        ),
        ({"frames": [ONE, ONE.astype(np.uint16)]}, "frame 1; got .* uint16"),
        ({"frames": [ONE.astype(float)]}, "float64; expected .* uint8 or uint16"),
        ({"frames": [ONE[0]]}, r"shape \(7,\)"),
        ({"frames": [np.full((9, 7), 5000, np.uint16)], "bits": 12}, "5000; expected at most 4095"),
        ({"bits": 11}, "bits; got 11; expected one of"),
        ({"times": [0.0, 0.0], "frame_rate": None}, "times; got some that aren't after others"),
        ({"times": [0.0, np.nan]}, "times; got some that aren't after others"),
        ({"frames": gs.read_frames([ONE]), "frame_rate": None}, "expected growing times, s"),
        ({"times": [0.0]}, "times: got 1; expected 2, one a frame"),
        ({"frame_rate": None}, "neither; expected `times` or `frame_rate`"),
        ({"frame_rate": 0.0}, "frame_rate"),
    ],
)
def test_what_is_no_film_is_refused(
    change: dict[str, Any], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    gs.export.write_image("old/a.png", ONE)
    arguments = {"path": "film.mkv", "frames": [ONE, ONE], "frame_rate": 10.0} | change
    with pytest.raises(InputError, match=message):
        gs.write_video(**arguments)
    assert sorted(one.name for one in tmp_path.rglob("*")) == ["a.png", "old"]
