"""What trials measure: noise as theory says, losses of waves, points without texture."""

from __future__ import annotations

import numpy as np
import pytest

from gpusim.gpu import Device
from gpusim.measure import ImageNoise, gauge_filter
from gpusim.measure.advice.pattern_trial import PatternTrial
from gpusim.measure.advice.synthetic_motion import WaveMotion
from tests.support.measure_images import Waves


def trial(device: Device, noise: float, used: np.ndarray | None = None) -> PatternTrial:
    y, x = np.indices((260, 300), dtype=np.float64)
    picture = Waves(seed=3).at(x, y)
    motion = WaveMotion((260, 300), 150.0, 0.002)
    used = np.ones(picture.shape, dtype=bool) if used is None else used
    return PatternTrial(picture, used, ImageNoise(noise**2), motion, device)


def test_slopes_and_noise_are_those_of_the_pattern(device: Device) -> None:
    one = trial(device, 2.0)
    assert one.slope == pytest.approx(np.sqrt(Waves(seed=3).gradient_square()), rel=0.05)
    assert one.noise_level == pytest.approx(2.0)
    # a blur lowers slopes by more than noise
    assert one.pixel_uncertainty(0.0) < one.pixel_uncertainty(0.7) < one.pixel_uncertainty(1.4)


def test_noise_and_loss_are_those_of_the_filter(device: Device) -> None:
    one = trial(device, 1.5)
    found = one.errors(6, 3, seed=1, subset=35, shape="affine")
    alone, gauge = gauge_filter(35), gauge_filter(35, "affine", 6, 3)
    unit = one.pixel_uncertainty()
    assert found.displacement.noise == pytest.approx(unit * alone.noise, rel=0.25)
    assert found.strain.noise == pytest.approx(unit * gauge.noise, rel=0.35)
    assert found.displacement.loss == pytest.approx(1.0 - alone.response(150.0), abs=0.03)
    assert found.strain.loss == pytest.approx(1.0 - gauge.response(150.0), abs=0.03)
    wave = 0.002 / np.sqrt(2.0)
    want = np.hypot(found.strain.noise, found.strain.loss * wave)
    assert found.strain.total == pytest.approx(want)
    assert found.measured == 1.0


def test_interpolation_errs_little_without_noise(device: Device) -> None:
    found = trial(device, 0.0).errors(9, 3, seed=1, subset=25, shape="quadratic")
    assert found.bias_px <= 3e-4
    assert found.displacement.noise <= 2e-3


def test_masked_points_arent_lost(device: Device) -> None:
    used = np.ones((260, 300), dtype=bool)
    used[:, :120] = False
    assert (
        trial(device, 1.0, used)
        .errors(9, 3, seed=1, subset=25, shape="affine", apart_px=np.inf)
        .measured
        == 1.0
    )
