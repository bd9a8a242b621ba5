"""Levels of a tangent."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import gpusim as gs
from gpusim.fem.assembly.assembly import assemble
from gpusim.fem.assembly.element_responses import element_responses
from gpusim.fem.assembly.equation import Equation
from gpusim.fem.assembly.system import make_system, scaled_system
from gpusim.fem.model.model import resolve_formulation
from gpusim.fem.multigrid.hierarchy import build_hierarchy
from gpusim.fem.multigrid.transfer import NodeTransfer
from gpusim.mesh import box, quadratic, split


def test_elements_of_a_tangent_do_not_answer_again() -> None:
    """At rest a tangent is the stiffness, and so are its levels, whose midsides are dropped by
    products of matrices in place of elements."""
    bar = quadratic(split(box((3.0, 1.0, 1.0), (12, 5, 5)), "tet4"))
    mesh = bar.moved(0.02 * np.random.default_rng(5).uniform(-1.0, 1.0, bar.points.shape))
    fixed = (bar.points[:, :1] < 0.01).repeat(3, axis=1)
    forces = np.where(fixed, 0.0, 1.0)
    model = gs.Model(mesh, gs.Isotropic(1.0, 0.3), fixed, forces)
    formulation = resolve_formulation(model, None)
    parts = assemble(model, formulation)
    wanted = build_hierarchy(parts, make_system(model, parts), mesh.points)
    equation = Equation(model, element_responses(model, formulation))
    tangent = equation.linearised(np.zeros_like(mesh.points), np.ones(1)).assembled
    right, supports = forces[None], np.zeros((1, *forces.shape))
    system = scaled_system(tangent, mesh.points, ~fixed, right, supports)
    silent = [replace(elements, at=None) for elements in tangent.groups]  # type: ignore[type-var]
    found = build_hierarchy(replace(tangent, groups=silent), system, mesh.points)
    assert isinstance(found.levels[0].transfer, NodeTransfer)
    one, other = (levels.levels[1].product.matrix.toarray() for levels in (wanted, found))
    scale = np.abs(one).max()
    free = np.abs(np.diag(one)) > 1e-12 * scale
    np.testing.assert_allclose(other[free][:, free], one[free][:, free], atol=1e-11 * scale)
    assert found.lowest == pytest.approx(wanted.lowest, rel=1e-6)
