"""The kernel against its NumPy twin, and the comparison against itself."""

from __future__ import annotations

import numpy as np
import pytest

from gpusim.errors import InputError, TwinMismatch
from gpusim.gpu import Device, compare, twin_checks
from gpusim.measure import SplineImage, Status
from gpusim.measure.correlation import icgn as stage
from gpusim.measure.correlation import image_pair
from gpusim.measure.correlation.icgn import correlate, correlate_numpy
from gpusim.measure.correlation.image_pair import Pair, Subsets
from gpusim.measure.correlation.matching import Settings
from gpusim.measure.correlation.warp import SHAPES
from tests.support.measure_images import speckles

# px; float32 sums and one step more or less at the stopping threshold (measured: 5e-7)
TOLERANCE_PX = 2e-5


def subsets() -> Subsets:
    first = speckles(97, 83)
    second = 0.7 * speckles(97, 83, shift=(1.3, -0.6), gradient=((0.01, -0.02), (0.015, 0.005)))
    first[52:, 52:] = 55.0  # no texture
    points = np.array(
        [[x + 0.3, y - 0.2] for y in range(14, 82, 11) for x in range(12, 96, 9)]
        + [[2.0, 40.0], [95.0, 81.0], [-30.0, 500.0]]
    )
    start = np.zeros((len(points), 2, 6))
    start[:, :, 0] = [1.0, -0.4]
    start[3, :, 0] = [60.0, 0.0]  # leaves the image
    start[4, :, 0] = [4e8, 0.0]  # far beyond any integer coordinate
    start[5, :, 0] = [9.0, 6.0]  # never finds its place
    mask = np.ones(first.shape, dtype=bool)
    mask[:30, :30] = False
    pair = Pair(SplineImage.from_image(first), SplineImage.from_image(second), mask)
    return Subsets(pair, points, start)


@pytest.mark.parametrize("shape", SHAPES)
def test_kernel_equals_twin(device: Device, shape: str) -> None:
    case, settings = subsets(), Settings(np.ones((21, 21)), shape, min_zncc=0.5)
    got, want = correlate(case, settings, device), correlate_numpy(case, settings)
    compare("status", got.status, want.status, "exact")
    assert {Status.OK, Status.OUTSIDE, Status.NO_TEXTURE} <= set(want.status.tolist())
    good = want.status == Status.OK
    compare("warp", got.coefficients[good], want.coefficients[good], atol=TOLERANCE_PX, rtol=0)
    compare("zncc", got.zncc[good], want.zncc[good], atol=2e-6, rtol=0)
    compare("sigma", got.sigma[good], want.sigma[good], atol=1e-7, rtol=2e-3)
    assert np.abs(got.iterations[good] - want.iterations[good]).max() <= 1
    assert np.isnan(got.coefficients[~good]).all() and np.isnan(got.sigma[~good]).all()
    assert np.array_equal(np.isnan(got.zncc), np.isnan(want.zncc))


def test_kernel_equals_twin_with_weights_and_a_large_subset(device: Device) -> None:
    case = subsets()
    offset = np.arange(33) - 16
    weights = np.exp(-0.5 * (offset[:, None] ** 2 / 30.0 + offset[None, :] ** 2 / 60.0))
    settings = Settings(weights, min_zncc=0.5)
    got, want = correlate(case, settings, device), correlate_numpy(case, settings)
    compare("status", got.status, want.status, "exact")
    good = want.status == Status.OK
    compare("warp", got.coefficients[good], want.coefficients[good], atol=TOLERANCE_PX, rtol=0)
    plain = correlate(case, Settings(np.ones((33, 33)), min_zncc=0.5), device)
    both = good & (plain.status == Status.OK)
    with pytest.raises(TwinMismatch):  # the weights matter
        compare(
            "warp", plain.coefficients[both], want.coefficients[both], atol=TOLERANCE_PX, rtol=0
        )


def test_the_workgroup_of_a_gpu_gives_the_same(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stage, "THREADS_CPU", stage.THREADS)
    case, settings = subsets(), Settings(np.ones((21, 21)), min_zncc=0.5)
    got, want = correlate(case, settings, device), correlate_numpy(case, settings)
    compare("status", got.status, want.status, "exact")
    good = want.status == Status.OK
    compare("warp", got.coefficients[good], want.coefficients[good], atol=TOLERANCE_PX, rtol=0)


@pytest.mark.parametrize("on_device", [True, False])
def test_a_subset_larger_than_the_image_is_outside(device: Device, on_device: bool) -> None:
    image = SplineImage.from_image(speckles(57, 33))
    case = Subsets(Pair(image, image), np.array([[28.0, 16.0]]), np.zeros((1, 2, 6)))
    found = correlate(case, Settings(np.ones((41, 41))), device if on_device else None)
    assert found.status.tolist() == [Status.OUTSIDE]
    assert np.isnan(found.coefficients).all()


def test_planes_of_single_subsets_are_those_of_the_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    case, settings = subsets(), Settings(np.ones((21, 21)))
    want = correlate_numpy(case, settings)
    monkeypatch.setattr(image_pair, "KEEP_PLANES", 100)
    fresh = Pair(case.pair.reference, case.pair.deformed, case.pair.mask)
    got = correlate_numpy(Subsets(fresh, case.points, case.start), settings)
    assert "planes" not in vars(fresh)
    assert np.array_equal(got.coefficients, want.coefficients, equal_nan=True)
    assert np.array_equal(got.status, want.status)


def test_one_corrupted_value_is_seen(device: Device) -> None:
    case, settings = subsets(), Settings(np.ones((21, 21)))
    got, want = correlate(case, settings, device), correlate_numpy(case, settings)
    good = want.status == Status.OK
    for wrong in (1e-3, np.nan):
        changed = got.coefficients[good].copy()
        changed[7, 1, 0] += wrong
        with pytest.raises(TwinMismatch, match="warp"):
            compare("warp", changed, want.coefficients[good], atol=TOLERANCE_PX, rtol=0)
    # and a wrong pixel in the kernel's input
    pixels = case.pair.deformed.coefficients.copy()
    pixels[25:28, 30:33] += 5.0
    old = case.pair.deformed
    new = SplineImage(old.pixels, pixels, old.origin, old.valid)
    spoilt = Subsets(Pair(case.pair.reference, new, case.pair.mask), case.points, case.start)
    other = correlate(spoilt, settings, device)
    both = good & (other.status == Status.OK)
    with pytest.raises(TwinMismatch):
        compare(
            "warp", other.coefficients[both], want.coefficients[both], atol=TOLERANCE_PX, rtol=0
        )


def test_two_runs_agree_bit_for_bit(device: Device) -> None:
    case, settings = subsets(), Settings(np.ones((21, 21)))
    first, second = correlate(case, settings, device), correlate(case, settings, device)
    assert np.array_equal(first.coefficients, second.coefficients, equal_nan=True)
    assert np.array_equal(first.zncc, second.zncc, equal_nan=True)


@pytest.mark.parametrize("scale", [1e-30, 1e30])
def test_grey_values_of_any_size_fit_into_float32(device: Device, scale: float) -> None:
    case, settings = subsets(), Settings(np.ones((21, 21)))
    first, second = case.pair.reference.pixels * scale, case.pair.deformed.pixels * scale
    pair = Pair(SplineImage.from_image(first), SplineImage.from_image(second), case.pair.mask)
    scaled = Subsets(pair, case.points, case.start)
    want, got = correlate_numpy(case, settings), correlate(scaled, settings, device)
    compare("status", got.status, want.status, "exact")
    good = want.status == Status.OK
    compare("warp", got.coefficients[good], want.coefficients[good], atol=TOLERANCE_PX, rtol=0)


def test_doctor_runs_the_check(device: Device) -> None:
    twin_checks()["measure/correlation/icgn"](device)


def test_nan_start_values_are_refused() -> None:
    case = subsets()
    start = case.start.copy()
    start[2, 1, 0] = np.nan
    with pytest.raises(InputError, match="start"):
        Subsets(case.pair, case.points, start)


@pytest.mark.parametrize("stretch", [0.6, 1.15, 1.9, 2.4])
def test_stretched_and_turned_subsets_whether_pixels_share_their_loads_or_not(
    device: Device, stretch: float
) -> None:
    """Up to two pixels apart four neighbours are read together, beyond that one by one."""
    turn = np.deg2rad(33.0)
    matrix = stretch * np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    row, column = np.indices((141, 151), dtype=np.float64)

    def pattern(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.sin(0.5 * x + 0.1 * y) + np.sin(0.2 * x - 0.6 * y) + np.sin(0.35 * x + 0.4 * y)

    back = np.linalg.inv(matrix)
    x, y = column - 75.0, row - 70.0
    moved = pattern(back[0, 0] * x + back[0, 1] * y, back[1, 0] * x + back[1, 1] * y)
    first = pattern(column - 75.0, row - 70.0)
    points = np.array([[75.0, 70.0], [78.2, 66.9], [70.5, 73.4]])
    start = np.zeros((3, 2, 6))
    start[:, :, 0] = (points - [75, 70]) @ (matrix - np.eye(2)).T + 0.2
    start[:, :, 1:3] = 9 * (matrix - np.eye(2))
    pair = Pair(SplineImage.from_image(first), SplineImage.from_image(moved))
    case = Subsets(pair, points, start)
    settings = Settings(np.ones((19, 19)))
    want, got = correlate_numpy(case, settings), correlate(case, settings, device)
    assert (want.status == Status.OK).all()
    compare("status", got.status, want.status, "exact")
    compare("warp", got.coefficients, want.coefficients, atol=TOLERANCE_PX, rtol=0)
    truth = (points - [75, 70]) @ (matrix - np.eye(2)).T
    assert np.abs(got.coefficients[:, :, 0] - truth).max() <= 0.02


@pytest.mark.parametrize("width", [181, 255])
def test_large_subsets_are_summed_to_their_end(device: Device, width: int) -> None:
    """A driver ends loops after so many turns, and nothing says so."""
    first, second = speckles(300, 280), speckles(300, 280, shift=(0.4, 0.3))
    pair = Pair(SplineImage.from_image(first), SplineImage.from_image(second))
    case = Subsets(pair, np.array([[150.0, 140.0], [148.3, 139.6]]), np.zeros((2, 2, 6)))
    settings = Settings(np.ones((width, width)))
    got, want = correlate(case, settings, device), correlate_numpy(case, settings)
    assert want.ok.all()
    compare("status", got.status, want.status, "exact")
    compare("warp", got.coefficients, want.coefficients, atol=TOLERANCE_PX, rtol=0)


def test_subsets_that_never_arrive_count_as_such(device: Device) -> None:
    """After as many iterations as are allowed, each of stretched pixels one by one."""
    pair = Pair(
        SplineImage.from_image(speckles(160, 160)),
        SplineImage.from_image(speckles(160, 160, shift=(57.3, 31.9))),
    )
    start = np.zeros((12, 2, 6))
    start[:, :, 1:3] = 0.3 * 20 * np.eye(2)
    points = np.array([[x, y] for x in (60.0, 75.0, 90.0, 105.0) for y in (65.0, 80.0, 95.0)])
    settings = Settings(np.ones((41, 41)), min_zncc=-1.0, tolerance=1e-9)
    got = correlate(Subsets(pair, points, start), settings, device)
    want = correlate_numpy(Subsets(pair, points, start), settings)
    assert (want.iterations == settings.max_iterations).any()
    assert not got.ok[~want.ok].any()
    assert not (got.zncc > want.zncc + 0.05).any()
