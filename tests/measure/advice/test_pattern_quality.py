"""What is said of a pattern: sizes that are known, parts with texture."""

from __future__ import annotations

import numpy as np
import pytest

from gpusim.measure import ImageNoise
from gpusim.measure.advice.pattern_quality import (
    PatternQuality,
    pattern_quality,
    richest_part,
    textured_pixels,
)
from gpusim.measure.advice.pattern_trial import PatternTrial
from gpusim.measure.advice.synthetic_motion import WaveMotion
from tests.support.measure_images import speckles


def test_speckle_size_of_gaussian_speckles() -> None:
    """Gaussians of sigma have an autocorrelation of sigma sqrt(2), pixels widen it a little."""
    picture = speckles(331, 283, sigma=2.0)
    used = np.ones(picture.shape, bool)
    trial = PatternTrial(picture, used, ImageNoise(0.0), WaveMotion(picture.shape, 80, 0.001), None)
    sigma = np.hypot(2.0, np.sqrt(1 / 12))
    want = 2.0 * np.sqrt(2.0 * np.log(2.0)) * np.sqrt(2.0) * sigma
    found = pattern_quality(np.minimum(picture, 255).astype(np.uint8), used, used, trial)
    assert found.speckle_px == pytest.approx(want, rel=0.1)


def test_the_part_with_most_texture() -> None:
    picture = np.full((200, 301), 80.0)
    picture[60:190, 140:290] = speckles(150, 130)
    textured = textured_pixels(picture, np.ones(picture.shape, bool))
    assert textured[100, 200] and not textured[30, 60]
    rows, columns = richest_part(textured, 120)
    assert textured[rows, columns].mean() > 0.97
    assert richest_part(textured, 1000) == (slice(0, 200), slice(0, 301))


def test_warnings_name_what_is_wrong() -> None:
    good = PatternQuality(4.0, 25.0, 2.0, 0.0, 0.0)
    assert good.warnings == []
    poor = PatternQuality(2.0, 25.0, 9.0, 0.3, 0.05)
    assert [text.split()[0] for text in poor.warnings] == ["speckles", "5.0%", "30%", "the"]
