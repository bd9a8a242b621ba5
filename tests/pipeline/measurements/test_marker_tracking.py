"""Markers followed between pictures: what is remembered, and what is said of poor fits."""

from __future__ import annotations

import numpy as np
import pytest

from gpusim import measure
from gpusim.measure.structures import marker_crosses
from gpusim.optics import Camera, Sensor
from gpusim.pipeline.measurements.marker_measurement import MarkerResult
from gpusim.pipeline.measurements.marker_set import MarkerSet
from gpusim.pipeline.measurements.marker_tracking import FirstPicture, MarkerTracks
from gpusim.pipeline.measurements.results import PointTable
from tests.support.measure_images import Marker, board

WIDTH, HEIGHT, SIZE = 420, 90, 22.0
PLACES = np.array([[45.3 + 66 * i, 44.2 + 0.7 * i] for i in range(6)])


def camera() -> Camera:
    """1 mm in the plane z = 1 m is 1 px, from the first pixel's centre."""
    K = np.array([[1000.0, 0.0, 0.0], [0.0, 1000.0, 0.0], [0.0, 0.0, 1.0]])
    return Camera(width=WIDTH, height=HEIGHT, K=K, camera_from_world=np.eye(4), name="front")


def marker_set() -> MarkerSet:
    count = len(PLACES)
    position = np.column_stack([1e-3 * PLACES, np.ones(count)])
    names = tuple(f"m-{i}" for i in range(count))
    return MarkerSet((), count, position, np.full(count, 1e-3 * SIZE), names, ("axis",) * count)


def picture(moved: np.ndarray, degrees: float = 0.0) -> np.ndarray:
    markers = [Marker(x, y, SIZE, SIZE, np.radians(degrees)) for x, y in PLACES + moved]
    return np.rint(board(WIDTH, HEIGHT, markers)).astype(np.uint8)


def follow(reference: np.ndarray, deformed: np.ndarray) -> MarkerTracks:
    first = FirstPicture.of("measure 'line'", marker_set(), camera(), reference, Sensor(8))
    return first.follow(deformed)


def test_markers_are_followed() -> None:
    motion = np.column_stack([0.2 * np.arange(6), 0.55 * np.arange(6) ** 1.5])
    seen = follow(picture(np.zeros(2)), picture(motion, 2.0))
    assert np.abs(seen.points - PLACES).max() <= 0.003
    assert np.abs(seen.displacement - motion).max() <= 0.004
    assert (seen.status == "OK").all() and not seen.unrefined.any()


def test_the_first_picture_is_searched_once(monkeypatch: pytest.MonkeyPatch) -> None:
    looked: list[int] = []
    locate = measure.locate_markers

    def counted(image: np.ndarray, near: np.ndarray, *rest: object) -> measure.Markers:
        looked.append(len(near))
        return locate(image, near, *rest)

    for module in (measure, marker_crosses):
        monkeypatch.setattr(module, "locate_markers", counted)
    motions = [np.array([0.7 * k, -0.4 * k]) for k in range(4)]
    pictures = [picture(motion) for motion in motions]
    first = FirstPicture.of("measure 'line'", marker_set(), camera(), pictures[0], Sensor(8))
    tracks = [first.follow(one) for one in pictures[1:]]
    assert looked == [6]
    for seen, motion in zip(tracks, motions[1:], strict=True):
        assert np.abs(seen.displacement - motion).max() <= 0.004


def test_a_marker_without_a_fit_of_its_cross_is_named() -> None:
    """A blot over the middle of one: correlation still finds it, the two borders are gone."""
    reference, deformed = picture(np.zeros(2)), picture(np.array([1.25, 0.5]))
    x, y = (np.rint(PLACES[3] + [1.25, 0.5])).astype(int)
    rows, columns = np.indices(deformed.shape)
    blot = np.hypot(columns - x, rows - y) < 5.5
    seen = follow(reference, np.where(blot, 120, deformed).astype(np.uint8))
    assert (seen.status == "OK").all()
    status = seen.status[None]
    for unrefined, named in ((seen.unrefined, "m-3"), (np.zeros(6, dtype=bool), "")):
        columns = {"status": status, "saturated": seen.clipped[None], "unrefined": unrefined[None]}
        result = MarkerResult("line", PointTable("marker", (1,), marker_set().names, columns))
        assert result.named("unrefined") == named
        assert [text.partition(": by")[0] for text in result.warnings] == len(named[:1]) * [
            "measure 'line'"
        ]
