"""Splits by structure, and where pictures are cut."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from gpusim.studies.dataset.splits import crop_windows, split_of_structures

SHARES = {"train": 0.8, "val": 0.1, "test": 0.1}


def test_equal_structures_have_exactly_their_shares() -> None:
    structures = [f"s{k % 20}" for k in range(500)]
    found = split_of_structures(structures, SHARES)
    assert Counter(found.values()) == {"train": 16, "val": 2, "test": 2}


@pytest.mark.parametrize("seed", range(20))
def test_no_split_misses_its_share_by_more_than_the_largest_structure(seed: int) -> None:
    generator = np.random.default_rng(seed)
    structures = [f"s{k}" for k in range(30) for _ in range(generator.integers(1, 40))]
    found = split_of_structures(structures, SHARES, seed)
    counts = Counter(found[one] for one in structures)
    largest = max(Counter(structures).values())
    for name, share in SHARES.items():
        assert abs(counts[name] - share * len(structures)) <= largest


def test_splits_depend_on_the_structures_and_the_seed_alone() -> None:
    structures = [f"s{k % 20}" for k in range(100)]
    found = split_of_structures(structures, SHARES)
    assert found == split_of_structures(structures[::-1], SHARES)
    others = [split_of_structures(structures, SHARES, seed) for seed in range(1, 6)]
    assert all(found != other for other in others)


def test_crops_at_random_places_lie_inside_and_come_again() -> None:
    found = crop_windows((80, 60), (32, 24), 400, 1, "item")
    left, top, width, height = np.array(found).T
    assert (left.min(), left.max(), top.min(), top.max()) == (0, 48, 0, 36)
    assert set(width) == {32} and set(height) == {24}
    assert found == crop_windows((80, 60), (32, 24), 400, 1, "item")
    assert found != crop_windows((80, 60), (32, 24), 400, 2, "item")
    assert found != crop_windows((80, 60), (32, 24), 400, 1, "another")


def test_a_grid_of_crops_covers_each_pixel_once_at_most() -> None:
    cover = np.zeros((60, 80), int)
    for left, top, width, height in crop_windows((80, 60), (32, 24), "grid", 0, ""):
        assert (width, height) == (32, 24)
        cover[top : top + height, left : left + width] += 1
    assert cover.max() == 1 and cover.sum() == 4 * 32 * 24
    np.testing.assert_array_equal(cover, cover[::-1, ::-1])


def test_without_a_size_the_picture_is_whole() -> None:
    assert crop_windows((80, 60), None, "grid", 0, "") == [(0, 0, 80, 60)]
