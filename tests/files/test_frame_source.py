"""Pictures as sequences: folders, files, stacks, arrays; read when asked for, and not kept."""

from __future__ import annotations

import weakref
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile

import gpusim as gs
from gpusim.errors import InputError
from gpusim.files import frame_source
from gpusim.files.frame_source import FrameSource, read_frames
from gpusim.measure import dic_sequence
from tests.support.measure_images import speckles

COUNT = 5
PICTURES = np.arange(COUNT * 13 * 7, dtype=np.uint16).reshape(COUNT, 13, 7)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Five pictures, written in another order than that of their names, beside other files."""
    for number in (3, 0, 4, 1, 2):
        gs.export.write_image(tmp_path / f"{number:04d}.png", PICTURES[number])
    (tmp_path / "exposure.json").write_text("{}")
    return tmp_path


def sources(folder: Path) -> dict[str, Any]:
    stack = folder.parent / f"{folder.name}.tif"
    tifffile.imwrite(stack, PICTURES, photometric="minisblack")
    files = [folder / f"{number:04d}.png" for number in range(COUNT)]
    return {
        "folder": folder,
        "text": str(folder),
        "files": files,
        "generator": (file for file in files),
        "stack": stack,
        "array": PICTURES,
        "arrays": list(PICTURES),
        "mixed": [files[0], PICTURES[1], f"{stack}#3", *files[3:]],
        "frames": read_frames(files),
    }


@pytest.mark.parametrize(
    "kind",
    ["array", "arrays", "files", "folder", "frames", "generator", "mixed", "stack", "text"],
)
def test_a_sequence_is_the_same_wherever_it_lies(kind: str, folder: Path) -> None:
    frames = read_frames(sources(folder)[kind], times=[0, 0.5, 1, 1.5, 4])
    assert len(frames) == len(frames.names) == COUNT
    for number, picture in enumerate(frames):
        np.testing.assert_array_equal(picture, PICTURES[number])
        assert picture.dtype == np.uint16
    np.testing.assert_array_equal(frames[-1], PICTURES[-1])
    later = frames[3:]
    assert isinstance(later, FrameSource) and len(later) == 2
    np.testing.assert_array_equal(later[1], PICTURES[4])
    assert later.times.tolist() == [1.5, 4] and later.names == frames.names[3:]
    with pytest.raises(IndexError):
        frames[COUNT]


def test_names_are_paths_and_pages(folder: Path) -> None:
    given = sources(folder)
    assert read_frames(folder).names == [str(path) for path in given["files"]]
    assert read_frames(given["stack"]).names[2] == f"{given['stack']}#3"
    assert read_frames(given["mixed"]).names[1] == "frame 1"
    assert np.isnan(read_frames(folder).times).all()


def test_of_a_runs_images_those_of_the_scene_are_taken(folder: Path) -> None:
    gs.export.write_image(folder / "calib-0000.png", PICTURES[0])
    assert [Path(name).name for name in read_frames(folder).names][-1] == "0004.png"
    (board,) = frame_source.picture_paths(folder, boards=True)
    assert board.name == "calib-0000.png"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"source": "nowhere"}, "frames: nowhere: not found"),
        ({"source": ["0000.png", "nowhere.tif#2"]}, "frames: nowhere.tif#2: not found"),
        ({"source": "empty"}, r"frames: empty: no pictures \(.png, .tif"),
        ({"source": PICTURES[0]}, r"one array of shape \(13, 7\); expected \(N, H, W\)"),
        ({"source": None}, "frames: got None; expected a file, a folder or an array"),
        ({"source": [0.5]}, "frames: got 0.5; expected a file"),
        ({"source": []}, "frames: got none; expected at least one picture"),
        ({"source": PICTURES[:0]}, "frames: got none"),
        ({"times": [1.0]}, r"times: got shape \(1,\); expected \(5,\)"),
        ({"times": "soon"}, "times; got 'soon'; expected an array of real numbers"),
    ],
)
def test_what_is_no_sequence_is_refused(
    change: dict[str, Any], message: str, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder / "empty").mkdir()
    monkeypatch.chdir(folder)
    with pytest.raises(InputError, match=message):
        read_frames(**{"source": ".", **change})


def test_files_are_read_when_their_picture_is_asked_for(folder: Path) -> None:
    frames = read_frames(folder)
    gs.export.write_image(folder / "0002.png", PICTURES[4])
    (folder / "0003.png").unlink()
    np.testing.assert_array_equal(frames[2], PICTURES[4])
    with pytest.raises(InputError, match=r"0003\.png: not found"):
        frames[3]


def test_a_series_takes_no_more_memory_than_a_few_pictures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Pictures alive at once while a series is measured; numpy's arrays count by reference."""
    alive: weakref.WeakSet[Any] = weakref.WeakSet()
    most = 0

    class Picture(np.ndarray):
        """An array whose life can be watched."""

        __hash__ = object.__hash__

    def read(path: Path) -> Any:
        nonlocal most
        picture = speckles(61, 47, shift=(0.05 * int(path.stem), 0.0)).view(Picture)
        alive.add(picture)
        most = max(most, len(alive))
        return picture

    for number in range(12):
        gs.export.write_image(tmp_path / f"{number:02d}.png", np.zeros((47, 61), np.uint8))
    monkeypatch.setattr(frame_source, "read_stored", read)
    frames = read_frames(tmp_path)
    results = dic_sequence(frames[0], frames[1:], points=[[30, 23]], backend="numpy")
    assert abs(results[-1].displacement[0, 0] - 0.55) < 0.01
    assert most <= 4  # the reference, the last one, the one that is measured


def test_pages_of_a_long_stack_are_found_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To look through all pages for each of them would take minutes for a thousand."""
    calls = 0
    parsed = tifffile.TiffPage.__init__

    def count(*args: Any, **kwargs: Any) -> None:
        nonlocal calls
        calls += 1
        parsed(*args, **kwargs)

    path = tmp_path / "stack.tif"
    tifffile.imwrite(path, np.tile(PICTURES, (8, 1, 1)), photometric="minisblack")
    monkeypatch.setattr(tifffile.TiffPage, "__init__", count)
    frames = read_frames(path)
    assert len(frames) == 40
    np.testing.assert_array_equal(list(frames), np.tile(PICTURES, (8, 1, 1)))
    assert 40 <= calls <= 4 * 40


def test_rows_keep_their_times(tmp_path: Path) -> None:
    black = np.zeros((3, 8, 9), np.uint8)
    for place in ("film.mkv", "folder/*.png"):
        path = gs.write_video(tmp_path / place, black, frame_rate=100.0, line_time=1e-5)
        film = gs.read_frames(path if path.is_file() else path.parent)
        parts = (
            gs.read_video(tmp_path / place.split("/")[0]),
            film[1:],
            gs.read_frames(film, [0, 1, 2]),
        )
        assert {one.line_time for one in (film, *parts)} == {1e-5}
    assert gs.read_frames(black).line_time == 0.0
