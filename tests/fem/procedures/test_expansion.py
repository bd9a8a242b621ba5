"""Large displacements to third order, against those in equilibrium."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.fem.procedures.expansion import higher_orders
from gpusim.mesh import box

Float = npt.NDArray[np.float64]
LENGTH = 0.24


def strip(held: str, force: float, along: float = 0.0) -> gs.Model:
    """Of aluminium, 10 mm x 2 mm, held at its start or at both ends, a force where it is free."""
    mesh = box((LENGTH, 0.01, 0.002), (48, 2, 2))
    x = mesh.points[:, 0]
    ends = np.isclose(x, 0.0) | (np.isclose(x, LENGTH) & (held == "both"))
    loaded = np.isclose(x, LENGTH if held == "start" else 0.5 * LENGTH)
    forces = np.zeros_like(mesh.points)
    forces[loaded] = np.array([along, 0.0, force]) / loaded.sum()
    return gs.Model(mesh, gs.Isotropic(70e9, 0.3), np.repeat(ends[:, None], 3, axis=1), forces)


def greatest(u: Float) -> float:
    return float(np.linalg.norm(u, axis=1).max())


@pytest.mark.parametrize(
    ("held", "forces", "tolerance"),
    [("both", (1.0, 0.0), 0.05), ("start", (1.0, 0.0), 0.1), ("start", (0.1, -1.0), 0.1)],
)
def test_third_order_is_most_of_a_small_difference(
    held: str, forces: tuple[float, float], tolerance: float
) -> None:
    """A beam that is stretched, one that bends freely, one that is pressed along itself, by 5 % of
    its buckling load."""
    model = strip(held, *forces)
    linear = gs.fem.solve(model, tolerance=1e-9).u
    exact = gs.fem.solve(model, geometry="nonlinear", tolerance=1e-9).u
    found = linear + higher_orders(model, linear, np.ones(1), "incompatible")
    difference = greatest(exact) - greatest(linear)
    assert 5e-4 < abs(difference) / greatest(linear) < 0.1
    assert abs(greatest(found) - greatest(exact)) <= tolerance * abs(difference)
    # the way back of a cantilever's end is of second order
    assert np.abs(found - exact).max() <= 0.1 * np.abs(exact - linear).max()


def test_orders_are_those_of_the_load() -> None:
    """Twice the load: 4 and 8 times; and load cases add up before they act."""
    model = strip("both", 1.0)
    u = gs.fem.solve(model, tolerance=1e-10).u
    one, two = (higher_orders(model, s * u, np.array([s]), "incompatible") for s in (1.0, 2.0))
    assert np.abs(two - 8.0 * one).max() <= 0.02 * np.abs(two).max()  # the second order is small
    halves = gs.Model(model.mesh, model.materials, model.fixed, np.stack([model.forces] * 2))
    both = higher_orders(halves, u, np.array([0.3, 0.7]), "incompatible")
    assert np.abs(both - one).max() <= 1e-3 * np.abs(one).max()
