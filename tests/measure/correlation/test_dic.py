"""Subset matching on images whose shift and stretch are known in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from gpusim.errors import InputError
from gpusim.measure import Status, dic, grid_points
from tests.support.measure_images import speckles

SIZE = {"width": 117, "height": 93}


@pytest.mark.parametrize("shift", [0.0, 0.1, 0.25, 0.5, 0.75, 0.9, 1.0])
def test_shift_bias_on_integrated_speckles(shift: float) -> None:
    first, second = speckles(**SIZE), speckles(**SIZE, shift=(shift, -0.6 * shift))
    result = dic(first, second, subset=21, step=9, roi=(6, 6, 110, 86))
    assert result.ok.all()
    error = result.displacement - [shift, -0.6 * shift]
    # measured over the table: bias <= 6e-5, standard deviation <= 4e-5 px at sigma 1.5 px
    assert np.abs(error.mean(axis=0)).max() <= 1.5e-4
    assert error.std(axis=0).max() <= 1.5e-4


def test_subsets_at_the_border_are_nearly_as_good() -> None:
    first, second = speckles(**SIZE), speckles(**SIZE, shift=(0.5, 0.3))
    result = dic(first, second, subset=21, step=8)
    touches = (result.points == 10).any(axis=1) & result.ok
    assert touches.sum() >= 5
    # 0.016 px if the spline were mirrored there
    assert np.abs(result.displacement[touches] - [0.5, 0.3]).max() <= 4e-3


def test_shift_of_an_8_bit_image_is_within_its_own_uncertainty() -> None:
    first = np.rint(speckles(**SIZE)).astype(np.uint8)
    second = np.rint(speckles(**SIZE, shift=(0.37, 0.81))).astype(np.uint8)
    result = dic(first, second, subset=21, step=9, roi=(6, 6, 110, 86))
    error = result.displacement - [0.37, 0.81]
    # 70 half overlapping subsets of sigma 0.0025 px scatter by 0.0007 px in the mean
    assert np.abs(error.mean(axis=0)).max() <= 2.1e-3
    assert 0.5 <= np.sqrt((error**2).mean()) / np.median(result.sigma) <= 2.0


@pytest.mark.parametrize("blur", [0.0, 0.5, 1.0, 2.0])
def test_sigma_is_the_scatter_that_noise_makes(blur: float) -> None:
    rng = np.random.default_rng(8)
    noise = 2.0
    first = speckles(217, 153) + noise * rng.normal(size=(153, 217))
    second = speckles(217, 153, shift=(0.3, -0.2)) + noise * rng.normal(size=(153, 217))
    result = dic(first, second, subset=21, step=21, roi=(6, 6, 210, 146), blur_px=blur)
    error = result.displacement - [0.3, -0.2]
    assert result.ok.all()
    # measured: 0.92 to 1.04; 0.59 at 2 px if the blurred noise counted as white
    assert 0.8 <= np.sqrt((error**2).mean()) / np.sqrt((result.sigma**2).mean()) <= 1.15


@pytest.mark.parametrize(
    ("factor", "offset", "kind"),
    [(1.0, 1e9, "f8"), (1e-40, 0.0, "f8"), (1e-40, 0.0, "f4"), (1e-310, 0.0, "f8"),
     (1e300, -1e302, "f8"), (1e4, 1e9, "i4"), (1e6, 4e9, "u4")],
)  # fmt: skip
def test_grey_values_may_have_any_offset_and_factor(
    factor: float, offset: float, kind: str
) -> None:
    first, second = speckles(**SIZE), speckles(**SIZE, shift=(0.37, 0.81))
    plain = dic(first, second, subset=21, step=9)
    result = dic(*((factor * image + offset).astype(kind) for image in (first, second)),
                 subset=21, step=9)  # fmt: skip
    np.testing.assert_array_equal(result.status, plain.status)
    inner = (result.points >= 16).all(axis=1) & (result.points <= [100, 76]).all(axis=1)
    assert result.ok[inner].all() and inner.sum() >= 40
    assert np.abs(result.displacement[inner] - [0.37, 0.81]).max() <= 1e-3
    ok = plain.ok
    np.testing.assert_allclose(result.displacement[ok], plain.displacement[ok], atol=2e-5)
    np.testing.assert_allclose(result.zncc[ok], plain.zncc[ok], atol=1e-6)


@pytest.mark.parametrize("shape", ["affine", "quadratic"])
def test_sigma_knows_that_slopes_are_noisy_too(shape: str) -> None:
    """Noise of a quarter of the contrast: a third of the squared slopes is noise."""
    first, second = speckles(217, 153), speckles(217, 153, shift=(0.3, -0.2))
    errors, variances = [], []
    for seed in range(3):
        rng = np.random.default_rng(seed)
        noisy = (image + 5.0 * rng.normal(size=image.shape) for image in (first, second))
        result = dic(*noisy, subset=31, step=31, roi=(6, 6, 210, 146), shape=shape)  # type: ignore[misc,arg-type]
        assert result.ok.all()
        errors.append(result.displacement - [0.3, -0.2])
        variances.append(result.sigma**2)
    # measured: 1.00 and 1.09; 1.60 and 1.73 if the slopes were taken as exact
    assert 0.8 <= np.sqrt(np.mean(np.square(errors)) / np.mean(variances)) <= 1.2


def test_sigma_grows_with_the_stretch_of_the_subset() -> None:
    """Twice as long, the pattern is as well known as before, but a pixel of it is two."""
    rng = np.random.default_rng(9)
    size = {"width": 261, "height": 203}
    first = speckles(**size, seed=3)
    second = speckles(**size, seed=3, gradient=((0.9, 0.0), (0.0, 0.9)))
    first, second = (image + 0.5 * rng.normal(size=image.shape) for image in (first, second))
    middle = [130.0, 101.0] + 15.0 * np.stack(np.meshgrid([-2, -1, 0, 1, 2], [-1, 0, 1])).reshape(
        2, -1
    ).T
    truth = 0.9 * (middle - [130.0, 101.0])
    result = dic(first, second, subset=15, points=middle, guess=truth, apart_px=np.inf)
    assert result.ok.all()
    ratio = np.sqrt(((result.displacement - truth) ** 2).mean() / (result.sigma**2).mean())
    # measured over 20 noises: 0.97; 1.9 without the stretch
    assert 0.7 <= ratio <= 1.3


def test_a_region_is_four_whole_numbers() -> None:
    image = speckles(**SIZE)
    for region in ((5, 5, 60), (5.5, 5, 60, 60), "all"):
        with pytest.raises(InputError, match="roi: got"):
            dic(image, image, roi=region)  # type: ignore[arg-type]


def test_16_bit_float_and_contrast_change_give_the_same_motion() -> None:
    first, second = speckles(**SIZE), speckles(**SIZE, shift=(0.37, 0.81))
    base = dic(first, second, subset=21, step=11)
    scaled = dic(first, 0.45 * second + 30.0, subset=21, step=11)
    deep = dic(
        np.rint(first * 150).astype(np.uint16),
        (second * 1e-3).astype(np.float32),
        subset=21,
        step=11,
    )
    assert base.ok.all()
    assert np.abs(scaled.displacement - base.displacement).max() <= 1e-6
    assert np.abs(deep.displacement - base.displacement).max() <= 2e-4


GRADIENT = ((0.012, -0.02), (0.015, 0.006))


@pytest.mark.parametrize(
    ("shape", "rms"), [("translation", 0.1), ("rigid", 0.05), ("affine", 6e-4), ("quadratic", 9e-4)]
)
def test_affine_field(shape: str, rms: float) -> None:
    size = {"width": 97, "height": 83}
    result = dic(
        speckles(**size),
        speckles(**size, shift=(1.3, -0.6), gradient=GRADIENT),
        subset=31,
        step=7,
        roi=(7, 7, 89, 75),
        shape=shape,
    )
    centre = np.array([48.0, 41.0])
    truth = (result.points - centre) @ np.array(GRADIENT).T + [1.3, -0.6]
    good = result.ok
    assert good.all()
    error = result.displacement[good] - truth[good]
    assert np.sqrt((error**2).mean()) <= rms
    if shape == "affine":
        assert np.abs(result.gradient[good] - GRADIENT).max() <= 3e-4


def test_quadratic_sees_a_curved_field_that_affine_misses() -> None:
    """The pattern is a sum of waves, so that any warp of it is known exactly (point-sampled)."""

    def pattern(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return sum(
            np.sin(a * x + b * y + p)
            for a, b, p in ((0.5, 0.1, 0), (-0.2, 0.6, 1), (0.4, -0.45, 2), (0.15, 0.3, 3))
        )

    rows, columns = np.indices((63, 77), dtype=np.float64)
    curve = 0.002
    # x' = x + curve (x - 38)^2 has the inverse below; y stays
    inverse = 38 + (np.sqrt(1 + 4 * curve * (columns - 38)) - 1) / (2 * curve)
    points = np.array([[38.0, 31.0], [38.0, 26.0]])
    errors = {}
    for shape in ("affine", "quadratic"):
        result = dic(
            pattern(columns, rows), pattern(inverse, rows), subset=31, points=points, shape=shape
        )
        assert result.ok.all()
        errors[shape] = np.abs(result.displacement).max()
    assert errors["quadratic"] <= 5e-3
    assert errors["affine"] >= 20 * errors["quadratic"]


def test_large_motion_is_found_by_search_and_handed_on() -> None:
    size = {"width": 157, "height": 121}
    result = dic(
        speckles(**size), speckles(**size, shift=(14.3, -9.6)), subset=21, step=8, search_px=18
    )
    inside = (result.points[:, 0] + 14.3 + 10 <= 156) & (result.points[:, 1] - 9.6 - 10 >= 0)
    assert (result.ok == inside).mean() >= 0.97
    assert result.ok[inside].all()
    assert np.abs(result.displacement[result.ok] - [14.3, -9.6]).max() <= 3e-3
    assert set(result.status[~result.ok].tolist()) <= {Status.OUTSIDE, Status.NO_GUESS}


def test_motion_that_grows_beyond_the_first_part_of_the_deformed_image() -> None:
    """12 % stretch: the far points move by 28 px, start values reach 4 px, the crop 24 px."""
    size = {"width": 271, "height": 37, "sigma": 1.6}
    stretch = ((0.12, 0.0), (0.0, 0.0))
    first, second = speckles(**size), speckles(**size, shift=(16.2, 0.0), gradient=stretch)
    points = np.array([[x, 18.0] for x in range(12, 236, 4)])
    result = dic(first, second, subset=13, points=points, search_px=4)
    assert result.ok.all()
    truth = 16.2 + 0.12 * (points[:, 0] - 135.0)
    assert truth.max() >= 27.5
    assert np.abs(result.displacement[:, 0] - truth).max() <= 0.05
    assert np.abs(result.displacement[:, 1]).max() <= 0.05


def test_guess_replaces_the_search() -> None:
    size = {"width": 157, "height": 121}
    first, second = speckles(**size), speckles(**size, shift=(31.3, 3.6))
    points = np.array([[40.25, 60.5], [60.0, 40.75]])
    # a search for no motion and little around it finds nothing; the whole picture's shift does
    assert dic(first, second, subset=21, points=points, search_px=5).ok.all()
    far = dic(first, second, subset=21, points=points, guess=(0.0, 0.0))
    assert not far.ok.any()
    result = dic(first, second, subset=21, points=points, guess=(30.9, 4.0))
    assert result.ok.all()
    assert np.abs(result.displacement - [31.3, 3.6]).max() <= 5e-4


def test_points_that_cannot_be_measured_say_why_and_carry_no_number() -> None:
    first, second = speckles(117, 93), speckles(117, 93, shift=(0.4, 0.2))
    first[:40, :40] = 70.0
    second[:40, :40] = 70.0
    rng = np.random.default_rng(3)
    second[60:, :40] = rng.uniform(40, 160, (33, 40))
    points = np.array([[80.0, 50.0], [15.0, 15.0], [3.0, 50.0], [200.0, 50.0], [18.0, 78.0]])
    result = dic(first, second, subset=21, points=points, guess=(0.0, 0.0))
    assert result.status[:4].tolist() == [
        Status.OK,
        Status.NO_TEXTURE,
        Status.OUTSIDE,
        Status.OUTSIDE,
    ]
    assert result.status[4] in (Status.LOW_CORRELATION, Status.NOT_CONVERGED)
    for values in (result.displacement, result.gradient, result.sigma):
        assert np.isfinite(values[0]).all()
        assert np.isnan(values[1:]).all()
    assert result.counts()["OK"] == 1


def test_all_points_may_be_outside() -> None:
    image = speckles(117, 93)
    result = dic(image, image, subset=21, points=[[500.0, 50.0], [-30.0, 20.0]])
    assert (result.status == Status.OUTSIDE).all() and np.isnan(result.displacement).all()


def test_one_direction_only_is_no_texture() -> None:
    stripes = np.tile(np.sin(0.5 * np.arange(57)), (33, 1))
    result = dic(stripes, stripes, subset=15, step=6)
    assert (result.status == Status.NO_TEXTURE).all()


def test_flat_images_are_no_texture() -> None:
    result = dic(np.full((33, 57), 80, np.uint8), np.full((33, 57), 80, np.uint8), subset=15)
    assert (result.status == Status.NO_TEXTURE).all()


@pytest.mark.parametrize("use_mask", [True, False])
def test_mask_keeps_what_does_not_move_out(use_mask: bool) -> None:
    height, width = 61, 87
    moving, still = speckles(width, height, seed=4), speckles(width, height, seed=9)
    moved = speckles(width, height, seed=4, shift=(1.6, 0.0))
    rows = np.arange(height)[:, None]
    own = (rows >= 20) & (rows <= 40) & np.ones((1, width), dtype=bool)
    first, second = np.where(own, moving, still), np.where(own, moved, still)
    result = dic(
        first,
        second,
        subset=31,
        points=[[40.0, 30.0], [46.0, 30.0]],
        guess=(1.5, 0.0),
        mask=own if use_mask else None,
        shape="translation",
        min_zncc=0.0,
    )
    error = np.abs(result.displacement - [1.6, 0.0]).max()
    assert error <= 5e-4 if use_mask else not error <= 5e-4


def test_a_window_of_weights_and_a_round_one() -> None:
    first, second = speckles(**SIZE), speckles(**SIZE, shift=(0.37, 0.81))
    offset = np.arange(21) - 10
    weights = np.exp(-0.5 * (offset[:, None] ** 2 + offset[None, :] ** 2) / 25.0)
    for window in ("round", weights):
        result = dic(first, second, subset=21, step=15, roi=(6, 6, 110, 86), window=window)
        assert np.abs(result.displacement - [0.37, 0.81]).max() <= 5e-4


def test_grid_covers_the_region_and_nothing_else() -> None:
    points = grid_points((33, 57), subset=11, step=4, roi=(6, 3, 50, 30))
    assert points.min(axis=0).tolist() == [11, 8]
    assert points.max(axis=0).tolist() == [43, 24]
    assert len(points) == 9 * 5


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"subset": 20}, "subset"),
        ({"subset": 21.0}, "subset"),
        ({"subset": 63}, "roi"),
        ({"step": 0}, "step"),
        ({"roi": (0, 0, 57, 20)}, "roi"),
        ({"shape": "cubic"}, "shape"),
        ({"window": "hexagon"}, "window"),
        ({"window": np.ones((3, 3))}, "window"),
        ({"window": np.full((15, 15), np.nan)}, "window"),
        ({"mask": np.ones((57, 33), dtype=bool)}, "mask"),
        ({"mask": np.ones((33, 57))}, "mask"),
        ({"points": np.zeros((0, 2))}, "points"),
        ({"points": [[np.nan, 3.0]]}, "points"),
        ({"guess": [1.0, 2.0, 3.0]}, "guess"),
        ({"guess": [np.inf, 2.0]}, "guess"),
        ({"tolerance": float("nan")}, "tolerance"),
        ({"max_iterations": 0}, "max_iterations"),
        ({"min_zncc": float("nan")}, "min_zncc"),
        ({"search_px": 0}, "search_px"),
        ({"blur_px": -1.0}, "blur_px"),
    ],
)
def test_wrong_arguments_name_themselves(change: dict[str, object], words: str) -> None:
    image = speckles(57, 33)
    with pytest.raises(InputError, match=words):
        dic(image, image, **{"subset": 15, **change})
