"""Slope changes: found where they are, as sure as they say, and none where there is none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gpusim.errors import InputError
from gpusim.measure import difference_curve, slope_changes

X = np.linspace(8.0, 792.0, 57)


def bent(places: tuple[float, ...], changes: tuple[float, ...]) -> np.ndarray:
    return (
        0.3
        - 1e-4 * X
        + sum(c * np.maximum(X - p, 0.0) for p, c in zip(places, changes, strict=True))
    )


@pytest.mark.parametrize("count", [1, 2, 3])
def test_breaks_of_a_perfect_line_are_found_exactly(count: int) -> None:
    places, changes = (203.0, 391.0, 610.0)[:count], (1.4e-3, 9e-4, 4.5e-4)[:count]
    found = slope_changes(X, bent(places, changes))
    assert np.abs(found.position - places).max() <= 1e-4
    assert np.abs(found.change - changes).max() <= 1e-8
    assert found.p_value.max() <= 1e-20
    assert np.abs(found.at(X) - bent(places, changes)).max() <= 1e-9


def test_points_close_to_a_break_need_not_count() -> None:
    """Stress that flows round a notch bends the line within a depth of it: no broken line there."""
    places, changes = (203.0, 391.0), (1.4e-3, 9e-4)
    local = sum(
        2e-4 * np.exp(-np.abs(X - place) / 6.0) * (1 + np.tanh((X - place) / 10.0))
        for place in places
    )
    y = bent(places, changes) + np.where(local > 1e-6, local, 0.0)
    plain, clear = slope_changes(X, y), slope_changes(X, y, clearance=40.0)
    assert np.abs(plain.position - places).min() >= 0.01
    assert np.abs(clear.position - places).max() <= 1e-4
    assert np.abs(clear.change - changes).max() <= 1e-8
    assert np.abs(clear.x[:, None] - places).min() >= 40.0
    # as far as there is room: three points on each piece
    far = slope_changes(X, y, clearance=1e4)
    for low, high in ((0.0, 203.0), (203.0, 391.0), (391.0, 800.0)):
        assert np.count_nonzero((far.x > low) & (far.x < high)) >= 3
    with pytest.raises(InputError, match="clearance -1"):
        slope_changes(X, y, clearance=-1.0)


def test_stated_uncertainty_is_the_scatter() -> None:
    rng, scores = np.random.default_rng(1), []
    for _ in range(60):
        y = bent((200.0, 480.0), (1.4e-3, -9e-4)) + rng.normal(0, 0.003, len(X))
        found = slope_changes(X, y)
        assert len(found.position) == 2
        scores.append((found.position - [200.0, 480.0]) / found.sigma)
        scores.append((found.change - [1.4e-3, -9e-4]) / found.change_sigma)
    assert 0.8 <= np.sqrt(np.mean(np.square(scores))) <= 1.25


def test_noise_alone_has_no_breaks() -> None:
    rng = np.random.default_rng(2)
    found = [len(slope_changes(X, rng.normal(0, 1, len(X))).position) for _ in range(100)]
    # the best of some hundred places is tested at 0.1 %
    assert np.mean(found) <= 0.1


def test_small_and_close_changes_are_left_out() -> None:
    y = bent((200.0, 500.0), (1e-3, 4e-5))
    assert len(slope_changes(X, y).position) == 1
    assert len(slope_changes(X, y, least_share=0.01).position) == 2
    near = slope_changes(X, bent((200.0, 215.0), (1e-3, 1e-3)), least_gap=60.0)
    assert (np.diff(near.position) >= 59.9).all()


def test_unmeasured_points_don_t_count(tmp_path: Path) -> None:
    y = bent((200.0,), (1e-3,))
    y[[3, 20, 40]] = np.nan
    found = slope_changes(X[::-1], y[::-1])
    assert abs(found.position[0] - 200.0) <= 1e-4 and len(found.x) == 54
    found.write_csv(tmp_path / "breaks.csv")
    lines = (tmp_path / "breaks.csv").read_text().splitlines()
    assert lines[0].startswith("position,sigma") and lines[1].startswith("200,")
    with pytest.raises(InputError, match="got 4 measured points"):
        slope_changes(X[:5], y[:5])
    with pytest.raises(InputError, match="significance 2"):
        slope_changes(X, y, significance=2)


def test_difference_is_taken_at_the_same_places() -> None:
    x, y = np.array([1.0, 2.0, 3.5, 9.0]), np.array([5.0, np.nan, 7.0, 8.0])
    same = difference_curve(x, y, x, np.ones(4))
    assert np.isnan(same[1]) and same[[0, 2, 3]].tolist() == [4.0, 6.0, 7.0]
    other = difference_curve(x, y, [0.0, 2.0, 4.0], [0.0, np.nan, 4.0])
    assert np.isnan(other[[1, 3]]).all() and other[[0, 2]].tolist() == [4.0, 3.5]
    with pytest.raises(InputError, match="one length"):
        difference_curve(x, y[:2], x, y)


def test_a_state_like_the_reference_has_no_damage() -> None:
    found = slope_changes(np.linspace(0.0, 800.0, 57), np.zeros(57))
    assert found.position.size == 0 and found.residual == 0.0


def test_a_break_is_found_where_it_is_far_from_zero() -> None:
    """Coordinates of a survey, in mm: the same break as at zero."""
    x = np.linspace(8.0, 792.0, 57)
    noise = 3e-4 * np.random.default_rng(5).normal(size=57)
    y = 0.8 + 1e-3 * x + 2e-3 * np.maximum(x - 301.7, 0.0) + noise
    here, there = (slope_changes(x + by, y) for by in (0.0, 5e8))
    assert len(here.position) == 1
    np.testing.assert_allclose(there.position - 5e8, here.position, atol=1e-6)
    np.testing.assert_allclose(there.change, here.change, rtol=1e-7)
    np.testing.assert_allclose(there.fitted, here.fitted, atol=1e-9)
    assert here.position[0] == pytest.approx(301.7, abs=1.0)
