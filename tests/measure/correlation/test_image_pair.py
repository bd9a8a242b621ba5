"""Images larger than what a device takes at once."""

from __future__ import annotations

import gc

import numpy as np
import pytest

from gpusim.errors import InputError
from gpusim.gpu import Device, compare
from gpusim.measure import SplineImage, Status, dic
from gpusim.measure.correlation import icgn as stage
from gpusim.measure.correlation.icgn import correlate, correlate_numpy
from gpusim.measure.correlation.image_pair import Limits, Pair, Sampled, Subsets, plan_tiles
from gpusim.measure.correlation.matching import Correlation, Settings

SMALL = Limits(side=128, pixels=128 * 128)


def pattern(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Waves, known everywhere: moved images need no interpolation."""
    waves = ((0.5, 0.1, 0), (-0.2, 0.6, 1), (0.4, -0.45, 2), (0.15, 0.3, 3))
    result: np.ndarray = sum(np.sin(a * x + b * y + p) for a, b, p in waves)
    return result


def images(width: int, height: int, stretch: float = 0.01) -> tuple[np.ndarray, np.ndarray]:
    """The pattern, and the pattern moved by stretch x + 1.3 in x and by -0.6 in y."""
    row, column = np.indices((height, width), dtype=np.float64)
    moved = 0.7 * pattern((column - 1.3) / (1 + stretch), row + 0.6) + 3.0
    return pattern(column, row), moved


def case() -> Subsets:
    first, second = images(311, 173)
    points = np.array([[x + 0.3, y - 0.2] for y in range(14, 160, 13) for x in range(12, 300, 11)])
    start = np.zeros((len(points), 2, 6))
    start[:, 0, 0] = 0.01 * points[:, 0] + 1.0
    return Subsets(
        Pair(SplineImage.from_image(first), SplineImage.from_image(second)), points, start
    )


def equal(got: Correlation, want: Correlation) -> bool:
    return all(
        np.array_equal(getattr(got, name), getattr(want, name), equal_nan=True)
        for name in ("coefficients", "zncc", "sigma", "iterations", "status")
    )


def test_tiles_change_nothing(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    subsets, settings = case(), Settings(np.ones((21, 21)), max_move=5.0)
    whole = correlate(subsets, settings, device)
    assert (whole.status == Status.OK).mean() >= 0.9
    monkeypatch.setattr(stage, "correlate_numpy", lambda *_: pytest.fail("left its tile"))
    inner = np.all(np.abs(subsets.points - [155, 86]) <= [135, 66], axis=1)
    inside = Subsets(subsets.pair, subsets.points[inner], subsets.start[inner])
    assert equal(correlate(inside, settings, device, SMALL), correlate(inside, settings, device))
    monkeypatch.setattr(stage, "DISPATCH", 7)
    assert equal(correlate(inside, settings, device, SMALL), correlate(inside, settings, device))


def test_what_leaves_its_tile_or_the_image_is_left_to_the_twin(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    subsets, settings = case(), Settings(np.ones((21, 21)), max_move=20.0)
    subsets.start[5, :, 1:3] = [[40.0, 0.0], [0.0, 40.0]]  # five times too large
    subsets.start[17, :, 0] = [-200.0, 4.0]
    subsets.start[23, :, 0] = [4e8, 4.0]
    left = []

    def spy(some: Subsets, settings: Settings) -> Correlation:
        left.append(len(some.points))
        return correlate_numpy(some, settings)

    monkeypatch.setattr(stage, "correlate_numpy", spy)
    got, want = correlate(subsets, settings, device, SMALL), correlate_numpy(subsets, settings)
    assert len(left) == 1 and 1 <= left[0] <= 60
    compare("status", got.status, want.status, "exact")
    assert {Status.OK, Status.OUTSIDE} <= set(want.status.tolist())
    good = want.status == Status.OK
    compare("warp", got.coefficients[good], want.coefficients[good], atol=2e-5, rtol=0)
    assert np.array_equal(np.isnan(got.zncc), np.isnan(want.zncc))


def test_every_subset_is_in_one_tile_that_holds_it() -> None:
    subsets = case()
    rng = np.random.default_rng(2)
    centre = np.rint(subsets.points).astype(np.int64)
    begin = centre + rng.integers(-300, 300, centre.shape)  # neighbours far apart
    half, reach = 10, 40
    tiles = list(
        plan_tiles(subsets.pair.reference, subsets.pair.deformed, centre, begin, half, reach, SMALL)
    )
    assert len(tiles) > 6
    assert sorted(np.concatenate([t.which for t in tiles])) == list(range(len(centre)))
    rows, columns = subsets.pair.deformed.coefficients.shape
    for tile in tiles:
        for box in (tile.reference, tile.deformed):
            assert 0 < box[2] - box[0] <= 128 and 0 < box[3] - box[1] <= 128
        low, high = np.array(tile.reference[:2]), np.array(tile.reference[2:])
        assert (centre[tile.which] - half >= low).all()
        assert (centre[tile.which] + half < high).all()
        near = np.clip(begin[tile.which], 0, [columns - 1, rows - 1])
        assert (np.maximum(near - reach, 0) >= tile.deformed[:2]).all()
        assert (np.minimum(near + reach, [columns - 1, rows - 1]) < tile.deformed[2:]).all()


def test_textures_are_kept_within_their_budget(device: Device) -> None:
    subsets, settings = case(), Settings(np.ones((21, 21)))
    budget = 4 * 129 * 129 * 16
    limits = Limits(side=128, pixels=128 * 128, cached=budget)
    gc.collect()  # textures of earlier tests may go only now
    before = device.allocated
    want = correlate(subsets, settings, device, SMALL)
    assert device.allocated - before > budget  # all of them
    pair = Pair(subsets.pair.reference, subsets.pair.deformed)
    again = Subsets(pair, subsets.points, subsets.start)
    middle = device.allocated
    assert equal(correlate(again, settings, device, limits), want)
    assert device.allocated - middle <= budget


def test_an_image_wider_than_any_texture(device: Device) -> None:
    first, second = images(9001, 61, stretch=0.001)
    points = np.array([[x, 30.0] for x in range(40, 8980, 97)])
    guess = np.column_stack([0.001 * points[:, 0] + 1.3, np.full(len(points), -0.6)]) + 0.3
    result = dic(first, second, subset=21, points=points, guess=guess, device=device)
    assert result.ok.all()
    assert np.abs(result.displacement - guess + 0.3).max() <= 2e-3


@pytest.mark.parametrize("values", [np.zeros((5, 7)), np.zeros((0, 7), np.float32)])
def test_pictures_of_another_kind_are_refused(device: Device, values: np.ndarray) -> None:
    with pytest.raises(InputError, match="test"):
        Sampled(device, values, "test")
