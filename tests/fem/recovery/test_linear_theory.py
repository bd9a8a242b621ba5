"""How far bodies turn by linear theory, and what strain it leaves out."""

from __future__ import annotations

import numpy as np
import pytest

from gpusim.fem.recovery.linear_theory import cell_rotations, stretching
from gpusim.mesh import box


def test_rotations_are_half_the_curl() -> None:
    mesh = box((0.3, 0.2, 0.1), (3, 2, 1))
    turn = np.array([0.01, -0.02, 0.03])
    stretch = np.diag([1e-3, 2e-3, -3e-3])
    u = np.cross(turn, mesh.points) + mesh.points @ stretch
    assert np.allclose(cell_rotations(mesh, u), turn, rtol=0, atol=1e-15)


def test_stretching_compares_strains() -> None:
    mesh = box((0.3, 0.2, 0.1), (3, 2, 1))
    pulled = mesh.points * [1e-3, 0.0, 0.0]
    assert stretching(mesh, pulled) == pytest.approx((0.5 * 1e-6 / 1e-3) ** 2, rel=1e-9)
    # turned by w about z: w^2 / 2 in x and y
    turned = 0.01 * np.stack([-mesh.points[:, 1], mesh.points[:, 0], 0.0 * mesh.points[:, 2]], 1)
    assert stretching(mesh, pulled + turned) == pytest.approx(2 * (0.5e-4 / 1e-3) ** 2, rel=0.2)
    assert stretching(mesh, 0.0 * pulled) == 0.0
