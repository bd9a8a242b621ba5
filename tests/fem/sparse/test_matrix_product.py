"""Host products against dense matrices, on meshes whose rows are all different."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import bsr_matrix

from benchmarks.solver.cases import CASES
from benchmarks.solver.operator import host_probe
from gpusim import fem
from gpusim.fem.assembly.assembly import assemble
from gpusim.fem.model.model import resolve_formulation
from gpusim.fem.multigrid.transfer import MatrixTransfer, in_single
from gpusim.fem.sparse.block_rows import BlockRows, block_matrix
from gpusim.fem.sparse.matrix_product import Product
from gpusim.mesh import Mesh, box


def rows_of(mesh: Mesh) -> BlockRows:
    model = fem.Model(mesh, [fem.Isotropic(3.0, 0.3)], fixed=np.zeros(mesh.points.shape, bool))
    return assemble(model, resolve_formulation(model, None)).rows


def uneven() -> Mesh:
    mesh = box((1.0, 0.4, 0.7), (5, 4, 3))
    return mesh.moved(0.02 * np.random.default_rng(5).random(mesh.points.shape))


@pytest.mark.parametrize("scale", [1.0, 8.0])
def test_a_table_that_is_the_matrix_multiplies_like_it(scale: float) -> None:
    rows = rows_of(uneven())
    product = Product.of_rows(rows, scale)
    assert product.apart
    dense = block_matrix(rows).toarray() / scale
    np.testing.assert_allclose(product.matrix.toarray(), dense, rtol=1e-15)
    x = np.random.default_rng(1).normal(size=(2, len(dense)))
    expected = x @ dense.T
    assert product.unknowns == len(dense)
    np.testing.assert_allclose(product(x), expected, atol=1e-13 * np.abs(expected).max())
    plain = Product(block_matrix(rows, scale))
    np.testing.assert_allclose(product(x), plain(x), atol=1e-13 * np.abs(expected).max())


def test_a_table_of_repeating_rows_is_not_the_matrix() -> None:
    assert not Product.of_rows(rows_of(box((1.0, 0.4, 0.7), (7, 6, 5))), 1.0).apart


def test_the_probe_counts_what_its_product_reads() -> None:
    case = next(case for case in CASES if case.name == "cube-10k")
    probe = host_probe(case, case.model())
    assert probe.unknowns > 9000
    # 27 blocks of 76 bytes for three unknowns, and two vectors: somewhat less at the border
    assert 500 < probe.assembled / probe.unknowns < 27 * 76 / 3 + 16
    result = probe.apply()
    assert result.shape == (1, probe.unknowns)
    assert np.isfinite(result).all()


def test_shares_of_the_rows_give_the_same_to_the_last_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    matrix = block_matrix(rows_of(uneven()))
    x = np.random.default_rng(1).normal(size=(2, matrix.shape[1]))
    whole = Product(matrix)(x)
    monkeypatch.setattr("gpusim.fem.sparse.matrix_product._SMALL", 0)
    monkeypatch.setattr("gpusim.fem.sparse.matrix_product._LEAST_PART", matrix.data.size // 3 + 1)
    monkeypatch.setattr("gpusim.fem.sparse.matrix_product.processors", lambda: 2)
    shared = Product(matrix)
    assert len(shared._parts) == 3 and (shared(x) == whole).all()
    monkeypatch.setattr("gpusim.fem.sparse.matrix_product._LEAST_PART", 1)
    assert len(Product(matrix)._parts) == 8 and (Product(matrix)(x) == whole).all()


@pytest.mark.parametrize("size", [1e-200, 1.0, 1e200])
def test_interpolation_in_float32_takes_vectors_of_any_size(size: float) -> None:
    rng = np.random.default_rng(6)
    dense = rng.normal(size=(30, 12)) * (rng.random((30, 12)) < 0.5)
    exact = bsr_matrix(dense, blocksize=(3, 6))
    transfer = MatrixTransfer(in_single(exact))
    c, r = size * rng.normal(size=(2, 12)), size * rng.normal(size=(2, 30))
    c[1] *= 1e-60  # each load case is scaled by itself
    for got, wanted in (
        (transfer.interpolate(c), c @ dense.T),
        (transfer.restrict(r), r @ dense),
    ):
        assert got.dtype == np.float64
        for one, other in zip(got, wanted, strict=True):
            assert 0.0 < np.abs(one - other).max() <= 5e-7 * np.abs(other).max()
    assert not transfer.restrict(np.zeros((1, 30))).any()
    # what isn't a number isn't made one
    assert np.isnan(transfer.restrict(np.full((1, 30), np.nan))).any()
    # with a float64 matrix nothing is rounded
    plain = MatrixTransfer(exact)
    np.testing.assert_allclose(plain.restrict(r), r @ dense, rtol=1e-13, atol=1e-15 * size)
