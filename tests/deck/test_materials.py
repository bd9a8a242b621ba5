"""Materials of nonlinear decks: metal that flows, rubber, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import gpusim as gs
from gpusim.deck import load_deck
from gpusim.errors import InputError
from tests.support.deck_texts import MATERIAL, METAL, deck, step, write


def test_small_strain_takes_the_same_way(tmp_path: Path) -> None:
    """Metal and rubber without NLGEOM are solved at finite strain all the same."""
    plain = load_deck(write(tmp_path, deck(step("*CLOAD", "22, 3, 1."), material=METAL)))
    assert plain.nonlinear and isinstance(plain.materials[0], gs.J2)
    rubber = MATERIAL.replace("*ELASTIC\n200., 0.25", "*HYPERELASTIC, NEO HOOKE\n40., 0.02")
    found = load_deck(write(tmp_path, deck(step("*CLOAD", "22, 3, 1."), material=rubber)))
    law = found.materials[0]
    assert isinstance(law, gs.fem.IsochoricNeoHookean)
    np.testing.assert_allclose([law.shear, law.lame + 2 / 3 * law.shear], [80.0, 100.0])


@pytest.mark.parametrize(
    ("cards", "message"),
    [
        ("*ELASTIC\n200., 0.25\n*PLASTIC, HARDENING=KINEMATIC\n1., 0.", "=KINEMATIC isn't"),
        ("*ELASTIC\n200., 0.25\n*PLASTIC\n1., 0., 20.\n0.5, 0., 90.", "different temperatures"),
        ("*ELASTIC\n200., 0.25\n*PLASTIC\n1., 0.\n0.5, 0.1", "ones that don't fall"),
        ("*ELASTIC\n200., 0.25\n*PLASTIC\n1., 0.1", "the first pair"),
        ("*ELASTIC\n200., 0.25\n*CYCLIC HARDENING\n1., 0.", "*CYCLIC HARDENING: not supported"),
        ("*ELASTIC\n200., 0.25\n*HYPERELASTIC, NEO HOOKE\n1., 0.1", "either *HYPERELASTIC, or"),
        ("*PLASTIC\n1., 0.", "either *HYPERELASTIC, or"),
        ("*HYPERELASTIC, OGDEN\n1., 2., 0.1", "OGDEN isn't supported"),
        ("*HYPERELASTIC\n1., 0.1", "NEO HOOKE"),
        ("*HYPERELASTIC, NEO HOOKE\n1., 0.", "numbers above 0"),
        ("*HYPERELASTIC, NEO HOOKE\n1.", "expected C10, D1"),
    ],
)  # fmt: skip
def test_materials_that_are_refused(cards: str, message: str, tmp_path: Path) -> None:
    material = MATERIAL.replace("*ELASTIC\n200., 0.25", cards)
    with pytest.raises(InputError) as caught:
        load_deck(write(tmp_path, deck(step("*CLOAD", "22, 1, 1."), material=material)))
    assert message in str(caught.value)
