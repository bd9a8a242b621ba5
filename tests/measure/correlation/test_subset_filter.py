"""What subsets make of a field: against what is measured in pictures, and against closed forms."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest

from gpusim.measure import dic, gauge_filter, grid_points, strain
from gpusim.measure.correlation.subset_filter import filtered_by_subsets
from gpusim.measure.correlation.warp import Shape

WIDTH, HEIGHT, SUBSET = 231, 174, 21
SHAPES: tuple[Shape, ...] = ("affine", "quadratic")


def pattern(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """A band-limited random pattern, 500 waves of 5 to 12 px: read between pixels without error."""
    random = np.random.default_rng(3)
    length, angle, phase = random.uniform((5, 0, 0), (12, 2 * pi, 2 * pi), (500, 3)).T
    along, down = 2 * pi / length * [np.cos(angle), np.sin(angle)]
    values = np.full(x.shape, 120.0)
    for wave in zip(along, down, phase, strict=True):
        values += 1.9 * np.cos(wave[0] * x + wave[1] * y + wave[2])
    return values


def pixels() -> tuple[np.ndarray, np.ndarray]:
    row, column = np.indices((HEIGHT, WIDTH)).astype(np.float64)
    return column, row


def motion(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Waves of 57 px along x and 83 px down, and an even strain."""
    return np.stack([0.3 * np.sin(2 * pi * x / 57) + 4e-3 * y, 0.2 * np.cos(2 * pi * y / 83)], -1)


@pytest.fixture(scope="module")
def pictures() -> tuple[np.ndarray, np.ndarray]:
    column, row = pixels()
    x, y = column, row
    for _ in range(40):
        u = motion(x, y)
        x, y = column - u[..., 0], row - u[..., 1]
    return pattern(column, row), pattern(x, y)


@pytest.mark.parametrize("shape", SHAPES)
def test_the_filtered_field_is_what_dic_finds(
    pictures: tuple[np.ndarray, np.ndarray], shape: Shape
) -> None:
    mask = np.ones((HEIGHT, WIDTH), bool)
    mask[60:90, 100:121] = False
    points = grid_points((HEIGHT, WIDTH), subset=SUBSET, step=9)
    found = dic(*pictures, points=points, subset=SUBSET, shape=shape, mask=mask, backend="numpy",
                apart_px=np.inf)  # fmt: skip
    field = np.where(mask[..., None], motion(*pixels()), np.nan)
    levelled = filtered_by_subsets(
        pictures[0], points, [field], subset=SUBSET, shape=shape, mask=mask
    )
    ok = found.ok
    assert ok.mean() > 0.9
    raw = found.displacement[ok] - motion(*points[ok].T)
    rest = found.displacement[ok] - levelled.displacement[0, ok]
    # the affine subset loses 0.06 px of the wave, the quadratic one 0.008 px
    assert np.sqrt(np.mean(raw**2)) > {"affine": 0.03, "quadratic": 2e-3}[shape]
    assert np.sqrt(np.mean(rest**2)) < {"affine": 1e-3, "quadratic": 3e-4}[shape]
    even = filtered_by_subsets(
        pictures[0], points, [np.tile([0.25, -1.5], (HEIGHT, WIDTH, 1))], subset=SUBSET, shape=shape
    )
    assert np.abs(even.displacement[0] - [0.25, -1.5]).max() < 1e-9


@pytest.mark.parametrize("shape", SHAPES)
def test_transfer_is_that_of_the_fit(shape: Shape) -> None:
    place = np.arange(SUBSET) - SUBSET // 2
    a, b = np.meshgrid(place, place)
    terms = [np.ones_like(a), a, b, a * a, a * b, b * b]
    basis = np.stack([one.ravel() for one in terms[: 3 if shape == "affine" else 6]], -1)
    centre = np.linalg.pinv(basis.astype(float))[0]
    for period in (25.0, 60.0, 200.0):
        kept = centre @ np.cos(2 * pi * a / period).ravel()
        assert gauge_filter(SUBSET, shape).response(period) == pytest.approx(kept, abs=1e-9)
    assert gauge_filter(SUBSET, shape).noise ** 2 == pytest.approx(centre @ centre, rel=1e-9)


def test_strain_transfer_is_that_of_the_gauge() -> None:
    step, window, period = 5, 7, 130.0
    points = grid_points((81, 181), subset=1, step=step)
    wave = np.column_stack([np.sin(2 * pi * (points[:, 0] - 90) / period), 0 * points[:, 0]])
    wave *= 1e-3 * gauge_filter(SUBSET).response(period)

    class Wave:
        subset = SUBSET
        displacement = wave

    Wave.points = points  # type: ignore[attr-defined]
    found = strain(Wave, window=window, kind="small")  # type: ignore[arg-type]
    (middle,) = np.flatnonzero((points == [90, 40]).all(axis=1))
    kept = found.tensor[middle, 0, 0] / (2e-3 * pi / period)
    gauge = gauge_filter(SUBSET, "affine", step, window)
    assert kept == pytest.approx(gauge.response(period), rel=1e-9)
    assert gauge.response(gauge.resolution) == pytest.approx(0.9)


@pytest.mark.parametrize(("shape", "theory"), [("affine", 5.65), ("quadratic", 3.42)])
def test_efficiency_is_the_published_one_and_that_of_noisy_pictures(
    shape: Shape, theory: float
) -> None:
    assert gauge_filter(101, shape).efficiency == pytest.approx(theory, abs=5e-3)
    column, row = pixels()
    clean, noise = pattern(column, row), 1.5
    random = np.random.default_rng(7)
    points = grid_points(clean.shape, subset=31, step=15)
    errors = []
    for _ in range(8):
        noisy = [clean + noise * random.standard_normal(clean.shape) for _ in range(2)]
        errors.append(dic(*noisy, points=points, subset=31, shape=shape, backend="numpy",
                          apart_px=np.inf).displacement)  # fmt: skip
    g = np.sqrt(np.mean(np.square(np.gradient(pattern(*pixels())))))
    field = filtered_by_subsets(clean, points, [], subset=31, shape=shape)
    slope = float(np.median(field.slope)) * np.ptp(clean)
    # central differences lose some of the slopes of short waves
    assert slope == pytest.approx(g, rel=0.15) and slope > g
    measured = np.nanstd(errors) * gauge_filter(31, shape).resolution
    assert (field.spread.max(axis=1) == 1.0).all() and 0.8 < np.median(field.spread) < 1.0
    assert measured == pytest.approx(theory * noise / slope, rel=0.06)
