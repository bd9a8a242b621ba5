"""Groups of elements give the matrices of the formulation that was asked for."""

from __future__ import annotations

import numpy as np
import pytest

from gpusim.fem import Isotropic, Model, solve
from gpusim.fem.assembly.element_batches import DistinctGroup, Integrated, model_groups
from gpusim.fem.elements.element_matrix import element_stiffness
from tests.support.element_meshes import SIZE, mesh_of

RUBBER = Isotropic(1.0, 0.49)


@pytest.mark.parametrize("name", ["full", "exact", "bbar"])
def test_straight_tetrahedra_have_the_matrix_of_their_formulation(name: str) -> None:
    mesh = mesh_of("tet10", (3, 2, 2), amount=0.05)
    model = Model(mesh, [RUBBER], fixed=np.zeros(mesh.points.shape, dtype=bool))
    (group,) = model_groups(model, {"tet10": name})
    assert isinstance(group, DistinctGroup)
    # the closed form is of rules that are exact on straight cells
    assert isinstance(group.source, Integrated) == (name == "bbar")
    nodes = mesh.points[group.cells]
    expected = element_stiffness("tet10", nodes, RUBBER.stiffness(), name)
    found = group.at(np.arange(len(group.cells)))
    assert np.abs(found - expected).max() <= 1e-12 * np.abs(expected).max()


def test_mean_dilatation_softens_rubber_of_tetrahedra() -> None:
    mesh = mesh_of("tet10", (3, 2, 2), amount=0.05)
    fixed = np.repeat(mesh.points[:, :1] < 1e-9, 3, axis=1)
    end = mesh.points[:, 0] > SIZE[0] - 1e-9
    force = np.zeros(mesh.points.shape)
    force[end, 2] = 1e-3
    moved = {}
    for name in ("full", "bbar"):
        model = Model(mesh, [Isotropic(1.0, 0.4999)], fixed=fixed, forces=force)
        solution = solve(model, backend="numpy", formulation={"tet10": name})
        assert solution.converged
        moved[name] = float(solution.u[end, 2].mean())
    assert 1.02 * moved["full"] < moved["bbar"] < 1.5 * moved["full"]
