"""What became of a camera's markers is kept for the same pictures, and for these alone."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.sensor.sensor import Sensor
from gpusim.pipeline.measurements import marker_tracking
from gpusim.pipeline.measurements.marker_tracking import MarkerCache, MarkerSet, MarkerTracks

CAMERA = Camera.from_lens((36.0, 24.0), 50.0, (30, 20), (0.0, -1.0, 0.2), (0.0, 0.0, 0.1), name="a")
MARKS = MarkerSet((), 2, np.array([[0.1, 0.2, 0.3], [0.4, 0.5, 0.7]]), np.array([0.01, 0.012]),
                  ("m-1", "m-2"), ("m", "m"))  # fmt: skip
FOUND = MarkerTracks(
    expected=np.array([[1.0, 2.0], [3.5, 4.0]]),
    points=np.array([[1.1, 2.2], [np.nan, np.nan]]),
    displacement=np.array([[0.3, 0.4], [np.nan, np.nan]]), sigma=np.array([0.01, np.nan]),
    status=np.array(["OK", "NOT_FOUND"]), clipped=np.array([False, True]),
    unrefined=np.array([True, False]),
    subset=15, tracking_px=0.02,
)  # fmt: skip


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    made: list[str] = []

    class First:
        def follow(self, *_: Any) -> MarkerTracks:
            made.append("followed")
            return FOUND

    monkeypatch.setattr(marker_tracking.FirstPicture, "of", lambda *_: First())
    return made


def pictures(*later: np.ndarray) -> list[np.ndarray]:
    """The reference, and two later ones, or these."""
    before = np.arange(600, dtype=np.uint8).reshape(20, 30)
    return [before, *(later or (before.T.copy().reshape(20, 30), before[::-1].copy()))]


def ask(folder: Path, reuse: bool = True, **changed: Any) -> list[MarkerTracks]:
    given: dict[str, Any] = {"marks": MARKS, "camera": CAMERA, "pictures": pictures(),
                             "subset": None, "sensor": Sensor(8)} | changed  # fmt: skip
    markers = MarkerCache(folder, reuse)
    found = markers.track("space", **given)
    assert [file.is_file() for file in markers.files] == [True]
    return found


def test_kept_for_the_same_pictures(tmp_path: Path, calls: list[str]) -> None:
    first, again = ask(tmp_path), ask(tmp_path)
    assert len(calls) == 2 and len(first) == len(again) == 2
    for kept, read in zip(first, again, strict=True):
        for item in fields(MarkerTracks):
            one, other = getattr(kept, item.name), getattr(read, item.name)
            assert np.asarray(one).dtype == np.asarray(other).dtype
            assert np.array_equal(one, other, equal_nan=np.asarray(one).dtype == float)
    ask(tmp_path, reuse=False)
    assert len(calls) == 4


def test_a_run_writes_what_it_found_once(
    tmp_path: Path, calls: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A rig is followed ahead, while its target is photographed, and measured afterwards."""
    written: list[Path] = []
    store = marker_tracking._store
    monkeypatch.setattr(
        marker_tracking, "_store", lambda path, tracks: (written.append(path), store(path, tracks))
    )
    markers = MarkerCache(tmp_path)
    for _ in range(2):
        markers.track("space", MARKS, CAMERA, pictures(), subset=None, sensor=Sensor(8))
    assert len(written) == 1 and len(calls) == 2
    ask(tmp_path)
    assert len(written) == 1 and len(calls) == 2


def test_only_new_frames_are_followed(tmp_path: Path, calls: list[str]) -> None:
    """One more, one left out, one that shows what another does."""
    _, one, two = pictures()
    ask(tmp_path)
    assert len(ask(tmp_path, pictures=pictures(one, other_pixel(), two))) == 3
    assert len(calls) == 3
    assert len(ask(tmp_path, pictures=pictures(two, two, one))) == 3
    assert len(calls) == 3
    ask(tmp_path)
    assert len(calls) == 3


def other_pixel() -> np.ndarray:
    picture = np.arange(600, dtype=np.uint8).reshape(20, 30)
    picture[19, 29] += 1
    return picture


@pytest.mark.parametrize(
    "changed",
    [
        {"pictures": [other_pixel(), *pictures()[1:]]},
        {"pictures": pictures(*2 * [other_pixel()])},
        {"camera": replace(CAMERA, K=CAMERA.K + np.diag([0.5, 0.0, 0.0]))},
        {"camera": replace(CAMERA, distortion=np.array([0.01, 0.0, 0.0, 0.0]))},
        {"marks": replace(MARKS, size=np.array([0.01, 0.013]))},
        {"marks": replace(MARKS, names=("m-1", "m-3"))},
        {"subset": 17},
        {"sensor": Sensor(10)},
    ],
    ids=["reference", "deformed", "lens", "distortion", "size", "name", "subset", "sensor"],
)
def test_anything_else_is_followed_anew(
    tmp_path: Path, calls: list[str], changed: dict[str, Any]
) -> None:
    ask(tmp_path)
    ask(tmp_path, **changed)
    assert len(calls) in (3, 4)


def test_a_damaged_file_is_made_anew(tmp_path: Path, calls: list[str]) -> None:
    ask(tmp_path)
    (path,) = tmp_path.iterdir()
    whole = path.read_bytes()
    for content in (b"", whole[: len(whole) // 2], b"no archive at all"):
        path.write_bytes(content)
        ask(tmp_path)
    assert len(calls) == 8
