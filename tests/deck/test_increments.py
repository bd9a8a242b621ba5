"""Increments of steps, and loads that are there at once."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gpusim.deck import load_deck
from tests.support.deck_texts import FIXED, METAL, deck, step, write


def test_loads_at_once(tmp_path: Path) -> None:
    """AMPLITUDE=STEP: all of them by the end of the first increment."""
    text = deck(step("*CLOAD", "22, 1, 2.", static="*STATIC, DIRECT\n.25, 1."))
    found = load_deck(write(tmp_path, text.replace("*STEP", "*STEP, NLGEOM, AMPLITUDE=STEP")))
    (one,) = found.steps
    assert [state.time for state in (*one.path, one)] == [0.25, 1.0]
    assert one.path[0].forces.sum() == 2.0
    np.testing.assert_allclose(one.increments, [0.25, 0.5, 0.75, 1.0])


def test_metal_takes_increments(tmp_path: Path) -> None:
    """With a history each increment is a load step: they grow by half, as far as they may."""
    static = "*STATIC\n0.1, 1., , 0.3"
    pulled = step("*BOUNDARY", "RIGHT, 1, 1, 0.1", static=static)
    text = deck(pulled, material=METAL, fixed=FIXED + "RIGHT, 1\n")
    found = load_deck(write(tmp_path, text))
    expected = [0.1, 0.25, 0.475, 0.775, 1.0]
    np.testing.assert_allclose(found.steps[0].increments, expected, rtol=1e-14)
    (solution,) = found.solve(backend="numpy")
    np.testing.assert_allclose([one.factors[0] for one in solution.steps], expected)
    # all of it flows: the stress is on the curve, 1 + 10 p
    assert solution.steps[-1].stress is not None
    p = solution.steps[-1].stress.nodal_plastic_strain
    assert p is not None and 0.003 < p.min()


def test_increments_of_a_linear_step_are_of_no_account(tmp_path: Path) -> None:
    one = step("*CLOAD", "22, 3, 1.", static="*STATIC, DIRECT\n0.001, 1.")
    found = load_deck(write(tmp_path, deck(one)))
    assert not found.nonlinear and found.steps[0].increments.tolist() == [1.0]
