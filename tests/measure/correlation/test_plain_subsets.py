"""Backgrounds of noise are told from patterns, and not tried."""

from __future__ import annotations

import numpy as np
import pytest

from gpusim.measure import Status, dic, grid_points
from gpusim.measure.correlation import propagation
from gpusim.measure.correlation.plain_subsets import neighbour_differences, plain_subsets
from tests.support.measure_images import speckles

NOISE = 3.0
ROI = (4, 4, 326, 168)


def plate_before_a_wall(light: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Speckle in the left half, moved by (1.3, -0.6) px; a wall with a ramp of light beside it."""
    row, column = np.indices((173, 331), dtype=np.float64)
    rng, images = np.random.default_rng(5), []
    for shift, edge in (((0.0, 0.0), 150.0), ((1.3, -0.6), 151.3)):
        wall = 90.0 + light * column + 0.5 * light * row
        image = np.where(column < edge, speckles(331, 173, shift=shift), wall)
        images.append(np.clip(np.rint(image + NOISE * rng.normal(size=image.shape)), 0, 255))
    before, after = (image.astype(np.uint8) for image in images)
    return before, after


@pytest.fixture
def tried(monkeypatch: pytest.MonkeyPatch) -> list[np.ndarray]:
    """Points (K, 2) px of each attempt to match some."""
    tried: list[np.ndarray] = []
    attempt = propagation.Front.attempt

    def counted(self: propagation.Front, which: np.ndarray, *rest: object, **more: object) -> None:
        tried.append(self.points[which])
        attempt(self, which, *rest, **more)  # type: ignore[arg-type]

    monkeypatch.setattr(propagation.Front, "attempt", counted)
    return tried


@pytest.mark.parametrize("light", [0.0, 0.2])
def test_a_wall_is_without_texture_and_nothing_is_tried_there(
    tried: list[np.ndarray], light: float
) -> None:
    before, after = plate_before_a_wall(light)
    result = dic(before, after, subset=21, step=6, roi=ROI, backend="numpy")
    x = result.points[:, 0]
    wall, plate = x > 165, x < 135
    assert (result.status[wall] == Status.NO_TEXTURE).mean() >= 0.99
    assert result.ok[plate].all()
    # one point in 64 is a seed, searched before anything is known, and a few aren't told
    number = sum(int((points[:, 0] > 165).sum()) for points in tried)
    assert number <= 0.1 * wall.sum()


def test_what_sees_the_plate_from_the_wall_is_told_before_it_is_tried(
    tried: list[np.ndarray],
) -> None:
    """Without that, they take most of the time, and some don't converge."""
    before, after = plate_before_a_wall()
    settings = {"subset": 21, "step": 6, "roi": ROI, "backend": "numpy"}
    result, blind = (dic(before, after, apart_px=a, **settings) for a in (0.1, np.inf))
    x = result.points[:, 0]
    beside = (x > 154) & (x < 165)
    assert beside.sum() >= 20
    assert (result.status[beside] == Status.NO_TEXTURE).all()
    assert result.ok[x < 138].all()
    # whoever doesn't ask for what parts of subsets see gets what can be matched
    assert blind.ok[beside].mean() >= 0.3
    tried.clear()
    dic(before, after, **settings)
    number = sum(int(((p[:, 0] > 154) & (p[:, 0] < 165)).sum()) for p in tried)
    assert number <= 0.2 * beside.sum()


def test_noise_that_matches_is_a_pattern() -> None:
    """Pixels drawn one by one, as white as noise can be, that moved by whole pixels."""
    first = np.random.default_rng(8).integers(20, 230, (140, 190)).astype(np.uint8)
    second = np.roll(first, (2, 3), axis=(0, 1))
    result = dic(first, second, subset=21, step=6, roi=(6, 6, 180, 130), backend="numpy")
    assert result.ok.all() and np.abs(result.displacement - [3, 2]).max() < 0.01


def test_white_noise_of_the_known_strength_is_plain_and_patterns_are_not() -> None:
    points = grid_points((173, 331), subset=21, step=8)

    def plain(image: np.ndarray) -> np.ndarray:
        return plain_subsets(neighbour_differences(image, points, 10), NOISE**2)

    noise = NOISE * np.random.default_rng(1).normal(size=(173, 331))
    assert plain(100 + noise).mean() >= 0.98
    assert plain(100 + 0.0 * noise).all()
    assert not plain(100 + 3.0 * noise).any()  # too strong
    pattern = speckles(331, 173)
    weak = pattern * (2.0 * NOISE / pattern.std())
    assert not plain(weak + noise).any()


def test_what_is_masked_altogether_is_not_tried(tried: list[np.ndarray]) -> None:
    before, after = plate_before_a_wall()
    mask = np.zeros(before.shape, dtype=bool)
    mask[:, :150] = True
    result = dic(before, after, subset=21, step=6, roi=ROI, mask=mask, backend="numpy")
    x = result.points[:, 0]
    assert (result.status[x > 161] == Status.MASKED).all()
    assert result.ok[x < 135].all()
    assert max(points[:, 0].max(initial=0) for points in tried) < 162
