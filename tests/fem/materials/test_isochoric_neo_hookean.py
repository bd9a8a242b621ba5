"""Neo-Hooke of distortion and volume apart, against its energy and closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from gpusim.fem import IsochoricNeoHookean
from tests.support.law_checks import (
    check_law,
    check_moduli,
    check_potential,
    green_lagrange,
    strains,
)

E, NU = 5.0, 0.3
SHEAR, BULK = 0.5 * E / (1 + NU), E / (3 * (1 - 2 * NU))
LAW = IsochoricNeoHookean(E, NU)


def test_what_every_law_does() -> None:
    strain = strains(0.3)
    check_law(LAW, strain)
    check_moduli(LAW, strain, None, step=2e-4, rtol=1e-8)


@pytest.mark.parametrize("stretch", [0.5, 0.9, 1.0, 1.1, 2.0])
def test_volume_alone(stretch: float) -> None:
    """F = a 1: no distortion, Cauchy stress K (J - 1)."""
    strain = green_lagrange(stretch * np.eye(3)[None])
    stress = LAW.update(strain, None, moduli=False).stress[0]
    pressure = BULK * (stretch**3 - 1.0)
    expected = [pressure * stretch] * 3 + [0.0] * 3  # J F^-1 s F^-T
    np.testing.assert_allclose(stress, expected, rtol=1e-13, atol=1e-13 * BULK)


@pytest.mark.parametrize("along", [0.6, 0.95, 1.0, 1.2, 3.0])
def test_distortion_alone(along: float) -> None:
    """J = 1 and no strain of volume: Cauchy stress mu dev(F F^t)."""
    across = along**-0.5
    strain = green_lagrange(np.diag([along, across, across])[None])
    stress = LAW.update(strain, None, moduli=False).stress[0]
    squares = np.array([along, across, across]) ** 2
    expected = SHEAR * (squares - squares.mean()) / squares
    np.testing.assert_allclose(stress[:3], expected, rtol=0, atol=2e-13 * SHEAR)
    np.testing.assert_array_equal(stress[3:], 0.0)


def test_stress_is_the_derivative_of_the_energy() -> None:
    def energy(trace: np.ndarray, det: np.ndarray) -> np.ndarray:
        J = np.sqrt(det)
        return 0.5 * SHEAR * (trace * J ** (-2 / 3) - 3.0) + 0.5 * BULK * (J - 1.0) ** 2

    check_potential(LAW, energy, strains(0.3), 2e-9 * E)


def test_small_strains_keep_their_digits() -> None:
    strain = 1e-12 * strains(1.0)
    expected = strain @ LAW.stiffness()
    stress = LAW.update(strain, None, moduli=False).stress
    np.testing.assert_allclose(stress, expected, rtol=0, atol=1e-11 * np.abs(expected).max())
