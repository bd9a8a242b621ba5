"""Saint Venant-Kirchhoff: linear in Green-Lagrange's strain, and soft under large pressure."""

from __future__ import annotations

import numpy as np

import gpusim as gs
from tests.support.law_checks import green_lagrange


def test_pulled_bar() -> None:
    """Free sides: E_yy = E_zz = -nu E_xx, S = E E_xx; along = sqrt(1 + 2 E_xx)."""
    law = gs.SaintVenantKirchhoff(70.0, 0.33)
    extension = 0.5 * (1.2**2 - 1.0)
    across = np.sqrt(1.0 - 2.0 * 0.33 * extension)
    strain = green_lagrange(np.diag([1.2, across, across])[None])
    update = law.update(strain, None, moduli=True)
    np.testing.assert_allclose(update.stress[0], [70.0 * extension, *[0] * 5], atol=1e-12)
    np.testing.assert_array_equal(update.moduli, gs.Isotropic(70.0, 0.33).stiffness())


def test_a_pressed_bar_is_softest_at_a_third_of_its_squared_length() -> None:
    """Force per area l (l^2 - 1) E / 2 has its least at l = 1 / sqrt(3) = 0.577."""
    law = gs.SaintVenantKirchhoff(2.0, 0.0)
    stretch = np.linspace(0.4, 1.0, 601)
    strain = np.zeros((601, 6))
    strain[:, 0] = 0.5 * (stretch**2 - 1.0)
    force = stretch * law.update(strain, None, moduli=False).stress[:, 0]
    assert abs(stretch[np.argmin(force)] - 0.577) <= 1e-3
