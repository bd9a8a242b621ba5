"""Hencky's law against the closed forms of bars and shear."""

from __future__ import annotations

import numpy as np
import pytest

import gpusim as gs
from tests.support.law_checks import green_lagrange

E, NU = 5.0, 0.3
LAW = gs.Hencky(E, NU)


@pytest.mark.parametrize("along", [0.2, 0.8, 1.0 - 1e-9, 1.0, 1.001, 1.7, 6.0])
def test_pulled_bar(along: float) -> None:
    """Free sides: across = along^-nu, Kirchhoff stress E ln(along)."""
    across = along**-NU
    strain = green_lagrange(np.diag([across, across, along])[None])
    stress = LAW.update(strain, None, moduli=False).stress[0]
    pull = E * np.log(along) / along**2
    atol = 1e-13 * E / across**2
    np.testing.assert_allclose(stress, [0, 0, pull, 0, 0, 0], rtol=1e-13, atol=atol)


@pytest.mark.parametrize("g", [1e-6, 0.01, 0.5, 2.0, 6.0])
def test_simple_shear(g: float) -> None:
    """Stretches b and 1/b with b - 1/b = g: Cauchy's shear stress is 2 mu ln b / (b + 1/b) * 2."""
    F = np.array([[1.0, g, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    xx, yy, zz, xy, yz, zx = LAW.update(green_lagrange(F[None]), None, moduli=False).stress[0]
    S = np.array([[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]])
    b = 0.5 * g + np.sqrt(1.0 + 0.25 * g * g)
    shear = 2.0 * E / (1.0 + NU) * np.arcsinh(0.5 * g) / (b + 1.0 / b)
    normal = 0.5 * g * shear  # Rivlin's relation: the difference of normal stresses is g times it
    expected = [[normal, shear, 0.0], [shear, -normal, 0.0], [0.0, 0.0, 0.0]]
    np.testing.assert_allclose(F @ S @ F.T, expected, rtol=0, atol=2e-13 * E * (1.0 + g**4))


def test_stretching_alike_in_all_directions() -> None:
    strain = green_lagrange(1.4 * np.eye(3)[None])
    bulk = E / (3.0 * (1.0 - 2.0 * NU))
    stress = LAW.update(strain, None, moduli=False).stress[0]
    expected = 3.0 * bulk * np.log(1.4) / 1.4**2 * np.array([1.0, 1, 1, 0, 0, 0])
    np.testing.assert_allclose(stress, expected, rtol=1e-14, atol=1e-15)
