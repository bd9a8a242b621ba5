"""SciPy's private kernels do what the wrapper says of them, and are named nowhere else."""

from __future__ import annotations

import importlib
import inspect
from pathlib import Path

import numpy as np
from scipy.sparse import bsr_matrix

import gpusim
from gpusim.fem.sparse.matrix_product import (
    add_block_product,
    add_rows,
    counting_sort,
    transpose_pattern,
)

RNG = np.random.default_rng(4)
KERNELS = ("coo_tocsr", "csr_tocsc", "csc_matvecs", "bsr_matvec")


def test_scipy_still_has_the_kernels() -> None:
    module = importlib.import_module("scipy.sparse._sparsetools")
    missing = [name for name in KERNELS if not callable(getattr(module, name, None))]
    assert not missing, f"SciPy has moved {missing}: gpusim/fem/sparse/matrix_product.py"


def test_they_are_named_in_one_module() -> None:
    root = Path(inspect.getfile(gpusim)).parent
    found = [p.name for p in root.rglob("*.py") if "_sparsetools" in p.read_text(encoding="utf-8")]
    assert found == ["matrix_product.py"]


def test_a_counting_sort_is_stable_and_a_pattern_is_transposed() -> None:
    key, other = RNG.integers(0, 7, (2, 40)).astype(np.int32)
    start, values, position = counting_sort(key, other, 7)
    order = np.argsort(key, kind="stable")
    assert (position == order).all() and (values == other[order]).all()
    assert (start == np.searchsorted(key[order], np.arange(8))).all()
    _, rows, back = transpose_pattern(start, values, position)
    twice = np.lexsort((np.arange(40), key, other))
    assert (back == twice).all() and (rows == key[twice]).all()


def test_rows_and_products_are_added() -> None:
    table, values = np.ones((5, 9)), RNG.normal(size=(2, 6, 9))
    at = RNG.integers(0, 5, (2, 6)).astype(np.int32)
    wanted = table.copy()
    np.add.at(wanted, at, values)
    add_rows(table, at, values)
    np.testing.assert_allclose(table, wanted, rtol=1e-14)
    matrix = bsr_matrix(RNG.normal(size=(6, 9)), blocksize=(3, 3))
    x, into = RNG.normal(size=9), np.ones(6)
    add_block_product((matrix.indptr, matrix.indices, matrix.data), (2, 3), x, into)
    np.testing.assert_allclose(into, 1.0 + matrix @ x, rtol=1e-14)
