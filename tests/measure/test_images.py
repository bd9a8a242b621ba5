"""The quintic spline against closed forms that it didn't make itself."""

from __future__ import annotations

import numpy as np
import pytest

from gpusim.errors import InputError
from gpusim.measure import SplineImage
from gpusim.measure.images import quintic_weights
from tests.support.measure_images import speckles


def wave(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return 100 + 40 * np.sin(0.5 * x + 0.2) * np.cos(0.35 * y - 0.4)


def test_weights_reproduce_polynomials() -> None:
    t = np.linspace(0, 0.999, 7)
    weights = quintic_weights(t)
    taps = np.arange(-2, 4)[:, None]
    assert np.allclose(weights.sum(axis=0), 1, rtol=0, atol=1e-14)
    assert np.allclose((weights * taps).sum(axis=0), t, rtol=0, atol=1e-14)
    # quintic B-spline: variance 1/2
    assert np.allclose((weights * (taps - t) ** 2).sum(axis=0), 0.5, rtol=0, atol=1e-13)


def test_passes_through_every_pixel_and_follows_a_wave() -> None:
    rows, columns = np.indices((33, 57), dtype=np.float64)
    image = wave(columns, rows)
    spline = SplineImage.from_image(image)
    assert np.allclose(spline.values(columns, rows), image, rtol=0, atol=1e-11)
    rng = np.random.default_rng(5)
    x, y = rng.uniform(14, 42, 200), rng.uniform(12, 20, 200)
    assert np.abs(spline.values(x, y) - wave(x, y)).max() <= 2e-3
    x, y = columns[12:21, 14:43], rows[12:21, 14:43]
    by_x, by_y = (slope[12:21, 14:43] for slope in spline.pixel_gradients())
    assert np.abs(by_x - 20 * np.cos(0.5 * x + 0.2) * np.cos(0.35 * y - 0.4)).max() <= 2e-3
    assert np.abs(by_y + 14 * np.sin(0.5 * x + 0.2) * np.sin(0.35 * y - 0.4)).max() <= 2e-3


def test_pixel_gradients_are_those_of_the_spline() -> None:
    image = speckles(57, 33)
    spline = SplineImage.from_image(image)
    rows, columns = np.indices((33, 57), dtype=np.float64)
    taps, h = np.array([1.0, -8.0, 8.0, -1.0]) / 12.0, 1e-3 * np.array([-2.0, -1.0, 1.0, 2.0])
    by_x = sum(t * spline.values(columns + d, rows) for t, d in zip(taps, h, strict=True)) / 1e-3
    by_y = sum(t * spline.values(columns, rows + d) for t, d in zip(taps, h, strict=True)) / 1e-3
    got_x, got_y = spline.pixel_gradients()
    assert np.allclose(got_x, by_x, rtol=0, atol=1e-8)
    assert np.allclose(got_y, by_y, rtol=0, atol=1e-8)
    part_x, part_y = spline.pixel_gradients((4, 7, 31, 33))
    # the last columns of a line, which fill no vector, are rounded otherwise
    assert np.abs(part_x - got_x[7:33, 4:31]).max() <= 1e-13 * np.abs(got_x).max()
    assert np.abs(part_y - got_y[7:33, 4:31]).max() <= 1e-13 * np.abs(got_y).max()


@pytest.mark.parametrize("blur", [0.0, 1.3])
def test_a_crop_interpolates_like_the_whole_image(blur: float) -> None:
    image = speckles(157, 133)
    whole = SplineImage.from_image(image, blur_px=blur)
    crop = SplineImage.from_image(image, (60.0, 70.0, 75.5, 80.0), blur_px=blur)
    assert crop.pixels.size < 0.6 * image.size
    x, y = np.meshgrid(np.linspace(60, 75.5, 23), np.linspace(70, 80, 17))
    assert crop.inside(x, y).all()
    # 0.431^32 of the grey range; with a blur, what 5 standard deviations cut off
    limit = 1e-8 if blur == 0 else 1e-3
    assert np.abs(crop.values(x, y) - whole.values(x, y)).max() <= limit


def test_inside_is_false_for_nan_and_beyond_the_border() -> None:
    spline = SplineImage.from_image(speckles(57, 33))
    x = np.array([0.0, 56.0, 56.101, -0.101, np.nan, 20.0, 56.09, -0.09])
    y = np.array([0.0, 32.0, 10.0, 10.0, 10.0, np.nan, 10.0, 32.09])
    assert spline.inside(x, y).tolist() == [True, True, False, False, False, False, True, True]


@pytest.mark.parametrize(
    ("image", "words"),
    [
        (np.zeros((4, 57)), "too small"),
        (np.zeros((33, 57, 4)), "not one image"),
        (np.zeros((33, 57), dtype=bool), "wrong pixel type"),
        (np.full((33, 57), np.nan), "NaN"),
    ],
)
def test_bad_images_are_refused(image: np.ndarray, words: str) -> None:
    with pytest.raises(InputError, match=words):
        SplineImage.from_image(image)
    with pytest.raises(InputError, match="blur_px"):
        SplineImage.from_image(np.zeros((33, 57)), blur_px=float("nan"))
