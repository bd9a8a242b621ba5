"""Coded markers as our renderer shows them: numbers, corners and centres."""

from __future__ import annotations

import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError
from gpusim.measure import find_aruco
from gpusim.optics.sensor.sensor import Sensor
from gpusim.surface.fiducials import Aruco

CENTRES = np.array([[30.0, 31.0], [84.0, 43.0], [133.0, 104.0], [47.0, 99.0]])
IDS, SIZE, ANGLE = (7, 3, 21, 11), 30.0, 0.2


def photograph(bent: bool = False) -> tuple[np.ndarray, gs.Camera]:
    paint = Aruco(CENTRES, IDS, SIZE, angle=ANGLE)
    points = np.array([[0, 144, 0], [168, 144, 0], [168, 0, 0], [0, 0, 0.0]])
    frame = gs.PaintFrame(points[3], np.array([1.0, 0, 0]), np.array([0, 1.0, 0]))
    plate = gs.Surface(points, np.array([[3, 2, 1, 0]], np.int32), {"codes": paint},
                       frames={"codes": frame})  # fmt: skip
    T = np.eye(4)
    lean = np.array([[1, 0, 0], [0, np.cos(0.5), -np.sin(0.5)], [0, np.sin(0.5), np.cos(0.5)]])
    T[:3, :3] = lean @ np.diag([1.0, -1.0, -1.0])
    T[:3, 3] = np.array([3.0, -4.0, 330.0]) - T[:3, :3] @ [84.0, 72.0, 0.0]
    K = np.array([[700.0, 0, 239.5], [0, 700.0, 199.5], [0, 0, 1]])
    camera = gs.Camera(480, 400, K, [-0.6, 0.3, 2e-3, -1e-3] if bent else None, T)
    return Sensor(8, 0.95).expose(gs.render([plate], camera, backend="numpy")), camera


def true_corners(camera: gs.Camera, number: int) -> np.ndarray:
    """Upper left, upper right, lower right, lower left of the marker on its plate."""
    turn = np.array([[np.cos(ANGLE), -np.sin(ANGLE)], [np.sin(ANGLE), np.cos(ANGLE)]])
    places = np.array([[-1, 1], [1, 1], [1, -1], [-1, -1]]) * SIZE / 2 @ turn.T
    places += CENTRES[IDS.index(number)]
    return camera.project(np.column_stack([places, np.zeros(4)]))


def test_corners_behind_a_lens_that_bends_the_sides() -> None:
    """Where straight sides, fitted to bent ones, meet is up to 0.18 px from there."""
    image, camera = photograph(bent=True)
    plain = find_aruco(image, straighten=lambda pixels: pixels)
    for seen, least, most in ((find_aruco(image), 0.0, 0.01), (plain, 0.1, 1.0)):
        assert seen.number.tolist() == sorted(IDS)
        true = np.array([true_corners(camera, int(number)) for number in seen.number])
        middles = CENTRES[[IDS.index(int(number)) for number in seen.number]]
        middle = camera.project(np.column_stack([middles, np.zeros(4)]))
        error = max(np.abs(seen.corners - true).max(), np.abs(seen.centre - middle).max())
        assert least <= error <= most


def test_numbers_corners_and_centres() -> None:
    image, camera = photograph()
    rng = np.random.default_rng(1)
    noisy = np.clip(image + 2.0 * rng.normal(size=image.shape), 0, 255).round().astype(np.uint16)
    for picture, most in ((image, 0.01), (noisy * 200, 0.15)):
        seen = find_aruco(picture)
        assert seen.number.tolist() == sorted(IDS) and seen.missed == 0
        for number, corners, centre, sigma in zip(
            seen.number, seen.corners, seen.centre, seen.sigma, strict=True
        ):
            true = true_corners(camera, int(number))
            error = np.abs(corners - true).max()
            assert error <= most
            assert error <= 5 * sigma + 0.005
            middle = camera.project(np.append(CENTRES[IDS.index(int(number))], 0.0)[None])[0]
            assert np.abs(centre - middle).max() <= most
            # in perspective the mean of the corners is somewhere else
            assert np.abs(corners.mean(axis=0) - middle).max() >= 0.2


def test_nothing_and_nonsense() -> None:
    assert len(find_aruco(np.full((60, 70), 90, np.uint8))) == 0
    image, _ = photograph()
    small = image[::7, ::7]  # cells of a pixel
    assert len(find_aruco(small)) == 0
    with pytest.raises(InputError, match="dictionary"):
        find_aruco(image, "9X9")
    with pytest.raises(InputError, match="not one image"):
        find_aruco(np.zeros((20, 20, 4), np.uint8))
