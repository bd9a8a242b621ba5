"""Pictures as strangers bring them: patterns that repeat or go one way, noise on plain grounds."""

from __future__ import annotations

import numpy as np

from gpusim.measure import Status, dic
from gpusim.measure.correlation.start_values import search_template
from tests.support.measure_images import Waves

Images = tuple[np.ndarray, np.ndarray]


def pair(pattern: object, motion: tuple[float, float], noise: float) -> Images:
    """(110, 150) uint8, before and after a shift of a pattern of grey values 0..255 at x, y."""
    y, x = np.indices((110, 150), dtype=np.float64)
    rng = np.random.default_rng(8)
    images = []
    for u, v in ((0.0, 0.0), motion):
        grey = pattern(x - u, y - v) + noise * rng.normal(size=x.shape)  # type: ignore[operator]
        images.append(np.clip(np.rint(grey), 0, 255).astype(np.uint8))
    return images[0], images[1]


def test_of_a_pattern_that_repeats_the_nearest_match_is_taken() -> None:
    def grid(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.asarray(128 + 45 * (np.sin(2 * np.pi * x / 9.7) + np.sin(2 * np.pi * y / 11.3)))

    motion = (1.4, -2.3)
    result = dic(*pair(grid, motion, 2.0), subset=31, step=12)
    assert result.ok.mean() >= 0.8
    assert np.abs(result.displacement[result.ok] - motion).max() <= 0.05


def test_peaks_are_compared_by_their_heights_between_pixels() -> None:
    """12 px on, the period is whole and the peak looks 4 % higher than the one at 0.5 px."""

    def pattern(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.asarray(np.sin(2 * np.pi * (x - 0.5) / 11.5) + np.sin(2 * np.pi * y / 9.0))

    y, x = np.indices((81, 81), dtype=np.float64)
    template = pattern(x[25:56, 25:56] + 0.5, y[25:56, 25:56])
    column, row, _ = search_template(template, pattern(x, y), (40, 40), 20)
    assert abs(column - 40) <= 1 and row == 40


def test_noise_on_stripes_does_not_tell_the_way_along_them() -> None:
    def stripes(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.asarray(128 + 80 * np.sin(0.4 * x + 0.5 * y))

    result = dic(*pair(stripes, (0.4, -0.3), 3.0), subset=31, step=12)
    assert not result.ok.any()
    assert (result.status == Status.NO_TEXTURE).mean() >= 0.5
    crossed = Waves(5)
    found = dic(*pair(crossed.at, (0.4, -0.3), 12.0), subset=31, step=12)
    assert (found.status != Status.NO_TEXTURE).all() and found.ok.mean() >= 0.8


def test_noise_on_a_plain_ground_is_no_texture() -> None:
    """A hole: subsets in it see a sliver of the body and noise; they were off by up to 0.6 px."""
    motion, waves = (3.4, -1.2), Waves(3)

    def body(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        inside = 0.5 + 0.5 * np.tanh((np.hypot(x - 75, y - 55) - 22) / 0.7)
        return np.asarray(60 + (waves.at(x, y) - 60) * inside)

    result = dic(*pair(body, motion, 8.0), subset=31, step=5)
    away = np.hypot(*(result.points - [75, 55]).T)
    assert (result.status[away < 8] != Status.OK).all()
    inside = (result.points[:, 0] < 128) & (result.points[:, 1] > 18)
    assert result.ok[(away > 32) & inside].mean() >= 0.95
    assert np.abs(result.displacement[result.ok] - motion).max() <= 0.2


def test_what_left_the_picture_is_outside() -> None:
    motion = (60.3, -20.6)
    result = dic(*pair(Waves(4).at, motion, 2.0), subset=21, step=6)
    gone = (result.points[:, 0] + motion[0] > 141) | (result.points[:, 1] + motion[1] < 8)
    assert (result.status[gone] == Status.OUTSIDE).mean() >= 0.98
    assert result.ok[~gone].mean() >= 0.8
    assert np.abs(result.displacement[result.ok] - motion).max() <= 0.05
