"""Damping: ratios of modes, and wrong values."""

from __future__ import annotations

import math

import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError
from gpusim.fem.model.damping import Damping

ANGULAR = np.array([10.0, 20.0, 40.0])


def test_ratios() -> None:
    assert np.allclose(gs.Rayleigh(2.0, 0.01).ratios(ANGULAR), [0.15, 0.15, 0.225], rtol=1e-15)
    assert (gs.ModalDamping(0.02).ratios(ANGULAR) == 0.02).all()
    assert (gs.ModalDamping([0.03, 0.02]).ratios(ANGULAR) == [0.03, 0.02, 0.02]).all()
    assert (gs.StructuralDamping(0.04).ratios(ANGULAR) == 0.02).all()


@pytest.mark.parametrize(
    "damping", [gs.Rayleigh(2.0, 0.01), gs.ModalDamping([0.03, 0.02]), gs.StructuralDamping(0.04)]
)
def test_dissipation_at_resonance_is_that_of_the_ratio(damping: Damping) -> None:
    lost = damping.dissipation(ANGULAR, ANGULAR)
    expected = 2.0 * damping.ratios(ANGULAR) * ANGULAR**2
    assert np.allclose(np.diagonal(lost), expected, rtol=1e-14)


def test_dissipation() -> None:
    """Of Rayleigh's and modal damping it grows with the frequency, of structure it doesn't."""
    driven, modes = np.array([0.0, 5.0]), np.array([0.0, 10.0])
    found = gs.Rayleigh(2.0, 0.01).dissipation(driven, modes)
    assert np.allclose(found, [[0.0, 0.0], [10.0, 15.0]], rtol=1e-15)
    found = gs.ModalDamping(0.02).dissipation(driven, modes)
    assert np.allclose(found, [[0.0, 0.0], [0.0, 2.0]], rtol=1e-15)
    found = gs.StructuralDamping(0.04).dissipation(driven, modes)
    assert np.allclose(found, [[0.0, 4.0], [0.0, 4.0]], rtol=1e-15)


@pytest.mark.parametrize("value", [-0.1, 1.0, math.nan, [], [[0.1]], "much", "0.1", ["0.1"]])
def test_wrong_ratios(value: object) -> None:
    with pytest.raises(InputError, match=r"ModalDamping\.ratio"):
        gs.ModalDamping(value)  # type: ignore[arg-type]


@pytest.mark.parametrize("value", [-1.0, math.nan, math.inf])
def test_wrong_amounts(value: float) -> None:
    with pytest.raises(InputError, match=r"Rayleigh.*stiffness"):
        gs.Rayleigh(stiffness=value)
    with pytest.raises(InputError, match="loss_factor"):
        gs.StructuralDamping(value)
