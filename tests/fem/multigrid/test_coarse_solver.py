"""The coarsest level of multigrid: which bodies' matrices are narrow, and what solves with them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import bsr_matrix, kron

import gpusim.fem.multigrid.hierarchy as hierarchy
from gpusim import fem
from gpusim.errors import NotConverged
from gpusim.fem.multigrid.coarse_solver import CoarseSolver, narrow_order
from gpusim.mesh import Mesh, box


def chain(links: int, seed: int = 4) -> tuple[bsr_matrix, np.ndarray]:
    """A chain of 6x6 blocks in shuffled order, and which unknowns exist; the others' rows hold
    zeros."""
    rng = np.random.default_rng(seed)
    size = 6 * links
    dense = np.zeros((size, size))
    for first in range(links - 1):
        own = slice(6 * first, 6 * first + 12)
        factor = rng.normal(size=(12, 12))
        dense[own, own] += factor @ factor.T
    order = np.repeat(6 * rng.permutation(links), 6) + np.tile(np.arange(6), links)
    mask = rng.random((links, 6)) > 0.1
    dense = dense[np.ix_(order, order)] * mask.ravel()[:, None] * mask.ravel()
    return bsr_matrix(dense, blocksize=(6, 6)), mask


@pytest.mark.parametrize("banded", [False, True])
def test_it_solves_with_the_unknowns_that_exist(banded: bool) -> None:
    matrix, mask = chain(40)
    order = narrow_order(matrix, 30_000) if banded else None
    assert (order is not None) == banded
    bottom = CoarseSolver(matrix, mask, order)
    kept = mask.ravel()
    b = np.random.default_rng(5).normal(size=(2, kept.size))
    expected = np.zeros_like(b)
    expected[:, kept] = np.linalg.solve(matrix.toarray()[np.ix_(kept, kept)], b[:, kept].T).T
    for got in (bottom.solve(b), b @ bottom.inverse):
        assert np.abs(got - expected).max() <= 1e-9 * np.abs(expected).max()
        assert not got[:, ~kept].any()
    assert (bottom.inverse == bottom.inverse.T).all()
    # an entry off by a hundredth is seen
    matrix.data[len(matrix.data) // 2, 0, 0] *= 1.01
    wrong = CoarseSolver(matrix, mask, order).solve(b)
    assert np.abs(wrong - expected).max() > 1e-6 * np.abs(expected).max()


def test_chains_are_narrow_in_any_numbering_and_cubes_are_not() -> None:
    matrix, _ = chain(60)
    order = narrow_order(matrix, 30_000)
    assert order is not None
    assert sorted(order) == list(range(60))
    line = np.eye(9) + np.eye(9, k=1) + np.eye(9, k=-1)
    cube = kron(kron(line, line), line)
    wide = bsr_matrix(kron(cube, np.ones((6, 6))), blocksize=(6, 6))
    assert narrow_order(wide, 30_000) is None


@pytest.mark.parametrize("banded", [False, True])
@pytest.mark.parametrize("how", ["negative pivot", "no diagonal"])
def test_a_matrix_that_is_not_definite_is_told(banded: bool, how: str) -> None:
    matrix, mask = chain(40)
    order = narrow_order(matrix, 30_000) if banded else None
    mask[:] = True
    if how == "negative pivot":
        matrix, _ = chain(40)
        matrix = bsr_matrix(matrix - 3.0 * bsr_matrix(np.eye(240)), blocksize=(6, 6))
    with pytest.raises(NotConverged, match="coarsest level: the stiffness isn't positive definite"):
        CoarseSolver(matrix, mask, order)


def slender(kind: str) -> fem.Model:
    mesh = box((300.0, 2.0, 2.0), (300, 5, 5))
    if kind == "moved":
        inner = (mesh.points[:, :1] > 0.0) & (mesh.points[:, :1] < 300.0)
        move = np.random.default_rng(2).uniform(-0.05, 0.05, mesh.points.shape)
        mesh = mesh.moved(move * inner)
    fixed = np.repeat(mesh.points[:, :1] < 1e-9, 3, axis=1)
    return fem.Model(mesh, [fem.Isotropic(210e3, 0.3)], fixed=fixed, forces=_pull(mesh))


def _pull(mesh: Mesh) -> np.ndarray:
    forces = np.zeros(mesh.points.shape)
    end = mesh.points[:, 0] > mesh.points[:, 0].max() - 1e-9
    forces[end] = np.array([0.0, 2.0, -1.0]) / end.sum()
    return forces


@pytest.mark.parametrize("kind", [pytest.param("lattice", marks=pytest.mark.slow), "moved"])
def test_long_bodies_end_in_a_band_and_have_fewer_levels(
    kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = slender(kind)
    exact = fem.solve(model, method="direct").u
    sizes, levels, iterations = [], [], []
    build = hierarchy._aggregate

    def seen(*given: object) -> hierarchy.Hierarchy:
        result = build(*given)
        sizes.append(result.coarsest.unknowns)
        levels.append(len(result.levels))
        return result

    monkeypatch.setattr(hierarchy, "_aggregate", seen)
    for _ in range(2):
        found = fem.solve(model, tolerance=1e-6, method="multigrid", backend="numpy")
        assert np.linalg.norm(found.u - exact) <= 1e-6 * np.linalg.norm(exact)
        iterations.append(found.iterations)
        monkeypatch.setattr(hierarchy, "_COARSEST_BAND", 0)
    band, further = sizes
    assert 800 < band <= 8000  # of 32,000
    assert further <= 800
    assert levels[0] < levels[1]
    assert iterations[0] <= iterations[1]


def test_aggregates_are_gone_through_twice_and_take_fewer_iterations(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    mesh = box((80.0, 30.0, 2.0), (80, 30, 2))
    inner = (mesh.points[:, :1] > 0.0) & (mesh.points[:, :1] < 80.0)
    mesh = mesh.moved(np.random.default_rng(2).uniform(-0.05, 0.05, mesh.points.shape) * inner)
    fixed = np.repeat(mesh.points[:, :1] < 1e-9, 3, axis=1)
    model = fem.Model(mesh, [fem.Isotropic(210e3, 0.3)], fixed=fixed, forces=_pull(mesh))
    exact = fem.solve(model, method="direct").u
    monkeypatch.setattr(hierarchy, "_COARSEST_BAND", 0)  # several levels of aggregates
    iterations = []
    build = hierarchy.build_hierarchy
    for twice in (True, False):

        def made(*given: object, twice: bool = twice, **options: object) -> hierarchy.Hierarchy:
            result = build(*given, **options)
            levels = tuple(replace(one, twice=one.twice and twice) for one in result.levels)
            return replace(result, levels=levels)

        monkeypatch.setattr("gpusim.fem.linear.multigrid_solver.build_hierarchy", made)
        found = fem.solve(model, tolerance=1e-6, method="multigrid", backend="numpy")
        assert np.linalg.norm(found.u - exact) <= 1e-6 * np.linalg.norm(exact)
        iterations.append(found.iterations)
    assert iterations[0] <= 0.75 * iterations[1]
