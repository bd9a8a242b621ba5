"""Markers on exactly area-sampled boards."""

from __future__ import annotations

import numpy as np
import pytest

from gpusim.errors import InputError
from gpusim.measure import MarkerStatus, find_markers, locate_markers
from gpusim.measure.targets.noise import allowed_residual, noise_level
from tests.support.measure_images import Marker, Waves, blurred_board, board


def row_of(size: float, degrees: float, count: int = 3) -> list[Marker]:
    rng = np.random.default_rng(int(10 * size + degrees))
    return [
        Marker(40 + 70 * i + rng.uniform(), 40 + rng.uniform() + i, size, size, np.radians(degrees))
        for i in range(count)
    ]


@pytest.mark.parametrize("size", [13.0, 19.4, 28.0])
@pytest.mark.parametrize("degrees", [0.0, 0.5, 4.0, -20.0, 44.0])
def test_centres_sizes_and_angles(size: float, degrees: float) -> None:
    markers = row_of(size, degrees)
    found = find_markers(board(220, 84, markers), (size - 2, size + 2))
    assert found.ok.all() and len(found.points) == 3
    found_at = found.points[np.argsort(found.points[:, 0])]
    error = found_at - [[m.x, m.y] for m in markers]
    assert np.abs(error).max() <= 0.003  # measured: 0.0011
    assert np.abs(found.size - size).max() <= 0.2  # ends are read off, not fitted
    assert np.abs(np.degrees(found.angle) - degrees).max() <= 0.02
    assert np.abs(found.contrast - 87.5).max() <= 0.5
    assert found.residual.max() <= 0.006


@pytest.mark.parametrize("blur", [0.0, 0.7])
def test_8_bits_light_falloff_and_lens_blur(blur: float) -> None:
    markers = row_of(19.0, 3.0)
    image = blurred_board(220, 84, markers, blur) if blur else board(220, 84, markers)
    image = image * (1.0 - 0.0015 * np.arange(220)[None, :])
    found = find_markers(np.rint(image).astype(np.uint8), (15, 24))
    error = found.points[np.argsort(found.points[:, 0])] - [[m.x, m.y] for m in markers]
    assert np.abs(error).max() <= 0.004  # measured: 0.0013


def test_a_small_marker_between_four_pixels_of_a_large_range_is_found() -> None:
    for size in (10.6, 13.0, 16.0):
        markers = [Marker(40.5, 40.5, size, size, 0.0), Marker(110.5, 40.5, size, size, 0.0)]
        found = find_markers(board(150, 84, markers), (10.0, 20.8))
        assert len(found.points) == 2
        assert np.abs(np.sort(found.points[:, 0]) - [40.5, 110.5]).max() <= 0.003


@pytest.mark.parametrize("size", [10.2, 13.0])
@pytest.mark.parametrize("angle", [0.0, 0.05])
def test_markers_right_on_a_pixel_are_found(size: float, angle: float) -> None:
    """The picture is flat around there: Newton's steps swing from one side to the other."""
    for x, y in ((30.0, 30.0), (30.0, 30.02), (29.99, 30.0), (30.0, 30.25)):
        image = board(60, 60, [Marker(x, y, size, size, angle)])
        found = locate_markers(image, [[x, y]], (10.0, 1.3 * size), 8.0)
        assert found.ok.all() and np.abs(found.points - [x, y]).max() <= 0.003


def test_what_is_no_marker_is_not_reported() -> None:
    """Plain squares, stripes, a big checker and a marker of another size."""
    pieces = [
        Marker(40, 40, 20, 20, 0.1, white=200, black=200),
        Marker(100, 40, 56, 56, 0.05),
        Marker(170, 40, 9, 9, 0.1),
    ]
    image = board(240, 84, pieces)
    image[10:70, 200:235] = np.where(np.arange(35) // 9 % 2, 30.0, 200.0)
    assert len(find_markers(image, (17, 24)).points) == 0
    assert len(find_markers(np.full((57, 83), 9, np.uint8), (17, 24)).points) == 0


def test_polarity_is_told() -> None:
    markers = [Marker(40.3, 40.6, 20, 20, 0.1), Marker(110.2, 40.1, 20, 20, 0.1, 35.0, 210.0)]
    found = find_markers(board(150, 84, markers), (17, 24))
    by_x = np.argsort(found.points[:, 0])
    assert np.sign(found.contrast[by_x]).tolist() == [1.0, -1.0]


def test_locate_keeps_the_order_and_gives_a_status_to_each() -> None:
    markers = row_of(19.0, 4.0)
    places = np.array([[m.x, m.y] for m in markers])
    expected = np.array(
        [places[2] + [3, -2], places[0] + [-4, 4], [75.0, 70.0], [500.0, 10.0], places[1] + [0, 5]]
    )
    found = locate_markers(board(220, 84, markers), expected, (16, 22), 8.0)
    assert found.status.tolist() == [
        MarkerStatus.FOUND,
        MarkerStatus.FOUND,
        MarkerStatus.NOT_FOUND,
        MarkerStatus.OUTSIDE,
        MarkerStatus.FOUND,
    ]
    assert np.abs(found.points[found.ok] - places[[2, 0, 1]]).max() <= 0.003
    assert np.isnan(found.points[~found.ok]).all() and np.isnan(found.size[~found.ok]).all()


def test_two_candidates_or_one_claimed_twice_are_ambiguous() -> None:
    markers = [Marker(40.2, 40.4, 19, 19), Marker(66.1, 40.9, 19, 19)]
    image = board(120, 84, markers)
    near_both = locate_markers(image, [[53.0, 40.0]], (16, 22), 20.0)
    assert near_both.status.tolist() == [MarkerStatus.AMBIGUOUS]
    claimed = locate_markers(image, [[38.0, 40.0], [43.0, 41.0]], (16, 22), 6.0)
    assert claimed.status.tolist() == [MarkerStatus.AMBIGUOUS] * 2
    assert np.isnan(claimed.points).all()


def test_wrong_arguments_name_themselves() -> None:
    image = board(83, 57, [])
    with pytest.raises(InputError, match="size_px"):
        find_markers(image, (24, 17))
    with pytest.raises(InputError, match="size_px"):
        find_markers(image, (float("nan"), 17))
    with pytest.raises(InputError, match="expected"):
        locate_markers(image, [[np.nan, 3.0]], (17, 24), 5.0)
    with pytest.raises(InputError, match="search_px"):
        locate_markers(image, [[3.0, 3.0]], (17, 24), 0.0)


@pytest.mark.parametrize("noise", [18.0, 24.0])
def test_markers_are_found_in_noise_of_a_tenth_of_their_step(noise: float) -> None:
    """What a fit may leave grows with the picture's noise: of 20 markers none was found before."""
    rng = np.random.default_rng(6)
    places = np.array([[30.0 + 38 * i, 32.0 + 40 * j] for j in range(4) for i in range(5)])
    places += rng.uniform(-0.5, 0.5, places.shape)
    turns = rng.uniform(-0.6, 0.6, len(places))
    clean = board(215, 190, [Marker(*p, 24.0, 24.0, t) for p, t in zip(places, turns, strict=True)])
    image = np.clip(np.rint(clean + noise * rng.normal(size=clean.shape)), 0, 255).astype(np.uint8)
    found = locate_markers(image, places + 0.6, (21.0, 27.0), 8.0)
    assert found.ok.mean() >= 0.9
    assert np.nanmax(np.abs(found.points - places)) <= 0.3
    everywhere = find_markers(image, (21.0, 27.0)).points
    apart = np.linalg.norm(everywhere[:, None] - places, axis=2)
    assert len(everywhere) >= 18 and apart.min(axis=1).max() <= 1.0


def test_noise_and_speckle_are_no_markers() -> None:
    rng = np.random.default_rng(2)
    y, x = np.indices((150, 210), dtype=np.float64)
    for image in (
        128 + 25 * rng.normal(size=x.shape),
        Waves(3).at(x, y) + 8 * rng.normal(size=x.shape),
    ):
        picture = np.clip(np.rint(image), 0, 255).astype(np.uint8)
        assert len(find_markers(picture, (16.0, 24.0)).points) == 0


def test_noise_is_that_of_flat_parts() -> None:
    rng = np.random.default_rng(9)
    clean = board(160, 120, [Marker(50, 60, 40, 40, 0.2), Marker(110, 60, 40, 40, -0.2)])
    for noise in (2.0, 9.0):
        level = noise_level((clean + noise * rng.normal(size=clean.shape)).astype(np.float32))
        assert 0.85 * noise <= level <= 1.05 * noise
    assert noise_level(np.zeros((5, 40), dtype=np.float32)) == 0.0
    assert allowed_residual(0.15, 0.0, 0.4) == pytest.approx(0.15)
    assert allowed_residual(0.15, 0.1, -0.5) == pytest.approx(np.hypot(0.15, 0.26))
    assert allowed_residual(0.15, 0.3, 0.5) == pytest.approx(0.15)  # all noise
