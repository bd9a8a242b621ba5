"""ChArUco boards as they are rendered: every corner by its number, to thousandths of a pixel."""

from __future__ import annotations

import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError
from gpusim.measure import CharucoBoard, find_charuco
from gpusim.optics.sensor.sensor import Sensor
from gpusim.surface.fiducials import Charuco

BOARD = CharucoBoard(6, 5, 24.0, 14.0)


def photograph() -> tuple[np.ndarray, gs.Camera]:
    paint = Charuco(6, 5, 24.0, 14.0, origin=(12.0, 12.0))
    points = np.array([[0, 144, 0], [168, 144, 0], [168, 0, 0], [0, 0, 0.0]])
    frame = gs.PaintFrame(points[3], np.array([1.0, 0, 0]), np.array([0, 1.0, 0]))
    plate = gs.Surface(points, np.array([[3, 2, 1, 0]], np.int32), {"board": paint},
                       frames={"board": frame})  # fmt: skip
    K = np.array([[900.0, 0, 299.5], [0, 900.0, 249.5], [0, 0, 1]])
    T = np.eye(4)
    turn = np.array([[0.96, 0.28, 0.0], [0.28, -0.96, 0.0], [0.0, 0.0, -1.0]])
    lean = np.array([[1, 0, 0], [0, np.cos(0.3), -np.sin(0.3)], [0, np.sin(0.3), np.cos(0.3)]])
    T[:3, :3] = lean @ turn
    T[:3, 3] = np.array([3.0, -4.0, 330.0]) - T[:3, :3] @ [84.0, 72.0, 0.0]
    camera = gs.Camera(600, 500, K, camera_from_world=T)
    rendered = gs.render([plate], camera, backend="numpy")
    return Sensor(8, 0.95).expose(rendered), camera


def test_corners_are_found_by_number_and_placed_by_the_fit() -> None:
    image, camera = photograph()
    seen = find_charuco(image, BOARD)
    assert len(seen) == 20 and seen.missed == 0 and seen.resolution == (600, 500)
    # board coordinates: from the first inner corner at the upper left, y down
    world = np.column_stack([36.0 + seen.board[:, 0], 108.0 - seen.board[:, 1], 0 * seen.sigma])
    assert np.abs(seen.image - camera.project(world)).max() <= 0.02
    hidden = image.copy()
    hidden[:, :240] = 128  # half of the board
    part = find_charuco(hidden, BOARD)
    assert 4 <= len(part) < 20 and len(part) + part.missed == 20
    own = {tuple(place): point for place, point in zip(seen.board, seen.image, strict=True)}
    for place, point in zip(part.board, part.image, strict=True):
        assert np.abs(own[tuple(place)] - point).max() <= 0.02


def test_nothing_and_nonsense() -> None:
    assert find_charuco(np.full((50, 60), 9, np.uint8), BOARD).problem == "no board found"
    with pytest.raises(InputError, match="0 < marker < square"):
        CharucoBoard(6, 5, 10.0, 10.0)
    with pytest.raises(InputError, match="dictionary"):
        CharucoBoard(6, 5, 10.0, 7.0, "9X9")
