"""Conjugate gradients: what a loop tells on its way leaves the way as it is."""

from __future__ import annotations

import numpy as np

from gpusim.fem import Isotropic, Model
from gpusim.fem.assembly.assembly import assemble
from gpusim.fem.assembly.system import System, make_system
from gpusim.fem.krylov.cg import NumpyCG
from gpusim.fem.krylov.multigrid_preconditioner import Multigrid
from gpusim.fem.model.model import resolve_formulation
from gpusim.fem.multigrid.hierarchy import build_hierarchy
from gpusim.mesh import box, quadratic, split


def body() -> tuple[System, Multigrid]:
    mesh = quadratic(split(box((2.0, 1.1, 0.8), (6, 4, 3)), "tet4"))
    fixed = np.repeat(mesh.points[:, :1] <= 1e-9, 3, axis=1)
    forces = np.random.default_rng(5).normal(size=(3, *mesh.points.shape))
    model = Model(mesh, [Isotropic(1.0, 0.3)], fixed=fixed, forces=forces)
    assembled = assemble(model, resolve_formulation(model, None))
    system = make_system(model, assembled)
    return system, Multigrid(build_hierarchy(assembled, system, mesh.points))


def test_what_is_left_can_be_seen_on_the_way() -> None:
    system, multigrid = body()
    right = system.right.reshape(3, -1)
    first, second = (NumpyCG(multigrid.product, multigrid) for _ in range(2))
    active = np.array([True, False, True])
    first.begin(right)
    before = first.run(7, active)
    second.begin(right)
    lines = []
    for count in (3, 1, 3):
        lines.append(second.run(count, active))
        seen = second.preconditioned()
        np.testing.assert_array_equal(seen, second.preconditioned())
        left = second.residual()
        assert left is not None
        wanted = multigrid.apply(left)
        assert np.abs(seen - wanted).max() <= 1e-12 * np.abs(wanted).max()
    np.testing.assert_array_equal(np.concatenate(lines), before)
    np.testing.assert_array_equal(first.correction(), second.correction())
