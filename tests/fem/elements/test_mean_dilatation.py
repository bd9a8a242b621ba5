"""The mean takes the volume change and nothing else, at finite strain too."""

from __future__ import annotations

import numpy as np
import pytest

from gpusim.fem.elements.element import ELEMENTS
from gpusim.fem.elements.element_response import Want
from gpusim.fem.elements.isoparametric_map import volumes
from gpusim.mesh import Mesh
from tests.support.element_meshes import mesh_of
from tests.support.element_responses import Body, E, Float, NeoHooke, elements, single

ONE = np.array([0])


@pytest.mark.parametrize("kind", ["hex8", "tet10"])
def test_pressure_and_volume_ratio_are_the_same_at_all_points(kind: str) -> None:
    nodes = single(kind)
    own = elements(("finite", kind, "bbar"), nodes, np.arange(len(nodes))[None], NeoHooke())
    u = 0.04 * np.random.default_rng(3).uniform(-1.0, 1.0, nodes.shape)
    values = own.point_values(ONE, u)
    shear = values.strain[0, :, 3]
    assert np.ptp(shear) > 0.01
    metric = 2.0 * values.strain[0]
    metric[:, :3] += 1.0
    xx, yy, zz, xy, yz, zx = (metric * [1, 1, 1, 0.5, 0.5, 0.5]).T
    ratio = np.sqrt(xx * (yy * zz - yz**2) - xy * (xy * zz - yz * zx) + zx * (xy * yz - yy * zx))
    # of the deformed cell, by its own points
    plain = elements(("finite", kind, "full"), nodes, np.arange(len(nodes))[None], NeoHooke())
    other = plain.point_values(ONE, u)
    assert ratio == pytest.approx(np.full(len(ratio), mean_ratio(nodes, u, kind)), rel=1e-12)
    assert np.ptp(other.strain[0, :, :3].sum(axis=1)) > 0.01


def mean_ratio(nodes: Float, u: Float, kind: str) -> float:
    rule = ELEMENTS[kind].rule("bbar")
    moved, rest = (volumes(points[None], rule).sum() for points in (nodes + u, nodes))
    return float(moved / rest)


@pytest.mark.parametrize("kind", ["hex8", "tet10"])
def test_rubber_does_not_lock(kind: str) -> None:
    """A clamped block under shear, nu 0.4999: "full" is stiffer."""
    mesh = mesh_of(kind, (4, 2, 2), amount=0.03)
    free = np.repeat(mesh.points[:, :1] > 1e-9, 3, axis=1)
    end = mesh.points[:, 0] > mesh.points[:, 0].max() - 1e-9
    load = np.zeros_like(mesh.points)
    load[end, 2] = 6.0 / end.sum()
    moved = {}
    for name in ("bbar", "full"):
        body = Body(mesh, elements(("finite", kind, name), *of(mesh, kind), NeoHooke(0.4999)), free)
        u, steps = body.newton(load, np.zeros_like(load))
        assert steps[-1] <= 1e-11
        moved[name] = float(u[end, 2].mean())
    assert moved["bbar"] > (1.5 if kind == "hex8" else 1.02) * moved["full"]
    ratio = Body(mesh, elements(("finite", kind, "bbar"), *of(mesh, kind), NeoHooke(0.4999)), free)
    forces = ratio.own.response(np.arange(len(ratio.own.cells)), 0.0 * load, Want.FORCES)[0]
    assert np.abs(forces).max() <= 1e-12 * E


def of(mesh: Mesh, kind: str) -> tuple[Float, np.ndarray]:
    return mesh.points, mesh.cells[kind]
