"""Motion of a pattern by phases: against a pattern that is known between its pixels."""

from __future__ import annotations

import numpy as np

from gpusim.measure import ImageNoise
from gpusim.measure.advice.synthetic_motion import TAPER, WaveMotion, exposed, noise_free_pattern
from tests.support.measure_images import Waves

SIZE = 96, 131


def periodic(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Waves of whole numbers of periods in the picture, which fade at its borders."""
    height, width = SIZE
    rng = np.random.default_rng(5)
    total = np.zeros(x.shape)
    for _ in range(30):
        i, j, phase = rng.integers(-36, 37), rng.integers(-26, 27), rng.uniform(0, 6.3)
        total += 5.0 * np.sin(2 * np.pi * (i * x / width + j * y / height) + phase)
    fade = np.sin(np.pi * (x + 0.5) / width) * np.sin(np.pi * (y + 0.5) / height)
    return 100.0 + total * fade**8


def test_a_pattern_is_moved_exactly() -> None:
    motion = WaveMotion(SIZE, 37.0, 0.02)
    y, x = np.indices(SIZE, dtype=np.float64)
    moved = motion.moved(periodic(x, y))
    # what is seen at each pixel came from the point that the displacement takes there
    rng = np.random.default_rng(6)
    places = rng.uniform((5, 5), (SIZE[1] - 6, SIZE[0] - 6), (50, 2)).round()
    points = places.copy()
    for _ in range(100):
        points = places - motion.at(points)[0]
    seen = moved[places[:, 1].astype(int), places[:, 0].astype(int)]
    assert np.abs(seen - periodic(*points.T)).max() <= 1e-4
    assert np.abs(motion.at(points)[0]).max() > 0.4


def test_slopes_are_those_of_the_waves() -> None:
    motion, h = WaveMotion(SIZE, 37.0, 0.02), 1e-5
    points = np.random.default_rng(7).uniform(20, 70, (40, 2))
    waves, slopes = motion.at(points)[1:]
    by_y = (motion.at(points + np.array([0, h]))[1] - waves)[:, 0] / h
    assert np.abs(slopes[:, 0] - by_y).max() <= 1e-6
    assert np.abs(slopes).max() <= 0.02


def test_pattern_has_the_slopes_that_there_are_without_noise() -> None:
    y, x = np.indices((300, 280), dtype=np.float64)
    exact, random = Waves(seed=2).at(x, y), np.random.default_rng(8)
    noise = ImageNoise(36.0)
    pattern = noise_free_pattern(exposed(exact, noise, exact, random), noise)
    inner = (slice(TAPER, -TAPER),) * 2
    energies = [np.square(np.gradient(one, axis=1))[inner].mean() for one in (pattern, exact)]
    assert abs(energies[0] / energies[1] - 1.0) <= 0.01
    assert np.std((pattern - exact)[inner]) < 6.0


def test_exposures_have_the_grey_levels_of_the_picture() -> None:
    like, random = np.full((64, 64), 200, np.uint8), np.random.default_rng(9)
    picture = exposed(np.full((64, 64), 198.0), ImageNoise(9.0), like, random)
    assert picture.dtype == np.uint8
    assert picture.max() == 200
