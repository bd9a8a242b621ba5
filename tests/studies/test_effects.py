"""Main effects, interactions and Sobol indices against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import qmc, sobol_indices

from gpusim.studies.effects import (
    MOST_LEVELS,
    association,
    effect,
    interaction,
    levels_of,
    response,
    sobol,
)
from gpusim.studies.table import SampleTable
from tests.studies.tables import table_of


def ishigami(x: np.ndarray) -> np.ndarray:
    """Of points in [-pi, pi]³; Ishigami and Homma, 1990."""
    return np.sin(x[..., 0]) * (1.0 + 0.1 * x[..., 2] ** 4) + 7.0 * np.sin(x[..., 1]) ** 2


def at_saltelli_points(count: int) -> np.ndarray:
    """(5, N) values."""
    points = 2.0 * np.pi * (qmc.Sobol(6, rng=np.random.default_rng(3)).random(count) - 0.5)
    a, b = points[:, :3], points[:, 3:]
    mixed = [np.where(np.arange(3) == k, b, a) for k in range(3)]
    return np.stack([ishigami(one) for one in (a, b, *mixed)])


def test_sobol_indices_of_a_known_function() -> None:
    """Saltelli et al., Global Sensitivity Analysis, 2008: 0.3139, 0.4424, 0 and 0.5576, 0.4424,
    0.2437."""
    found = sobol(at_saltelli_points(4096), ("one", "two", "three"))
    assert found.first == pytest.approx([0.3139, 0.4424, 0.0], abs=0.02)
    assert found.total == pytest.approx([0.5576, 0.4424, 0.2437], abs=0.02)
    for values, interval in (
        (found.first, found.first_interval),
        (found.total, found.total_interval),
    ):
        assert np.all(interval[:, 0] < values) and np.all(values < interval[:, 1])


def test_sobol_indices_are_those_of_scipy() -> None:
    values = at_saltelli_points(256)
    peer = sobol_indices(
        func={"f_A": values[:1], "f_B": values[1:2], "f_AB": values[2:, None]}, n=256
    )
    found = sobol(values, ("one", "two", "three"))
    np.testing.assert_allclose(found.first, peer.first_order, atol=1e-12)
    np.testing.assert_allclose(found.total, peer.total_order, atol=1e-12)


def test_points_without_a_value_are_left_out() -> None:
    values = at_saltelli_points(256)
    values[3, 100] = np.nan
    kept = np.delete(values, 100, axis=1)
    found, expected = (sobol(one, ("one", "two", "three")) for one in (values, kept))
    assert found.points == 255
    np.testing.assert_array_equal(found.first, expected.first)
    for few in (values[:, :1], values[:, :0], np.zeros((5, 8))):
        assert np.isnan(sobol(few, ("one", "two", "three")).first).all()


def errors(size: int = 4000) -> tuple[SampleTable, np.ndarray]:
    """Normal errors whose standard deviation is 1, 2 and 3 at three values of "a", and on which "b"
    has no bearing."""
    rng = np.random.default_rng(1)
    a, b = rng.choice([1.0, 2.0, 3.0], size), rng.random(size)
    table = table_of({"a": a, "b": b}, {("m: e", "mm"): a * rng.normal(size=size)})
    return table, a


def test_main_effect_is_the_rms_error_at_each_level() -> None:
    table, _ = errors()
    values, is_error = response(table, ("m: e", "mm"))
    strong, weak = (effect(values, levels_of(table, one), is_error) for one in ("a", "b"))
    assert strong.levels.labels == ("1", "2", "3")
    assert np.all(np.abs(strong.values - [1, 2, 3]) < 3 * strong.sigmas)
    # of a normal error's RMS: sigma / sqrt(2 n)
    expected = np.array([1, 2, 3]) / np.sqrt(2 * strong.counts)
    assert strong.sigmas == pytest.approx(expected, rel=0.1)
    # between levels: variance of a² = 32/3 - 14²/9 · … of chi-squared within: 2 a⁴
    between = np.var([1.0, 4.0, 9.0])
    assert strong.share == pytest.approx(between / (between + 2 * np.mean([1, 16, 81])), abs=0.03)
    assert len(weak.levels.labels) == MOST_LEVELS and weak.share < 0.01


def test_interaction_is_the_effect_at_each_level_of_the_other() -> None:
    table, a = errors()
    values, _ = response(table, ("m: e", "mm"))
    shape = np.where(a > 1.5, "coarse", "fine")
    table = table_of({"a": a, "shape": shape}, {("m: e", "mm"): values})
    coarse, fine = interaction(values, levels_of(table, "a"), levels_of(table, "shape"), True)
    assert np.isnan(coarse.values[0]) and coarse.values[1] == pytest.approx(2, rel=0.1)
    assert fine.values[0] == pytest.approx(1, rel=0.1) and np.isnan(fine.values[1:]).all()
    assert not levels_of(table, "shape").are_numbers


def test_parameters_that_go_together() -> None:
    """Crossed ones don't, whatever chance does; of one by the other, they do wholly."""
    rng = np.random.default_rng(5)
    a, b, few = rng.integers(3, size=60), rng.random(60), rng.random((2, 40))
    table = table_of({"a": a, "b": b, "c": 2 * a}, {("m: e", "mm"): b})
    one, other, same = (levels_of(table, name) for name in "abc")
    every = np.ones(60, bool)
    assert association(one, other, every, True) < 0.2
    assert association(one, same, every) == pytest.approx(1.0, abs=0.05)
    assert association(one, same, one.of == 1) == 0.0
    assert association(one, same, (one.of == 0) | (one.of == 1)) > 0.9
    pair = table_of({"x": few[0], "y": few[1]}, {("m: e", "mm"): few[0]})
    assert association(levels_of(pair, "x"), levels_of(pair, "y"), every[:40], True) < 0.3
    x, y = np.array([1, 1, 2, 2, 3, 3, 3, 3.0]), np.array([1, 1, 1, 1, 1, 1, 2, 2.0])
    some = table_of({"x": x, "y": y}, {("m: e", "mm"): x})
    found = association(levels_of(some, "x"), levels_of(some, "y"), every[:8])
    assert found == pytest.approx(np.sqrt(1.0 / 3.0))  # chi-squared of 8 / 3 in 8 samples


def test_what_has_no_truth_is_told_by_its_mean() -> None:
    table = table_of(
        {"a": np.array([1.0, 1.0, 2.0, 2.0])}, {}, {("m: f", "Hz"): [1.0, 3.0, 5.0, 5.0]}
    )
    values, is_error = response(table, ("m: f", "Hz"))
    assert not is_error
    np.testing.assert_allclose(effect(values, levels_of(table, "a"), is_error).values, [2.0, 5.0])
