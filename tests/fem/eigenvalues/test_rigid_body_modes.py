"""Motions that cost no energy: of bodies, mechanisms, and of what is held in part."""

from __future__ import annotations

import numpy as np
import pytest

import gpusim as gs
from tests.support.dense_modes import STEEL, agree, held, together


def two_bodies() -> gs.Model:
    """One held, one free, of unlike sizes."""
    both = together(
        gs.mesh.box((1, 0.1, 0.1), (6, 1, 1)), gs.mesh.box((1, 0.2, 0.1), (6, 1, 1), (0, 1, 0))
    )
    fixed = (both.points[:, 1:2] < 0.5) & (both.points[:, :1] == 0.0)
    return gs.Model(both, STEEL, np.repeat(fixed, 3, axis=1))


def hinged() -> gs.Model:
    """Two bars that share an edge, the first one held."""
    first = gs.mesh.box((1, 0.1, 0.1), (4, 1, 1))
    second = gs.mesh.box((1, 0.1, 0.1), (4, 1, 1), (1, 0.1, 0))
    pair = together(first, second)
    points, number = np.unique(pair.points.round(9), axis=0, return_inverse=True)
    return held(gs.Mesh(points, {"hex8": number.reshape(-1)[pair.cells["hex8"]]}))


def sliding() -> gs.Model:
    mesh = gs.mesh.box((1, 0.1, 0.1), (6, 1, 1))
    return gs.Model(mesh, STEEL, np.repeat([[False, False, True]], mesh.node_count, axis=0))


def stiffened() -> gs.Model:
    """An end that moves as a node without mass does: it can't turn."""
    bar = gs.mesh.box((1, 0.1, 0.1), (6, 1, 1))
    mesh = gs.Mesh(np.vstack([bar.points, [[1.2, 0.0, 0.0]]]), bar.cells)
    end, last = np.flatnonzero(bar.points[:, 0] == 1.0), bar.node_count
    alike = [([(n, axis, 1.0), (last, axis, -1.0)], 0.0) for n in end for axis in "xyz"]
    return gs.Model(mesh, STEEL, constraints=gs.fem.equations(mesh, alike))


def turned() -> gs.Model:
    mesh = gs.mesh.box((1, 0.2, 0.1), (6, 2, 1))
    turn = np.array([[0.8, 0.6, 0.0], [-0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
    return gs.Model(gs.Mesh(mesh.points @ turn, mesh.cells), STEEL)


ALONG = ("translation x", "translation y", "translation z")
RIGID = {
    "two bodies": (two_bodies, (*ALONG, *(f"rotation about {axis}" for axis in "xyz"))),
    "hinged": (hinged, ("motion 1 of a mechanism",)),
    "stiffened": (stiffened, ALONG),
    "sliding": (sliding, ("translation x", "translation y", "rotation about z")),
    "turned": (
        turned,
        (*ALONG, "rotation about (0.800, 0.600, 0.000)", "rotation about (-0.600, 0.800, 0.000)",
         "rotation about z"),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", RIGID)
def test_rigid_modes_are_named_and_exact(name: str) -> None:
    build, names = RIGID[name]
    model = build()
    found = gs.modes(model, len(names) + 3)
    assert tuple(one.replace("-0.000", "0.000") for one in found.rigid) == names
    agree(found, model)
    few = gs.modes(model, 1)
    assert few.rigid == names[:1]
    assert few.shapes.shape == (1, model.mesh.node_count, 3)


def test_a_free_body_takes_up_all_of_its_mass_by_its_rigid_modes() -> None:
    model = gs.Model(gs.mesh.box((2.0, 1.0, 0.5), (4, 2, 1), (3.0, 1.0, 7.0)), STEEL)
    found = gs.modes(model, 8)
    mass = 7850.0
    assert np.allclose(found.centre, [4.0, 1.5, 7.25])
    assert np.allclose(found.total_mass[:3], mass)
    about_z = mass * (2.0**2 + 1.0**2) / 12.0
    assert np.isclose(found.total_mass[5], about_z, rtol=1e-9)
    assert np.allclose(found.effective_mass[:6].sum(axis=0), found.total_mass, rtol=1e-9)
    assert np.abs(found.effective_mass[6:]).max() <= 1e-12 * mass
