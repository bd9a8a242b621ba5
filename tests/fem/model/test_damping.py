"""Damping: ratios of modes, and wrong values."""

from __future__ import annotations

import math

import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError

ANGULAR = np.array([10.0, 20.0, 40.0])


def test_ratios() -> None:
    assert np.allclose(gs.Rayleigh(2.0, 0.01).ratios(ANGULAR), [0.15, 0.15, 0.225], rtol=1e-15)
    assert (gs.ModalDamping(0.02).ratios(ANGULAR) == 0.02).all()
    assert (gs.ModalDamping([0.03, 0.02]).ratios(ANGULAR) == [0.03, 0.02, 0.02]).all()
    assert (gs.StructuralDamping(0.04).ratios(ANGULAR) == 0.02).all()


@pytest.mark.parametrize("value", [-0.1, 1.0, math.nan, [], [[0.1]], "much"])
def test_wrong_ratios(value: object) -> None:
    with pytest.raises(InputError, match=r"ModalDamping\.ratio"):
        gs.ModalDamping(value)  # type: ignore[arg-type]


@pytest.mark.parametrize("value", [-1.0, math.nan, math.inf])
def test_wrong_amounts(value: float) -> None:
    with pytest.raises(InputError, match=r"Rayleigh.*stiffness"):
        gs.Rayleigh(stiffness=value)
    with pytest.raises(InputError, match="loss_factor"):
        gs.StructuralDamping(value)
