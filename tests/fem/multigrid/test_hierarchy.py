"""Levels kept for other values of the stiffness."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.solver.cases import uneven_bricks
from gpusim.fem import Isotropic, Model
from gpusim.fem.assembly.assembly import assemble
from gpusim.fem.assembly.system import System, make_system
from gpusim.fem.krylov.cg import NumpyCG
from gpusim.fem.krylov.multigrid_preconditioner import Multigrid
from gpusim.fem.model.model import resolve_formulation
from gpusim.fem.multigrid import hierarchy as levels
from gpusim.fem.multigrid.hierarchy import Hierarchy, build_hierarchy, rebuilt
from gpusim.fem.multigrid.transfer import MatrixTransfer, NodeTransfer
from gpusim.fem.sparse.block_rows import BlockRows
from gpusim.mesh import Mesh, box, quadratic, split


def moved(size: tuple[float, ...], divisions: tuple[int, ...], amount: float) -> Mesh:
    mesh = box(size, divisions)  # type: ignore[arg-type]
    return mesh.moved(amount * np.random.default_rng(5).uniform(-1.0, 1.0, mesh.points.shape))


def clamped(mesh: Mesh, angle: float, soft: float) -> tuple[Model, System, BlockRows]:
    """Bent to an arc of ``angle`` (rad), every third cell of a modulus of its own."""
    x, y, z = mesh.points.T
    radius = np.ptp(x) / angle
    bent = np.stack([(radius - z) * np.sin(x / radius), y,
                     radius - (radius - z) * np.cos(x / radius)], axis=1)  # fmt: skip
    fixed = np.repeat(x[:, None] < x.min() + 0.05 * np.ptp(x), 3, axis=1)
    fixed[:, 1] |= y < y.min() + 0.02 * np.ptp(y)
    forces = np.where(fixed, 0.0, np.random.default_rng(2).normal(size=bent.shape))
    of_cell = (np.arange(mesh.cell_count) % 3 == 0).astype(np.int32)
    model = Model(
        Mesh(bent, mesh.cells), [Isotropic(1.0, 0.3), Isotropic(soft, 0.2)], fixed, forces,
        material_of_cell=of_cell,
    )  # fmt: skip
    parts = assemble(model, resolve_formulation(model, None))
    return model, make_system(model, parts), parts.rows


def iterations(hierarchy: Hierarchy, system: System) -> tuple[int, np.ndarray]:  # type: ignore[type-arg]
    multigrid = Multigrid(hierarchy)
    loop = NumpyCG(multigrid.product, multigrid)
    first = loop.begin(np.where(system.free, system.right, 0.0).reshape(1, -1))[0]
    for count in range(1, 100):
        history = loop.run(1, np.array([True]))
        if history[-1, 0, 0] * history[-1, 0, 2] <= 1e-20 * first:
            return count, loop.correction()
    raise AssertionError("it doesn't converge")


CASES = {
    "sheets": lambda: uneven_bricks(1.0, 11),
    "aggregates": lambda: split(moved((4.0, 1.0, 1.0), (24, 6, 6), 0.02), "tet4"),
    "columns": lambda: moved((4.0, 2.0, 0.1), (30, 15, 2), 0.004),
    "midsides": lambda: quadratic(split(moved((3.0, 1.0, 1.0), (9, 3, 3), 0.02), "tet4")),
}


@pytest.mark.parametrize("kind", CASES)
def test_levels_kept_are_as_good_as_new_ones(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Another shape, other materials: each is solved, in about as many iterations."""
    mesh = CASES[kind]()
    model, system, _ = clamped(mesh, 0.1, 0.5)
    parts = assemble(model, resolve_formulation(model, None))
    before = build_hierarchy(parts, system, model.mesh.points)
    kinds = [NodeTransfer, MatrixTransfer][kind in ("aggregates", "columns")]
    assert isinstance(before.levels[0].transfer, kinds)
    assert (before.levels[0].smoother is not None) == (kind == "columns")
    turned, tangent, rows = clamped(mesh, 0.6, 0.2)
    fresh = assemble(turned, resolve_formulation(turned, None))
    wanted, x = iterations(build_hierarchy(fresh, tangent, turned.mesh.points), tangent)
    with monkeypatch.context() as kept:
        for name in ("aggregated", "columns_across", "mapped_lattice"):
            kept.setattr(levels, name, None)
        after = rebuilt(before, rows, tangent, turned.mesh.points)
    found, y = iterations(after, tangent)
    assert found <= wanted + 3
    np.testing.assert_allclose(y, x, atol=1e-8 * np.abs(x).max())
    assert after.lowest == pytest.approx(
        build_hierarchy(fresh, tangent, turned.mesh.points).lowest, rel=0.3
    )
    # what was before stays
    assert before.levels[0].product is not after.levels[0].product
    assert iterations(before, system)[0] <= wanted + 3


def test_the_same_values_give_the_same_coarse_matrices() -> None:
    mesh = CASES["sheets"]()
    model, system, rows = clamped(mesh, 0.1, 0.5)
    parts = assemble(model, resolve_formulation(model, None))
    before = build_hierarchy(parts, system, model.mesh.points)
    after = rebuilt(before, rows, system, model.mesh.points)
    for one, other in zip(before.levels, after.levels, strict=True):
        a, b = one.product.matrix.toarray(), other.product.matrix.toarray()
        np.testing.assert_allclose(b, a, atol=1e-14 * np.abs(a).max())
        # it isn't to fall below what more steps had told
        assert one.largest <= other.largest <= 1.1 * one.largest
