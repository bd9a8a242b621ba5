"""Strains that no body can have are refused by every law for finite strain, in NaN-free words."""

from __future__ import annotations

import numpy as np
import pytest

import gpusim as gs
from gpusim.fem.materials.cauchy_green import tensor_components
from tests.support.law_checks import green_lagrange, strains

STEEL = gs.Isotropic(210e3, 0.3)
LAWS = [
    gs.SaintVenantKirchhoff(210e3, 0.3),
    gs.NeoHookean(210e3, 0.3),
    gs.Hencky(210e3, 0.3),
    gs.J2(STEEL, 250.0),
]


def test_components_are_those_of_the_tensor() -> None:
    E = tensor_components(np.array([[1e-3, 2e-3, 3e-3, 4e-3, 6e-3, 8e-3]]))
    np.testing.assert_allclose(E[:, 0], [1e-3, 2e-3, 3e-3, 2e-3, 3e-3, 4e-3], rtol=1e-15)


@pytest.mark.parametrize("law", LAWS, ids=repr)
@pytest.mark.parametrize("moduli", [False, True])
@pytest.mark.parametrize(
    ("bad", "words"),
    [
        ([-0.5, 0, 0, 0, 0, 0], r"turned inside out at 1 of 7 points; got .* down to 0;"),
        ([-0.6, 0, 0, 0, 0, 0], r"turned inside out at 1 of 7 points; got .* down to -0\.2;"),
        # two squared stretches below zero: their product isn't
        ([0, -0.6, -0.6, 0, 0, 0], r"turned inside out at 1 of 7 points"),
        ([0, 0, 0, 1.5, 0, 0], r"turned inside out at 1 of 7 points; got .* down to -1\.25;"),
        ([np.nan, 0, 0, 0, 0, 0], "out of all bounds at 1 of 7 points"),
        ([0, 0, 0, 0, -np.inf, 0], "out of all bounds at 1 of 7 points"),
        ([0, 0, 1e200, 0, 0, 0], "out of all bounds at 1 of 7 points"),
    ],
)
def test_a_cell_turned_inside_out_is_told(
    law: gs.fem.Law, moduli: bool, bad: list[float], words: str
) -> None:
    strain = strains(0.1, 7)
    strain[4] = bad
    state = np.zeros((7, law.state_size)) if law.state_size else None
    with pytest.raises(gs.NotConverged, match=words):
        law.update(strain, state, moduli=moduli)


@pytest.mark.parametrize("law", LAWS, ids=repr)
def test_no_points_are_no_fault(law: gs.fem.Law) -> None:
    state = np.zeros((0, law.state_size)) if law.state_size else None
    update = law.update(np.zeros((0, 6)), state, moduli=True)
    assert update.stress.shape == (0, 6)


def test_a_pressed_cell_is_a_cell_as_long_as_it_has_a_volume() -> None:
    pressed = green_lagrange(np.diag([0.05, 1.3, 1.1])[None])
    for law in LAWS[:3]:
        stress = law.update(pressed, None, moduli=True).stress
        assert np.isfinite(stress).all()
        assert stress[0, 0] < 0.0
