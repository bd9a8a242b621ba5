"""How far linear statics is off, against the elastica and other exact solutions."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy.integrate import solve_bvp

import gpusim as gs
from gpusim.fem.recovery.linear_theory import cell_rotations, second_order
from gpusim.mesh import box

Float = npt.NDArray[np.float64]
LENGTH, SIDE, MODULUS = 0.3, 0.01, 70e9
STIFFNESS = MODULUS * SIDE**4 / 12.0


def exact_tip(force: float, press: float = 0.0) -> float:
    """Deflection of the tip of a cantilever (elastica) over its length; forces times L^2 / EI,
    across the unloaded bar and pressing along it."""

    def slopes(s: Float, y: Float) -> Float:
        del s
        return np.stack([y[1], -force * np.cos(y[0]) - press * np.sin(y[0]), np.sin(y[0])])

    s = np.linspace(0.0, 1.0, 101)
    start = 0.5 * np.stack([force * (s - s * s / 2), force * (1 - s), force * s * s / 2])
    found = solve_bvp(slopes, lambda a, b: np.array([a[0], a[2], b[1]]), s, start, tol=1e-9)
    assert found.success
    return float(found.y[2, -1])


def model(force: Any) -> gs.Model:
    """A cantilever along x with forces at its end."""
    mesh = box((LENGTH, SIDE, SIDE), (30, 2, 2))
    tip = np.isclose(mesh.points[:, 0], LENGTH)
    forces = np.zeros_like(mesh.points)
    forces[tip] = np.asarray(force) / np.count_nonzero(tip)
    fixed = np.zeros(mesh.points.shape, dtype=bool)
    fixed[np.isclose(mesh.points[:, 0], 0.0)] = True
    material = gs.Isotropic(MODULUS, 0.0, 1.0)
    return gs.Model(mesh, materials=[material], fixed=fixed, forces=forces)


def solved(force: Any) -> tuple[gs.Model, Float]:
    made = model(force)
    return made, gs.solve(made, tolerance=1e-9, formulation="incompatible", backend="numpy").u


@pytest.fixture(scope="module")
def across() -> tuple[gs.Model, Float]:
    """Bent by F = EI / L^2."""
    return solved([0.0, 0.0, STIFFNESS / LENGTH**2])


@pytest.mark.parametrize(
    ("force", "factor"), [(0.1, 1.05), (0.5, 1.05), (1.0, 1.06), (2.0, 1.1), (3.0, 1.1)]
)
def test_a_cantilever_is_off_as_far_as_the_elastica_says(
    across: tuple[gs.Model, Float], force: float, factor: float
) -> None:
    made, u = across
    linear = force / 3.0
    assert abs(force * u[:, 2].max() / LENGTH - linear) <= 2e-3 * linear
    exact = linear - exact_tip(force)
    found = linear * (1.0 - second_order(made, force * u, "incompatible"))
    assert exact / factor <= found <= exact * factor


def test_a_bar_that_is_pressed_along_gives_more() -> None:
    made, u = solved(np.array([-0.3, 0.0, 0.1]) * STIFFNESS / LENGTH**2)
    exact = exact_tip(0.1, 0.3) / (0.1 / 3.0)
    assert abs(exact - 1.135) <= 1e-3
    assert abs(second_order(made, u, "incompatible") - exact) <= 0.1 * (exact - 1.0)


def test_a_bar_bent_to_an_arc_without_forces() -> None:
    made, turn = model([0.0, 0.0, 0.0]), 0.6
    x, y, z = made.mesh.points.T
    del y
    u = np.stack([-z * turn * x / LENGTH, 0.0 * x, turn * x**2 / (2.0 * LENGTH)], axis=1)
    exact = (1.0 - np.cos(turn)) / turn / (turn / 2.0)
    found = second_order(made, u, "incompatible", forced=False)
    assert abs(found - exact) <= 0.1 * (1.0 - exact)


def test_rotations_are_half_the_curl() -> None:
    mesh = box((0.3, 0.2, 0.1), (3, 2, 1))
    turn = np.array([0.01, -0.02, 0.03])
    stretch = np.diag([1e-3, 2e-3, -3e-3])
    u = np.cross(turn, mesh.points) + mesh.points @ stretch
    assert np.allclose(cell_rotations(mesh, u), turn, rtol=0, atol=1e-15)
