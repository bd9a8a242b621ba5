"""The logarithmic strain and its derivatives against eigenvectors, series and differences."""

from __future__ import annotations

import numpy as np
import pytest

from gpusim.arrays.array_types import Float
from gpusim.errors import NotConverged
from gpusim.fem.materials.logarithmic_strain import LogarithmicStrain
from gpusim.fem.materials.symmetric_tensors import COLUMN, ENGINEERING, FULL, ROW
from tests.support.law_checks import green_lagrange, strains

RANDOM = np.random.default_rng(2)


def by_eigenvectors(strain: Float) -> Float:
    """(P,6) components of ln(C) / 2."""
    C = np.moveaxis((strain / ENGINEERING).T[FULL], 2, 0) * 2.0 + np.eye(3)
    value, vector = np.linalg.eigh(C)
    H = (vector * (0.5 * np.log(value))[:, None]) @ vector.swapaxes(1, 2)
    return np.asarray(H[:, ROW, COLUMN])


def rotations(count: int) -> Float:
    return np.asarray(np.linalg.qr(RANDOM.normal(size=(count, 3, 3)))[0])


@pytest.mark.parametrize("size", [1e-3, 0.01, 0.05, 0.2, 0.5])
def test_random_strains(size: float) -> None:
    strain = strains(size, 200)
    found = LogarithmicStrain(strain).components.T
    # squared stretches of random ones lie up to a factor of 260 apart
    atol = 2e-14 if size < 0.5 else 2e-13
    np.testing.assert_allclose(found, by_eigenvectors(strain), rtol=0, atol=atol)


@pytest.mark.parametrize(
    "stretches",
    [
        (1.0, 1.0, 1.0),
        (1.3, 1.3, 1.3),
        (1.2, 1.2, 0.9),
        (0.9, 1.2, 1.2),
        (1.2, 1.2 + 1e-9, 0.9),
        (1.0, 1.0 + 1e-12, 1.0 - 1e-12),
        (4.0, 1.0, 0.25),
        (20.0, 1.0, 1.0),
        (0.05, 1.0, 1.0),
        (10.0, 10.0, 1.0),
    ],
)
def test_given_stretches(stretches: tuple[float, float, float]) -> None:
    """Equal and nearly equal ones are no special case; large ones only take more nodes."""
    turn = rotations(20)
    U = turn @ (np.array(stretches)[:, None] * turn.swapaxes(1, 2))
    H = turn @ (np.log(stretches)[:, None] * turn.swapaxes(1, 2))
    found = LogarithmicStrain(green_lagrange(U)).components.T
    # rounding of C's largest eigenvalue weighs as the ratio of them on the smallest, whose product
    # det(1 + t X) is a sum
    spread = (max(stretches) / min(stretches)) ** 2
    np.testing.assert_allclose(found, H[:, ROW, COLUMN], rtol=0, atol=1e-15 * (1 + spread) ** 1.5)


def test_small_strains_keep_their_digits() -> None:
    """ln(1 + 2 E) / 2 = E - E^2 + 4/3 E^3 - …"""
    strain = 1e-5 * RANDOM.normal(size=(50, 6))
    E = np.moveaxis((strain / ENGINEERING).T[FULL], 2, 0)
    series = (E - E @ E + 4.0 / 3.0 * E @ E @ E - 2.0 * E @ E @ E @ E)[:, ROW, COLUMN]
    found = LogarithmicStrain(strain).components.T
    np.testing.assert_allclose(found, series, rtol=0, atol=1e-14 * 1e-5)


@pytest.mark.parametrize("size", [1e-6, 1e-3, 0.05, 0.3])
def test_derivatives_against_differences(size: float) -> None:
    """T : dH/dE and, without moduli of T's own, T : d2H/dE2, for a T that isn't coaxial."""
    strain, T = strains(size, 8), RANDOM.normal(size=(6, 8))
    weights = (ENGINEERING[:, None] * T).T
    step, rest = 1e-3, np.zeros((6, 6))
    S, second = LogarithmicStrain(strain).pulled_back(T, rest)
    assert second is not None
    for component in range(6):
        moved = [strain + k * step * np.eye(6)[component] for k in (1, -1, 2, -2)]
        H = [LogarithmicStrain(one).components.T for one in moved]
        slope = (8.0 * (H[0] - H[1]) - H[2] + H[3]) / (12.0 * step)
        np.testing.assert_allclose(S[:, component], (slope * weights).sum(axis=1), atol=1e-9)
        P = [LogarithmicStrain(one).pulled_back(T, None)[0] for one in moved]
        slope = (8.0 * (P[0] - P[1]) - P[2] + P[3]) / (12.0 * step)
        np.testing.assert_allclose(second[:, :, component], slope, rtol=3e-9, atol=5e-9)


def test_derivatives_at_equal_stretches() -> None:
    """At C = c 1: dH/dE = 1/c, and T : d2H/dE2 sends e to -(T e + e T) / c^2."""
    c, T, e = 1.44, RANDOM.normal(size=6), RANDOM.normal(size=6)
    strain = np.array([[0.22, 0.22, 0.22, 0.0, 0.0, 0.0]])
    S, second = LogarithmicStrain(strain).pulled_back(T[:, None], np.zeros((6, 6)))
    assert second is not None
    np.testing.assert_allclose(S[0], T / c, rtol=1e-14, atol=1e-15)
    expected = -(T[FULL] @ e[FULL] + e[FULL] @ T[FULL]) / c**2
    np.testing.assert_allclose(
        second[0] @ (ENGINEERING * e), expected[ROW, COLUMN], rtol=0, atol=1e-14
    )


def test_moduli_of_the_law_go_along() -> None:
    """With T = 0 moduli are (dH/dE) D (dH/dE), whether D is one for all or each point's own."""
    strain, D = strains(0.2, 6), RANDOM.normal(size=(6, 6))
    D = D + D.T
    zero = np.zeros((6, 6))
    one = LogarithmicStrain(strain).pulled_back(zero, D)[1]
    own = LogarithmicStrain(strain).pulled_back(zero, np.broadcast_to(D, (6, 6, 6)))[1]
    derivative = np.empty((6, 6, 6))
    for component in range(6):
        step = 1e-3 * np.eye(6)[component]
        H = [LogarithmicStrain(strain + k * step).components for k in (1, -1, 2, -2)]
        slope = (8.0 * (H[0] - H[1]) - H[2] + H[3]) / 12e-3
        derivative[:, :, component] = (slope * ENGINEERING[:, None]).T
    expected = derivative.swapaxes(1, 2) @ D @ derivative
    assert one is not None and own is not None
    np.testing.assert_allclose(one, expected, rtol=0, atol=1e-8)
    np.testing.assert_allclose(own, one, rtol=0, atol=1e-13)


def test_a_cell_pressed_flat_is_told() -> None:
    flat = green_lagrange(np.diag([0.01, 1.0, 1.0])[None])
    with pytest.raises(NotConverged, match=r"pressed flat; got .* down to 0\.00015 of their mean"):
        LogarithmicStrain(flat)
