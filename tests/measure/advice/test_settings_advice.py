"""Settings advised: as good as the best of a grid; what pictures and arguments are refused."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import pytest

from gpusim.errors import InputError
from gpusim.gpu import Device
from gpusim.measure import Advice, ImageNoise, advise
from gpusim.measure.advice import settings_advice
from gpusim.measure.advice.pattern_trial import PatternTrial
from tests.support.measure_images import Waves


def exposure(seed: int, noise: float = 5.0, size: tuple[int, int] = (300, 340)) -> np.ndarray:
    y, x = np.indices(size, dtype=np.float64)
    grey = Waves(seed=4).at(x, y) + noise * np.random.default_rng(seed).normal(size=size)
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def advice() -> Advice:
    return advise(exposure(1), still=exposure(2), detail_px=80.0, peak_strain=0.004)


def test_the_choice_is_within_a_tenth_of_the_best_of_a_grid(advice: Advice, device: Device) -> None:
    """Every setting measured by motions of the pattern, with noise that the advice didn't see."""
    y, x = np.indices((300, 340), dtype=np.float64)
    exact, shape = Waves(seed=4).at(x, y), (300, 340)
    jury = PatternTrial(exact, np.ones(shape, bool), ImageNoise(25.0), advice.motion, device)

    def error(subset: int, shape: str, blur: float, step: int, window: int) -> float:
        parts = [
            jury.errors(step, window, seed, subset=subset, shape=shape, blur_px=blur,
                        apart_px=np.inf, tolerance=1e-3).strain
            for seed in (11, 12)
        ]  # fmt: skip
        return float(np.sqrt(np.mean([part.total**2 for part in parts])))

    grid = product((29, 39, 53, 71), ("affine", "quadratic"), (0.0, 0.7), (3, 7))
    best = min(error(m, s, b, round(m / 6), w) for m, s, b, w in grid)
    chosen = advice.chosen
    assert error(*chosen.matching, chosen.step, chosen.strain_window) <= 1.1 * best


def test_what_is_said_of_the_picture(advice: Advice) -> None:
    assert advice.pattern.noise == pytest.approx(5.0, rel=0.05)
    assert advice.pattern.slope == pytest.approx(np.sqrt(Waves(seed=4).gradient_square()), rel=0.05)
    assert 3.0 <= advice.pattern.speckle_px <= 6.0
    assert advice.pattern.flat == 0.0
    assert advice.pattern.saturated == (exposure(1) == 255).mean()
    assert advice.check.strain.total == pytest.approx(advice.chosen.strain.total, rel=0.3)
    assert len(advice.trials) < 12


def test_less_noise_calls_for_smaller_gauges_and_less_detail_for_larger_ones() -> None:
    def gauge(noise: float, detail: float) -> int:
        known, picture = ImageNoise(noise**2), exposure(1, noise)
        one = advise(picture, noise=known, detail_px=detail, peak_strain=0.004).chosen
        return one.subset + one.step * (one.strain_window - 1)

    assert gauge(1.0, 80.0) < gauge(8.0, 80.0) < gauge(8.0, 160.0)


def test_backgrounds_are_left_out() -> None:
    picture = exposure(1, size=(150, 260))
    picture[:, 130:] = 90
    advice = advise(picture, detail_px=80.0, noise=ImageNoise(25.0))
    assert advice.pattern.flat == pytest.approx(0.45, abs=0.07)
    assert any("no texture" in text for text in advice.pattern.warnings)
    mask = np.zeros(picture.shape, dtype=bool)
    mask[:, :120] = True
    masked = advise(picture, detail_px=80.0, noise=ImageNoise(25.0), mask=mask)
    assert masked.pattern.flat <= 0.01


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"roi": (0, 0, 80, 200)}, "roi: holds no subset"),
        ({"still": np.zeros((9, 9), np.uint8)}, "still"),
        ({"mask": np.zeros((300, 340), bool)}, "no texture"),
        ({"detail_px": 0.0}, "detail_px"),
        ({"peak_strain": np.nan}, "peak_strain"),
        ({"noise": np.nan}, "advise noise; got nan"),
        ({"noise": "x"}, "advise noise; got 'x'"),
    ],
)
def test_wrong_arguments(options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        advise(exposure(1), **options)


def test_a_picture_without_texture() -> None:
    with pytest.raises(InputError, match="no texture"):
        advise(np.full((200, 200), 90, np.uint8))


def test_the_search_measures_the_setting_that_it_chooses(advice: Advice) -> None:
    assert advice.chosen.matching in advice.trials
    least = min(one.strain.total for one in advice.table)
    assert advice.chosen.strain.total <= settings_advice.CHEAPER * least


@pytest.mark.parametrize("whole", [True, False])
def test_pictures_without_noise(whole: bool) -> None:
    """They have that of their grey levels."""
    y, x = np.indices((150, 170), dtype=np.float64)
    picture = Waves(seed=4).at(x, y)
    found = advise(
        np.rint(picture).astype(np.uint8) if whole else picture, noise=ImageNoise(0.0),
        detail_px=80.0,
    )  # fmt: skip
    assert 0.0 < found.check.strain.total < 1e-3


def test_known_noise_may_be_a_number_of_grey_levels() -> None:
    found = advise(exposure(1, size=(130, 150)), noise=5.0, detail_px=80.0)
    assert found.noise == ImageNoise(25.0)
