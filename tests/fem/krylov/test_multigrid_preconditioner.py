"""The cycle by runs on lattices against the same by assembled matrices, on asymmetric bodies."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import gpusim.fem.krylov.multigrid_preconditioner as preconditioner
from gpusim import fem
from gpusim.fem.assembly.assembly import assemble
from gpusim.fem.assembly.system import make_system
from gpusim.fem.krylov.multigrid_preconditioner import Multigrid, cycle_dtype
from gpusim.fem.lattice.stencil import StencilProduct, stencil_of
from gpusim.fem.model.model import resolve_formulation
from gpusim.fem.multigrid.hierarchy import build_hierarchy
from gpusim.fem.multigrid.transfer import MatrixTransfer
from gpusim.fem.sparse.matrix_product import Product
from gpusim.mesh import Mesh, box


def multigrid(mesh: Mesh, fixed: np.ndarray, material_of_cell: np.ndarray) -> Multigrid:
    materials = [fem.Isotropic(1.0, 0.3), fem.Isotropic(3.0, 0.2)]
    model = fem.Model(mesh, materials, material_of_cell=material_of_cell, fixed=fixed)
    parts = assemble(model, resolve_formulation(model, None))
    assert parts.lattice is not None
    stencil = stencil_of(parts.rows, parts.lattice, 2.0)
    system = replace(make_system(model, parts), scale=2.0, stencil=stencil)
    return Multigrid(build_hierarchy(parts, system, mesh.points))


def by_matrices(plain: Multigrid) -> Multigrid:
    """The same by assembled matrices."""
    levels = [
        replace(level, product=Product(level.product.matrix)) for level in plain.hierarchy.levels
    ]
    return Multigrid(replace(plain.hierarchy, levels=tuple(levels)))


def uneven(kind: str) -> tuple[Mesh, np.ndarray, np.ndarray]:
    """A body, its supports (a patch, and one component elsewhere), and materials of its cells.

    Of the ``thin`` one no planes can be left out: aggregates are below its only lattice.
    """
    mesh = box((1.0, 0.8, 0.9), (17, 20, 26))
    if kind == "thin":
        mesh = box((1.0, 0.22, 0.14), (50, 11, 7))  # no plate, which would be smoothed by columns
    centre = mesh.points[mesh.cells["hex8"]].mean(axis=1)
    if kind == "angle":
        gone = (centre[:, 0] > 0.5) & (centre[:, 1] > 0.44)
        cells = mesh.cells["hex8"][~gone]
        used, number = np.unique(cells, return_inverse=True)
        mesh = Mesh(mesh.points[used], {"hex8": number.reshape(-1, 8)})
    if kind == "shuffled":
        number = np.random.default_rng(2).permutation(mesh.node_count)
        points = np.empty_like(mesh.points)
        points[number] = mesh.points
        mesh = Mesh(points, {"hex8": number[mesh.cells["hex8"]]})
    centre = mesh.points[mesh.cells["hex8"]].mean(axis=1)
    x, y, z = mesh.points.T
    fixed = np.zeros(mesh.points.shape, dtype=bool)
    fixed[(x < 1e-9) & (y < 0.5)] = True
    fixed[z < 1e-9, 1] = True
    layer = (centre[:, 2] > 0.45).astype(np.int64) if kind == "layered" else np.zeros(len(centre))
    return mesh, fixed, layer.astype(np.int64)


@pytest.mark.parametrize("kind", ["plain", "angle", "shuffled", "layered", "thin"])
def test_it_is_the_cycle_by_assembled_matrices(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    mesh, fixed, layer = uneven(kind)
    plain = multigrid(mesh, fixed, layer)
    finest = plain.hierarchy.levels[0]
    assert isinstance(finest.product, StencilProduct)
    assert isinstance(finest.transfer, MatrixTransfer) == (kind == "thin")
    rng = np.random.default_rng(3)
    # with reactions in the fixed unknowns, which mustn't matter
    r = rng.normal(size=(2, fixed.size))
    expected = by_matrices(plain).apply(r)
    size = np.abs(expected).max()
    for dtype, tolerance in ((np.float64, 1e-13), (np.float32, 2e-5)):
        monkeypatch.setattr(preconditioner, "cycle_dtype", lambda *_, dtype=dtype: dtype)
        got = Multigrid(plain.hierarchy).apply(r)
        assert np.isfinite(got).all()
        assert np.abs(got - expected).max() <= tolerance * size
        assert not got[:, fixed.ravel()].any()
        if dtype == np.float32:
            # and it is indeed the other arithmetic
            assert np.abs(got - expected).max() > 1e-12 * size


@pytest.mark.parametrize("kind", ["layered", "thin"])
@pytest.mark.parametrize("way", ["runs", "runs float32", "assembled"])
def test_half_a_cycle_tells_the_energy_and_load_cases_keep_apart(
    way: str, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    mesh, fixed, layer = uneven(kind)
    dtype = np.float32 if way == "runs float32" else np.float64
    monkeypatch.setattr(preconditioner, "cycle_dtype", lambda *_: dtype)
    one = multigrid(mesh, fixed, layer)
    if way == "assembled":
        one = by_matrices(one)
    r = np.random.default_rng(3).normal(size=(3, fixed.size)) * np.array([[1.0], [1e-9], [1e7]])
    z = one.apply(r)
    tolerance = 3e-6 if dtype == np.float32 else 1e-13
    first = one.down(r[:2], [0, 1])
    rest = one.down(r[2:], [2])
    np.testing.assert_allclose(
        np.concatenate([first, rest]), np.einsum("ln,ln->l", r, z), rtol=tolerance
    )
    # ended in another order than begun, and not all of them
    for case in (2, 0):
        (got,) = one.up([case])
        assert np.abs(got - z[case]).max() <= 1e-14 * np.abs(z[case]).max()


def test_rounding_that_would_drown_the_softest_motion_asks_for_float64() -> None:
    assert cycle_dtype(1e-4, 10.0) is np.float32
    assert cycle_dtype(1e-7, 10.0) is np.float64
    assert cycle_dtype(1e-4, 1e5) is np.float64
    assert cycle_dtype(float("nan"), 10.0) is np.float64
