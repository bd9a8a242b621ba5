"""Neo-Hooke against its energy and the closed form of a pulled bar."""

from __future__ import annotations

import numpy as np
import pytest

import gpusim as gs
from tests.support.law_checks import check_potential, green_lagrange, strains

E, NU = 5.0, 0.3
LAME, SHEAR = E * NU / ((1 + NU) * (1 - 2 * NU)), 0.5 * E / (1 + NU)
LAW = gs.NeoHookean(E, NU)


@pytest.mark.parametrize("across", [0.7, 0.9, 0.999, 1.0, 1.05, 1.3])
def test_pulled_bar(across: float) -> None:
    """Free sides: mu (b^2 - 1) + lambda ln J = 0 gives J, and with it the stretch, for any b."""
    volume = np.exp(-SHEAR * (across**2 - 1.0) / LAME)
    along = volume / across**2
    strain = green_lagrange(np.diag([across, along, across])[None])
    stress = LAW.update(strain, None, moduli=False).stress[0]
    pull = SHEAR - (SHEAR - LAME * np.log(volume)) / along**2
    np.testing.assert_allclose(stress, [0, pull, 0, 0, 0, 0], rtol=1e-10, atol=1e-10 * SHEAR)


def test_simple_shear() -> None:
    """C = [[1, g, 0], [g, 1 + g^2, 0], [0, 0, 1]], det C = 1."""
    g = 0.8
    strain = green_lagrange(np.array([[[1.0, g, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]]))
    stress = LAW.update(strain, None, moduli=False).stress[0]
    expected = SHEAR * np.array([-g * g, 0.0, 0.0, g, 0.0, 0.0])
    np.testing.assert_allclose(stress, expected, rtol=0, atol=1e-14 * SHEAR)


def test_stress_is_the_derivative_of_the_energy() -> None:
    def energy(trace: np.ndarray, det: np.ndarray) -> np.ndarray:
        log = 0.5 * np.log(det)
        return SHEAR * (0.5 * (trace - 3.0) - log) + 0.5 * LAME * log**2

    check_potential(LAW, energy, strains(0.3), 2e-9 * E)


def test_small_strains_keep_their_digits() -> None:
    strain = 1e-12 * strains(1.0)
    expected = strain @ LAW.stiffness()
    stress = LAW.update(strain, None, moduli=False).stress
    np.testing.assert_allclose(stress, expected, rtol=0, atol=1e-11 * np.abs(expected).max())
