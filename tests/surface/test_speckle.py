"""The speckle generator against the formulas of the Boolean model."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from scipy.spatial import cKDTree
from scipy.special import ndtr

from gpusim.errors import InputError
from gpusim.surface.paint import Speckle
from gpusim.surface.speckle import EDGE, edge_opacity, opaque_area

LOW, HIGH = np.array([-31.0, 14.0]), np.array([269.0, 254.0])
LAWS = [("fixed", 0.0), ("uniform", 0.3), ("lognormal", 0.4)]


def sampled(speckle: Speckle, step: float) -> np.ndarray:
    """Opacity at lattice points, straight from the discs' definition."""
    centres, radii = speckle.discs(LOW, HIGH)
    x, y = np.arange(LOW[0], HIGH[0], step), np.arange(LOW[1], HIGH[1], step)
    left = np.ones((len(y), len(x)))
    half = EDGE * speckle.softness
    for (s, t), r in zip(centres, radii, strict=True):
        outer = np.sqrt(r * (r + 2 * half))
        i = slice(*np.searchsorted(x, [s - outer, s + outer]))
        j = slice(*np.searchsorted(y, [t - outer, t + outer]))
        square = (x[i] - s) ** 2 + (y[j, None] - t) ** 2
        if half:
            left[j, i] *= 1.0 - edge_opacity((r * r - square) / (2.0 * r * half))
        else:
            left[j, i] *= square >= r * r
    return 1.0 - left


@pytest.mark.parametrize(("law", "spread"), LAWS)
@pytest.mark.parametrize("softness", [0.0, 0.6])
def test_coverage_is_as_requested(law: str, spread: float, softness: float) -> None:
    """Within 3 %, which is three times what 5 patterns of 1900 discs scatter."""
    coverage = 0.45
    patterns = [Speckle(5.0, coverage, softness, law, spread, seed=k) for k in range(5)]
    found = float(np.mean([sampled(speckle, 0.9).mean() for speckle in patterns]))
    print(f"{law}, softness {softness}: coverage {found:.4f} of {coverage}")
    assert abs(found / coverage - 1.0) < 0.03


def test_coverage_on_the_grid_is_as_requested_and_nothing_touches() -> None:
    for law, spread, coverage in (("fixed", 0.0, 0.6), ("uniform", 0.2, 0.45)):
        speckle = Speckle(5.0, coverage, 0.0, law, spread, "grid", seed=2)
        assert abs(float(sampled(speckle, 0.3).mean()) / coverage - 1.0) < 0.015
        centres, radii = speckle.discs(LOW, HIGH)
        pairs = cKDTree(centres).query_pairs(2.0 * float(radii.max()), output_type="ndarray")
        gap = np.linalg.norm(centres[pairs[:, 0]] - centres[pairs[:, 1]], axis=1)
        assert (gap >= radii[pairs].sum(axis=1) - 1e-12).all()
        distance = cKDTree(centres).query(centres, 2)[0][:, 1]
        assert np.ptp(distance) > 0.1 * speckle.pitch, "the discs weren't moved"


def test_covariance_and_size_are_those_of_the_boolean_model() -> None:
    """C(h) = 2 p - 1 + (1 - p)^2 exp(L g(h)), g the area that two discs h apart share.

    The diameter that fits the measured covariance best is the requested one within 3 %.
    """
    diameter, coverage = 6.0, 0.5
    step = 0.5
    images = np.stack([sampled(Speckle(diameter, coverage, seed=k), step) for k in range(6)])
    lags = np.arange(0, 40)
    columns = images.shape[2] - len(lags)
    first = images[:, :, :columns]
    measured = np.array([(first * images[:, :, k : k + columns]).mean() for k in lags])
    p = float(images.mean())

    def model(d: float) -> np.ndarray:
        h = np.minimum(step * lags / d, 1.0)
        shared = 0.5 * d * d * (np.arccos(h) - h * np.sqrt(1.0 - h * h))
        intensity = -np.log(1.0 - p) / (0.25 * np.pi * d * d)
        result: np.ndarray = 2.0 * p - 1.0 + (1.0 - p) ** 2 * np.exp(intensity * shared)
        return result

    fit = minimize_scalar(lambda d: np.sum((measured - model(d)) ** 2), (3.0, 6.0, 12.0))
    print(f"diameter {fit.x:.3f} of {diameter}, covariance within "
          f"{np.abs(measured - model(diameter)).max():.4f}")  # fmt: skip
    assert abs(fit.x / diameter - 1.0) < 0.03
    assert np.abs(measured - model(diameter)).max() < 0.01


@pytest.mark.parametrize(("law", "spread"), LAWS[1:])
def test_diameters_follow_their_law(law: str, spread: float) -> None:
    radii = Speckle(4.0, 0.5, 0.0, law, spread, seed=1).discs(LOW, HIGH)[1]
    error = 4.0 * spread / np.sqrt(len(radii))
    # cutting the lognormal tails takes a little off the mean and the deviation
    assert abs(2.0 * radii.mean() - 4.0) < 3 * error + 0.02 * (law == "lognormal")
    assert abs(np.std(2.0 * radii) / (4.0 * spread) - 1.0) < 0.05


def test_a_spread_alone_is_that_of_a_spray() -> None:
    """Means of the cut lognormal law in closed form, as the docstring has them; equal without."""
    assert Speckle(4.0, spread=0.4) == Speckle(4.0, size_law="lognormal", spread=0.4)
    quantile = (np.arange(100_000) + 0.5) / 100_000
    assert np.array_equal(Speckle(4.0).radii(quantile), np.full(100_000, 2.0))
    for spread, loss in ((0.3, 0.001), (0.5, 0.003), (1.0, 0.012)):
        sigma = np.sqrt(np.log1p(spread**2))
        share = np.diff(ndtr([-3.0 - sigma, 3.0 - sigma]))[0] / np.diff(ndtr([-3.0, 3.0]))[0]
        radii = Speckle(4.0, spread=spread).radii(quantile)
        assert abs(radii.mean() / 2.0 - share) < 1e-5
        assert abs(1.0 - share - loss) < 5e-4
        assert abs(np.std(np.log(radii)) / sigma - 1.0) < 0.02


def test_a_disc_keeps_its_area_and_its_edge_has_the_requested_deviation() -> None:
    x = np.linspace(0.0, 40.0, 400_001)
    for r, softness in ((6.0, 0.5), (3.0, 0.5), (2.0, 1.0), (1.0, 0.5)):
        u = (r * r - x * x) / (2.0 * r * EDGE * softness)
        area = np.trapezoid(edge_opacity(u) * 2.0 * np.pi * x, x)
        got = float(opaque_area(np.array([r]), softness)[0])
        assert abs(got / area - 1.0) < 1e-8
        if r >= 6.0 * softness:
            assert abs(got / (np.pi * r * r) - 1.0) < 1e-12
    u = np.linspace(-1.0, 1.0, 20_001)
    density = np.gradient(edge_opacity(u), u)
    assert abs(np.sqrt(np.trapezoid(density * u * u, u)) * EDGE - 1.0) < 1e-4


@pytest.mark.parametrize("arrangement", ["random", "grid"])
def test_a_larger_region_has_the_same_discs(arrangement: str) -> None:
    speckle = Speckle(3.0, 0.4, 0.1, "uniform", 0.2, arrangement, seed=5)
    part = np.column_stack(speckle.discs([10.0, -7.0], [31.0, 12.0]))
    whole = np.column_stack(speckle.discs([-200.0, -90.0], [80.0, 300.0]))
    assert len(part) > 20
    assert {tuple(row) for row in part} <= {tuple(row) for row in whole}
    # none that reaches into the part is missing
    gap = np.maximum([10.0, -7.0] - whole[:, :2], whole[:, :2] - [31.0, 12.0]).clip(0.0)
    near = whole[np.linalg.norm(gap, axis=1) < whole[:, 2]]
    assert {tuple(row) for row in near} <= {tuple(row) for row in part}


def test_the_seed_decides_and_places_are_even() -> None:
    first, again = (Speckle(3.0, seed=8).discs(LOW, HIGH)[0] for _ in range(2))
    other = Speckle(3.0, seed=9).discs(LOW, HIGH)[0]
    np.testing.assert_array_equal(first, again)
    assert not {tuple(p) for p in first} & {tuple(p) for p in other}
    inside = first[((first >= LOW) & (first < HIGH)).all(axis=1)]
    boxes = np.histogram2d(*inside.T, bins=(20, 16))[0]
    # counts of a Poisson process: as much variance as mean, chi-square within 4 deviations
    chi = float(((boxes - boxes.mean()) ** 2).sum() / boxes.mean())
    assert abs(chi - boxes.size) < 4.0 * np.sqrt(2.0 * boxes.size)


@pytest.mark.parametrize(
    ("make", "parts"),
    [
        (lambda: Speckle(0.0), ("Speckle diameter", "0.0", "above 0")),
        (lambda: Speckle(np.nan), ("Speckle diameter", "nan")),
        (lambda: Speckle(1.0, 1.0), ("Speckle coverage", "1.0", "below 1")),
        (lambda: Speckle(1.0, np.nan), ("Speckle coverage", "nan")),
        (lambda: Speckle(1.0, 0.5, 0.6), ("Speckle softness", "0.6", "half the diameter")),
        (lambda: Speckle(1.0, 0.5, -0.1), ("Speckle softness", "-0.1")),
        (lambda: Speckle(1.0, size_law="normal"), ("size_law", "'normal'", "lognormal")),
        (lambda: Speckle(1.0, size_law="fixed", spread=0.2), ("Speckle spread", "0.2", "fixed")),
        (lambda: Speckle(1.0, size_law="uniform", spread=0.6), ("spread", "0.6", "uniform")),
        (lambda: Speckle(1.0, arrangement="rows"), ("arrangement", "'rows'", "grid")),
        (lambda: Speckle(1.0, 0.95, arrangement="grid"), ("coverage", "0.95", "would touch")),
        (lambda: Speckle(1.0, seed=-1), ("Speckle seed", "-1")),
        (lambda: Speckle(1.0, seed=True), ("Speckle seed", "True")),
        (lambda: Speckle(1.0, dot=1.2), ("Speckle dot", "1.2", "0 to 1")),
        (lambda: Speckle(1e-4).discs(LOW, HIGH), ("Speckle diameter", "0.0001", "at most")),
    ],
)
def test_faults_say_what_got_and_expected(
    make: Callable[[], object], parts: tuple[str, ...]
) -> None:
    with pytest.raises(InputError) as caught:
        make()
    for part in parts:
        assert part in str(caught.value)
