"""What the correlation promises, in numbers: bias, sine fields, resolution, noise floor."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq, minimize_scalar
from scipy.signal import savgol_coeffs

from gpusim.measure import dic
from tests.support.measure_images import Waves, discs


def test_shift_bias_of_sharp_discs_behind_a_lens_of_0_7_px() -> None:
    size = {"width": 141, "height": 113}
    first = discs(**size)
    bias: dict[int, list[float]] = {0: [], 8: []}
    for shift in (0.0, 0.1, 0.25, 0.4, 0.5, 0.7, 0.9):
        second = discs(**size, shift=(shift, 0.7 * shift))
        for bits, found in bias.items():
            images = [np.rint(i).astype(np.uint8) if bits else i for i in (first, second)]
            result = dic(*images, subset=31, step=8, roi=(8, 8, 132, 104))
            assert result.ok.all()
            error = result.displacement - [shift, 0.7 * shift]
            found.append(float(np.abs(error.mean(axis=0)).max()))
            assert error.std(axis=0).max() <= 2e-3
    assert max(bias[0]) <= 8e-4
    assert max(bias[8]) <= 1e-3


@pytest.mark.parametrize(("shape", "subset"), [("affine", 21), ("quadratic", 31)])
def test_sine_of_a_tenth_of_a_pixel(shape: str, subset: int) -> None:
    width, height, period = 241, 61, 150.0
    waves = Waves()

    def field(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.stack(
            [0.1 * np.sin(2 * np.pi * x / period), 0.1 * np.cos(2 * np.pi * x / period)]
        )

    first = waves.moved(width, height, lambda x, y: 0 * np.stack([x, y]))
    second = waves.moved(width, height, field)
    result = dic(first, second, subset=subset, step=5, shape=shape, roi=(1, 1, 239, 59))
    error = result.displacement - field(*result.points.T).T
    assert result.ok.all()
    assert np.sqrt((error**2).mean()) <= 0.003


def transfer(order: int, subset: int, period: float) -> float:
    """What a least-squares polynomial over ``subset`` pixels leaves of a cosine at its middle."""
    weights = savgol_coeffs(subset, order)
    offset = np.arange(subset) - subset // 2
    return float(weights @ np.cos(2 * np.pi * offset / period))


@pytest.mark.parametrize(("shape", "order", "subset"), [("affine", 1, 25), ("quadratic", 2, 37)])
def test_star_pattern_ten_percent_loss_where_the_shape_function_says(
    shape: str, order: int, subset: int
) -> None:
    """v = 0.5 cos(2 pi (y - yc) / p(x)), p growing along x (DIC Challenge 2.0, Reu et al. 2022)."""
    width, height = 521, 71
    expected = brentq(lambda p: transfer(order, subset, p) - 0.9, 1.2 * subset, 8 * subset)
    low, high = 0.75 * expected, 1.8 * expected
    middle = (height - 1) / 2
    waves = Waves(seed=3)

    def period(x: np.ndarray) -> np.ndarray:
        return low + (high - low) * np.clip(x, -20, width + 20) / (width - 1)

    def field(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.stack([0 * x, 0.5 * np.cos(2 * np.pi * (y - middle) / period(x))])

    first = waves.moved(width, height, lambda x, y: 0 * np.stack([x, y]))
    second = waves.moved(width, height, field)
    points = np.array([[x, middle] for x in range(subset // 2 + 2, width - subset // 2 - 2, 4)])
    result = dic(first, second, subset=subset, points=points, shape=shape)
    assert result.ok.all()
    left = result.displacement[:, 1] / 0.5
    # the pattern's own texture weighs the pixels unevenly: the curve as a whole is fitted by the
    # theoretical one of a subset of another width
    at = period(points[:, 0])
    fit = minimize_scalar(
        lambda s: sum(
            (transfer(order, subset, p / s) - a) ** 2 for p, a in zip(at, left, strict=True)
        ),
        bounds=(0.5, 2.0),
        method="bounded",
    )
    assert 0.95 <= fit.x <= 1.05
    model = np.array([transfer(order, subset, p / fit.x) for p in at])
    assert np.abs(model - left).max() <= 0.1
    assert left[at < expected].mean() < 0.9 < left[at > expected].mean()


@pytest.mark.parametrize("subset", [21, 31])
def test_noise_floor_is_that_of_the_theory(subset: int) -> None:
    """sqrt(2) sigma / sqrt(sum of squared gradients) (Pan et al. 2008; Wang et al. 2009)."""
    width, height, noise = 331, 231, 3.0
    waves, rng = Waves(seed=2), np.random.default_rng(6)
    y, x = np.indices((height, width), dtype=np.float64)
    exact, moved = waves.at(x, y), waves.at(x - 0.3, y + 0.2)
    first, second = (i + noise * rng.normal(size=i.shape) for i in (exact, moved))
    result = dic(first, second, subset=subset, step=subset, roi=(3, 3, 327, 227))
    by_x, by_y = np.gradient(exact, axis=1), np.gradient(exact, axis=0)
    assert result.ok.all()
    error = result.displacement - [0.3, -0.2]
    for axis, slope in enumerate((by_x, by_y)):
        floor = np.sqrt(2) * noise / np.sqrt(subset**2 * (slope**2).mean())
        assert 0.75 <= np.sqrt((error[:, axis] ** 2).mean()) / floor <= 1.3
