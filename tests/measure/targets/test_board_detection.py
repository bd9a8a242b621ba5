"""Corners of chessboards: how exact, which is which, and what is left out."""

from __future__ import annotations

import time

import cv2
import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError
from gpusim.measure import Chessboard, find_chessboard, fit_crossings, target_statistics
from tests.support.measure_images import Marker, blurred_board, board
from tests.support.target_images import board_poses, board_surface, places_in_world

BOARD = Chessboard(9, 8, 40.0)


def crossings() -> tuple[list[Marker], np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(4)
    markers = [
        Marker(35 + 50 * i + rng.uniform(), 35 + 50 * j + rng.uniform(), 40, 40,
               np.radians(rng.uniform(-80, 80)))
        for j in range(2) for i in range(3)
    ]  # fmt: skip
    places = np.array([[m.x, m.y] for m in markers])
    first = np.array([[20 * np.cos(m.angle), 20 * np.sin(m.angle)] for m in markers])
    return markers, places, first, np.stack([-first[:, 1], first[:, 0]], axis=1)


@pytest.mark.parametrize("sigma", [0.0, 0.7])
def test_perfect_corners_are_located_to_a_ten_thousandth(sigma: float) -> None:
    markers, places, first, second = crossings()
    image = board(170, 120, markers) if sigma == 0 else blurred_board(170, 120, markers, sigma)
    away = np.random.default_rng(5).uniform(-1.5, 1.5, places.shape)
    found = fit_crossings(image, places + away, first, second)
    assert found.ok.all()
    assert np.abs(found.points - places).max() <= 1e-4  # measured: 4e-6 and 2e-5
    assert np.abs(found.blur - sigma).max() <= 0.01
    assert (found.contrast > 0).all()  # the quadrant between both directions is white


def test_stated_uncertainty_is_that_of_the_noise() -> None:
    markers, places, first, second = crossings()
    clean = blurred_board(170, 120, markers, 0.7)
    rng, scores = np.random.default_rng(6), []
    for _ in range(12):
        found = fit_crossings(clean + rng.normal(0, 3, clean.shape), places, first, second)
        scores.append((found.points - places) / found.sigma[:, None])
    assert 0.8 <= np.sqrt(np.mean(np.square(scores))) <= 1.2


def test_nothing_to_fit_is_nan() -> None:
    _, places, first, second = crossings()
    rng = np.random.default_rng(7)
    for image in (np.full((120, 170), 9.0), rng.uniform(0, 255, (120, 170))):
        found = fit_crossings(image, places, first, second)
        assert not found.ok.any() and np.isnan(found.points).all()


@pytest.fixture(scope="module")
def picture() -> tuple[np.ndarray, gs.Camera, np.ndarray]:
    camera = gs.Camera.from_lens((36, 24), 30, (900, 600), (0, -700, 0), (20, 0, 5))
    pose = board_poses(1, np.array([10.0, 0.0, -5.0]), 8, 5.0)[0]
    frame = gs.render([board_surface(BOARD, pose)], camera, background=0.3, backend="numpy")
    return frame.radiance, camera, pose


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("depth", [8, 16])
def test_every_corner_is_known_by_its_place(
    picture: tuple[np.ndarray, gs.Camera, np.ndarray], turned: bool, depth: int
) -> None:
    """Also upside down: the dark field tells."""
    radiance, camera, pose = picture
    kind = np.uint8 if depth == 8 else np.uint16
    image = np.rint(radiance * (2**depth - 1)).astype(kind)
    seen = find_chessboard(image[::-1, ::-1] if turned else image, BOARD)
    assert len(seen) == 56 and seen.missed == 0 and seen.problem == ""
    expected = camera.project(places_in_world(BOARD, seen.board, pose))
    if turned:
        expected = np.array([899, 599]) - expected
    assert np.abs(seen.image - expected).max() <= 0.004  # measured: 0.0015 px in 8 bit


def test_covered_corners_are_left_out(
    picture: tuple[np.ndarray, gs.Camera, np.ndarray],
) -> None:
    radiance, camera, pose = picture
    image = np.rint(radiance * 255).astype(np.uint8)
    whole = find_chessboard(image, BOARD)
    x, y = np.rint(whole.image[10]).astype(int)
    image[y - 7 : y + 8, x - 7 : x + 8] = 128
    seen = find_chessboard(image, BOARD)
    assert 50 <= len(seen) <= 55 and seen.missed == 56 - len(seen)
    assert np.linalg.norm(seen.image - whole.image[10], axis=1).min() >= 20
    expected = camera.project(places_in_world(BOARD, seen.board, pose))
    assert np.abs(seen.image - expected).max() <= 0.05


def test_images_without_the_board_say_so() -> None:
    rng = np.random.default_rng(9)
    empty = find_chessboard(rng.integers(0, 255, (120, 160), dtype=np.uint8), BOARD)
    assert len(empty) == 0 and empty.problem == "no board found" and empty.missed == 56
    statistics = target_statistics([empty, empty])
    assert statistics.found == 0 and statistics.problems == {"no board found": 2}
    with pytest.raises(InputError, match="columns; got 3"):
        Chessboard(3, 8, 40.0)
    with pytest.raises(InputError, match="no sightings"):
        target_statistics([])


def test_a_board_that_is_cut_off_is_given_up_soon() -> None:
    """Equalised noise on large fields makes thousands of quads: it took half a minute."""
    rng = np.random.default_rng(4)
    fields = np.indices((8, 9)).sum(axis=0) % 2
    image = np.kron(20.0 + 200.0 * fields, np.ones((300, 300)))[200:2248, 100:2548]
    noisy = np.rint(image + rng.normal(0.0, 2.0, image.shape)).astype(np.uint8)
    before = time.process_time()
    seen = find_chessboard(noisy, Chessboard(12, 9, 40.0))
    assert seen.problem == "no board found"
    assert time.process_time() - before < 10.0  # measured: 3 s


def test_small_fields_of_a_large_noisy_picture_are_still_found(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """By the quad detector alone, which gets it smoothed."""
    monkeypatch.setattr(cv2, "findChessboardCornersSB", lambda *_, **__: (False, None))
    rng = np.random.default_rng(4)
    fields = 30.0 + 190.0 * (np.indices((7, 8)).sum(axis=0) % 2)
    image = np.full((1100, 1300), 220.0)
    image[500:598, 600:712] = np.kron(fields, np.ones((14, 14)))
    image = cv2.GaussianBlur(image, (0, 0), 0.6) + rng.normal(0.0, 4.0, image.shape)
    noisy = np.clip(np.rint(image), 0, 255).astype(np.uint8)
    assert len(find_chessboard(noisy, Chessboard(8, 7, 40.0))) == 42
