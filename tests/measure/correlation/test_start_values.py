"""Motion that is found without a guess: far, turned, several bodies; and what can't be used."""

from __future__ import annotations

import numpy as np
import pytest

from gpusim.errors import InputError
from gpusim.measure import Status, dic
from gpusim.measure.correlation.matching import make_settings
from gpusim.measure.correlation.pixel_mask import full_scale, masked_image
from gpusim.measure.correlation.propagation import Front
from gpusim.measure.correlation.start_values import feature_motions, global_shift
from tests.support.measure_images import speckles


def turned(degrees: float) -> tuple[tuple[float, float], tuple[float, float]]:
    c, s = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    return (c - 1, -s), (s, c - 1)


@pytest.mark.parametrize("degrees", [25.0, -90.0, 180.0])
def test_any_rotation_is_found_by_features(degrees: float) -> None:
    size = {"width": 203, "height": 187, "sigma": 1.8, "density": 0.02}
    gradient, shift = turned(degrees), np.array([9.3, -7.6])
    first = np.rint(speckles(**size)).astype(np.uint8)
    second = np.rint(speckles(**size, shift=tuple(shift), gradient=gradient)).astype(np.uint8)
    result = dic(first, second, subset=25, step=9, roi=(50, 45, 152, 140))
    truth = (result.points - [101, 93]) @ np.array(gradient).T + shift
    assert result.ok.mean() >= 0.98
    error = (result.displacement - truth)[result.ok]
    assert np.abs(error).max() <= 0.05
    assert np.sqrt((error**2).mean()) <= 0.01


def test_hundreds_of_pixels_in_a_picture_of_another_size() -> None:
    first = speckles(240, 150, seed=3)
    second = speckles(520, 330, seed=8)
    moved = speckles(520, 330, seed=8)
    moved[...] = second
    # the same picture again, 250.4 px to the right and 160.2 px down
    inner = speckles(240, 150, seed=3, shift=(0.4, 0.2))
    moved[160:310, 250:490] = inner
    result = dic(first, moved, subset=21, step=12, roi=(12, 12, 225, 135), search_px=8)
    assert result.ok.mean() >= 0.98
    assert np.abs(result.displacement[result.ok] - [250.4, 160.2]).max() <= 0.02


def test_bodies_that_move_differently_are_each_found() -> None:
    still = speckles(301, 181, seed=5)
    moved = speckles(301, 181, seed=5, shift=(37.4, 0.0))
    first = still.copy()
    second = np.full_like(still, 60.0)
    second[:90] = moved[:90]
    down = speckles(301, 181, seed=5, shift=(-41.3, 0.0))
    second[90:] = down[90:]
    points = np.array([[x, y] for y in (30.0, 60.0, 120.0, 150.0) for x in range(70, 240, 12)])
    result = dic(first, second, subset=25, points=points, search_px=6, start="features")
    truth = np.where(points[:, 1] < 90, 37.4, -41.3)
    assert result.ok.mean() >= 0.95
    assert np.abs(result.displacement[result.ok, 0] - truth[result.ok]).max() <= 0.01


def test_global_shift_and_motions_of_plain_pictures_are_none() -> None:
    plain = np.full((90, 120), 80.0)
    assert feature_motions(plain, plain) == []
    assert np.isfinite(global_shift(plain, plain)).all()


def test_not_a_number_is_masked_and_says_so() -> None:
    size = {"width": 157, "height": 121}
    first, second = speckles(**size), speckles(**size, shift=(0.37, 0.81))
    first[20:60, 30:70] = np.nan
    second[90:110, 100:130] = np.inf
    result = dic(first, second, subset=21, step=8)
    inside = np.all((result.points > [38, 28]) & (result.points < [62, 52]), axis=1)
    assert (result.status[inside] == Status.MASKED).all()
    away = np.all(np.abs(result.points - np.array([114.1, 98.7])) < [10, 6], axis=1)
    assert away.sum() >= 2 and (result.status[away] == Status.MASKED).all()
    # the filled rectangle costs matches beside it, but it is the reason for all of them
    assert set(result.counts()) <= {"OK", "MASKED", "OUTSIDE", "NO_TEXTURE"}
    good = result.ok
    assert np.abs(result.displacement[good] - [0.37, 0.81]).max() <= 0.02
    assert np.isnan(result.displacement[~good]).all()


def test_a_highlight_is_left_out_in_both_images() -> None:
    size = {"width": 197, "height": 141}
    first, second = speckles(**size), speckles(**size, shift=(1.37, 0.81))
    first[30:80, 40:90] += 300.0
    second[80:125, 120:160] += 300.0
    images = [np.clip(np.rint(image), 0, 255).astype(np.uint8) for image in (first, second)]
    result = dic(*images, subset=21, step=7)
    x, y = result.points.T
    core = (x > 47) & (x < 82) & (y > 37) & (y < 72)
    assert (result.status[core] == Status.SATURATED).all()
    core = (x > 125) & (x < 153) & (y > 84) & (y < 118)
    assert core.any() and (result.status[core] != Status.OK).all()
    assert Status.SATURATED in result.status
    error = np.abs(result.displacement - [1.37, 0.81]).max(axis=1)[result.ok]
    assert result.ok.mean() >= 0.5
    # beside the highlight a third of a subset is left: its sigma says so
    assert (error <= 0.005 + 4.5 * result.sigma[result.ok]).all()


def test_a_binary_pattern_is_not_saturated() -> None:
    rng = np.random.default_rng(7)
    cells = rng.integers(0, 2, (24, 32)).astype(np.uint8)
    image = np.kron(cells, np.full((5, 5), 255, dtype=np.uint8))
    assert full_scale(image) == 255
    large = masked_image(image, "image", 31).saturated
    assert large is None or large.mean() <= 0.12  # three by three white cells happen
    assert masked_image(image, "image", 51).saturated is None
    assert dic(image, image, subset=31, step=10).ok.all()


@pytest.mark.parametrize(("bits", "shift"), [(8, 0), (10, 0), (12, 0), (12, 4), (16, 0)])
def test_full_scale_of_a_camera(bits: int, shift: int) -> None:
    top = (2**bits - 1) << shift
    image = np.zeros((64, 64), dtype=np.uint16)
    image[:5, :5] = top
    assert full_scale(image) == top
    assert full_scale(image // 3) is None
    assert full_scale(image.astype(np.float32)) is None


def test_pictures_that_have_nothing_in_common_give_no_numbers() -> None:
    size = {"width": 150, "height": 120}
    result = dic(speckles(**size), speckles(**size, seed=77), subset=21, step=9)
    assert not result.ok.any()
    assert np.isnan(result.displacement).all() and np.isnan(result.sigma).all()


def test_a_second_look_repairs_a_match_in_a_wrong_place() -> None:
    """Two far parts look alike; the integer search of single points takes the better one."""
    from gpusim.measure.correlation.matching import Settings
    from gpusim.measure.correlation.propagation import Front

    first, second = speckles(157, 121), speckles(157, 121, shift=(0.37, 0.81))
    points = np.array([[x, y] for y in range(20, 100, 8) for x in range(20, 136, 8)], float)
    front = Front((first, second), points, Settings(np.ones((21, 21))), None, 0.0, 20.0, None)
    front.attempt(np.arange(len(points)), np.full_like(points, 0.5))
    wrong = 37
    front.matches.coefficients[wrong, :, 0] += 6.0
    front.matches.zncc[wrong] = 0.9
    front.recheck_outliers()
    assert np.abs(front.matches.coefficients[wrong, :, 0] - [0.37, 0.81]).max() <= 1e-3


@pytest.mark.parametrize(
    ("change", "words"),
    [({"start": "fourier"}, "start"), ({"saturation": float("nan")}, "saturation")],
)
def test_wrong_arguments_name_themselves(change: dict[str, object], words: str) -> None:
    image = speckles(57, 33)
    with pytest.raises(InputError, match=words):
        dic(image, image, **{"subset": 15, **change})


def test_a_guess_may_be_an_earlier_result_at_the_same_points() -> None:
    size = {"width": 117, "height": 93}
    first = speckles(**size)
    early = dic(first, speckles(**size, shift=(4.0, 1.0)), subset=21, step=9)
    second = speckles(**size, shift=(6.3, 1.6))
    late = dic(first, second, subset=21, step=9, guess=early)
    plain = dic(first, second, subset=21, step=9)
    assert np.array_equal(late.ok, plain.ok)
    assert np.abs((late.displacement - plain.displacement)[late.ok]).max() <= 1e-4
    with pytest.raises(InputError, match="same"):
        dic(first, second, subset=21, step=10, guess=early)


def test_noise_that_outweighs_the_slopes_is_measured_to_its_own_uncertainty() -> None:
    """Steps shrink too slowly to come below 1e-4 px: one point in 30 didn't converge."""
    rng = np.random.default_rng(0)
    shift = (0.37, -0.21)
    images = [speckles(141, 103, shift=s) for s in ((0.0, 0.0), shift)]
    images = [i + 0.35 * images[0].std() * rng.normal(size=i.shape) for i in images]
    result = dic(*images, subset=15, step=5, apart_px=np.inf, min_zncc=0.6)
    assert (result.status == Status.NOT_CONVERGED).mean() <= 0.01
    assert result.ok.mean() >= 0.8
    error = np.abs(result.displacement[result.ok] - shift)
    assert np.median(error) <= 0.1


def test_a_match_that_is_stopped_too_early_is_no_number() -> None:
    image = speckles(91, 71, sigma=1.8)
    points = np.array([[30.0, 30.0], [45.0, 35.0]])
    settings = make_settings(
        21, "square", shape="affine", tolerance=1e-4, max_iterations=40, min_zncc=0.8, max_move=21.0
    )
    front = Front((image, image), points, settings, None, 0.0, 5.0, None)
    front.attempt(np.arange(2), np.full((2, 2), 0.3), tolerance=1e-2)
    matches = front.matches
    assert (matches.status == Status.NOT_CONVERGED).all()  # a perfect match is known much better
    assert np.isnan(matches.coefficients).all() and np.isnan(matches.sigma).all()
    front.attempt(np.arange(2), np.full((2, 2), 0.3))
    assert (front.matches.status == Status.OK).all()
