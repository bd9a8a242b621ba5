"""Frequency-response functions: reciprocity, kinds, the closed form of a sum of modes."""

from __future__ import annotations

import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError

BAR = gs.mesh.box(size=(1.0, 0.1, 0.12), divisions=(5, 1, 1))
HELD = np.isclose(BAR.points[:, :1], 0.0).repeat(3, axis=1)
MODEL = gs.Model(BAR, gs.Isotropic(210e9, 0.3, density=7850.0), HELD)
FREQUENCIES = np.array([0.0, 60.0, 400.0])
TIP, SIDE = ((1.0, 0.1, 0.0), "y"), (9, "z")


def test_it_is_the_sum_of_modes() -> None:
    every = gs.modes(MODEL, 60)
    found = gs.frequency_response(
        MODEL, FREQUENCIES, at=TIP, response=SIDE, damping=gs.ModalDamping(0.02), modes=every
    )
    node = int(np.flatnonzero((BAR.points == TIP[0]).all(axis=1))[0])
    omega, squares = 2.0 * np.pi * FREQUENCIES[:, None], every.angular**2
    dynamic = squares - omega**2 + 0.04j * every.angular * omega
    expected = (every.shapes[:, node, 1] * every.shapes[:, 9, 2] / dynamic).sum(axis=1)
    assert (np.abs(found - expected) <= 1e-9 * np.abs(expected)).all()


def test_reciprocity_and_kinds() -> None:
    damping = gs.Rayleigh(3.0, 1e-6)
    one = gs.frequency_response(MODEL, FREQUENCIES, at=TIP, response=SIDE, damping=damping)
    other = gs.frequency_response(MODEL, FREQUENCIES, at=SIDE, response=TIP, damping=damping)
    assert (np.abs(one - other) <= 1e-6 * np.abs(one)).all()
    turning = 2j * np.pi * FREQUENCIES
    driving = {
        kind: gs.frequency_response(MODEL, FREQUENCIES, at=TIP, kind=kind, damping=damping)
        for kind in ("receptance", "mobility", "accelerance")
    }
    assert (driving["mobility"] == driving["receptance"] * turning).all()
    assert (driving["accelerance"] == driving["receptance"] * turning**2).all()
    # work is lost at a driving point, never gained
    assert (driving["mobility"][1:].real > 0.0).all()


def test_static_stiffness_of_a_tip() -> None:
    force = gs.fem.nodal_force(
        BAR, int(np.flatnonzero((BAR.points == TIP[0]).all(axis=1))[0]), (0, 1, 0)
    )
    u = gs.solve(gs.Model(BAR, MODEL.materials, HELD, force), tolerance=1e-12).u
    found = gs.frequency_response(MODEL, [0.0], at=TIP, count=2)
    assert abs(found[0] / np.vdot(force, u) - 1.0) <= 1e-9


@pytest.mark.parametrize(
    ("at", "message"),
    [
        (((0.5, 0.5, 0.5), "x"), "a point 0.*from node .*expected a point with a node"),
        (((np.nan, 0.0, 0.0), "x"), "3"),
        ((24, "x"), "a node from 0 to 23"),
        ((1.5, "x"), "a node from 0 to 23"),
        ((9, "up"), "'x', 'y' or 'z'"),
        ((9, (0, 1, 0)), "'x', 'y' or 'z'"),
        (9, "'x', 'y' or 'z'"),
        ((0, "x"), "node 0; expected a node that can move"),
    ],
)
def test_wrong_places(at: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        gs.frequency_response(MODEL, [10.0], at=at)  # type: ignore[arg-type]


def test_wrong_options() -> None:
    with pytest.raises(InputError, match="receptance"):
        gs.frequency_response(MODEL, [10.0], at=TIP, kind="impedance")
    with pytest.raises(InputError, match="unknown argument; got 'mode'"):
        gs.frequency_response(MODEL, [10.0], at=TIP, mode=3)
