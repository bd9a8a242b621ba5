"""Noise estimated from a picture, or from two: against noise that is known."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from gpusim.errors import InputError
from gpusim.measure import ImageNoise
from gpusim.measure.advice.image_noise import image_noise
from tests.support.measure_images import discs

EXACT = discs(333, 257)


def exposure(noise: ImageNoise, seed: int) -> np.ndarray:
    random = np.random.default_rng(seed)
    return np.rint(EXACT + np.sqrt(noise.variance(EXACT)) * random.normal(size=EXACT.shape))


@pytest.mark.parametrize("true", [ImageNoise(4.0), ImageNoise(1.0, 0.05)])
def test_line_over_grey_values(true: ImageNoise) -> None:
    used = np.ones(EXACT.shape, dtype=bool)
    first, second = (exposure(true, seed) for seed in (1, 2))
    for still, tolerance in ((second, 0.05), (None, 0.15)):
        found = image_noise(first, still, used)
        for grey in (60.0, 200.0):
            # rounding adds a twelfth
            want = np.sqrt(true.variance(np.array(grey)) + 1 / 12)
            assert np.sqrt(found.variance(np.array(grey))) == pytest.approx(want, rel=tolerance)


def test_light_that_changes_between_stills_is_no_noise() -> None:
    used = np.ones(EXACT.shape, dtype=bool)
    first, second = (exposure(ImageNoise(4.0), seed) for seed in (1, 2))
    found = image_noise(first, second + 25.0, used)
    assert np.sqrt(found.variance(np.array(130.0))) == pytest.approx(2.02, rel=0.05)


def test_a_still_that_has_moved_is_refused() -> None:
    """As a loaded picture has, given by mistake: its motion would pass for noise."""
    used = np.ones(EXACT.shape, dtype=bool)
    first = exposure(ImageNoise(4.0), 1)
    for moved, refused in ((0.05, False), (0.3, True)):
        shift = np.array([[1.0, 0.0, 0.6 * moved], [0.0, 1.0, -0.8 * moved]])
        second = cv2.warpAffine(
            EXACT, shift, EXACT.shape[::-1], flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
        )
        if refused:
            with pytest.raises(InputError, match=r"still; got a picture moved by 0\.[23]\d* px"):
                image_noise(first, second, used)
        else:
            image_noise(first, second, used)
