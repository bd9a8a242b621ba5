"""Ways in which a solve could be wrong without saying so."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from threadpoolctl import threadpool_info

from benchmarks.stability.hard_bodies import cantilever
from gpusim import InputError, Isotropic, Mesh, Model, NotConverged, solve
from gpusim.fem.assembly.assembly import assemble
from gpusim.fem.krylov.multigrid_preconditioner import Multigrid
from gpusim.fem.model import supports
from gpusim.fem.model.model import resolve_formulation
from gpusim.fem.multigrid import hierarchy
from gpusim.fem.sparse.block_rows import block_matrix
from gpusim.mesh import box, quadratic, split
from tests.support.element_meshes import mixed_mesh
from tests.support.two_blas_threads import two_blas_threads

Float = npt.NDArray[np.float64]


def lattice(*planes: npt.ArrayLike) -> tuple[Float, npt.NDArray[np.int64]]:
    axes = [np.asarray(one, dtype=np.float64) for one in planes]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    n = np.arange(len(points)).reshape([len(one) for one in axes])
    a, b = n[:, :, :-1], n[:, :, 1:]
    cells = [
        part[x : len(n) - 1 + x, y : n.shape[1] - 1 + y]
        for part in (a, b)
        for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))
    ]
    return points, np.stack(cells, axis=-1).reshape(-1, 8)


def glued(thickness: float, second: float) -> Model:
    """Two blocks with two thin soft layers between them."""
    z = np.cumsum([0.0, 1.0, thickness, second * thickness, 1.0, 1.0])
    points, cells = lattice(range(4), range(4), z)
    height = points[cells][:, :, 2].mean(axis=1)
    layer = ((height > z[1]) & (height < z[3])).astype(np.int32)
    fixed = np.repeat(points[:, 2:] == 0.0, 3, axis=1)
    forces = np.zeros(points.shape)
    forces[points[:, 2] == z[-1]] = (1.0, 0.0, 0.3)
    materials = [Isotropic(1.0, 0.3), Isotropic(1e-2 * thickness, 0.3)]
    return Model(Mesh(points, {"hex8": cells}), materials, fixed, forces, layer)


def test_an_indefinite_preconditioner_is_no_convergence() -> None:
    model = glued(1e-4, 1.02)
    right = solve(model, backend="numpy", method="direct", formulation="full")
    assert right.converged
    try:
        tried = solve(model, backend="numpy", method="multigrid", formulation="full")
    except NotConverged:
        return
    error = np.linalg.norm(tried.u - right.u) / np.linalg.norm(right.u)
    assert not tried.converged or error <= 1e-6


def test_thin_layers_of_nearly_the_same_thickness_keep_their_own() -> None:
    """Spacings are compared with themselves, not with the longest one."""
    model = glued(2e-9, 1.0004)
    matrices = assemble(model, resolve_formulation(model, "full")).groups[0].matrices
    # the blocks', and one for each layer, whose stiffness is as its thickness
    assert len(matrices) == 3
    ratio = matrices[1, 2, 2] / matrices[2, 2, 2]
    assert max(ratio, 1.0 / ratio) == pytest.approx(1.0004, rel=1e-6)


def test_a_lattice_gives_a_symmetric_matrix_to_the_last_bit() -> None:
    points, cells = lattice(np.cumsum(1.1 ** np.arange(6)), range(5), (0.0, 0.7, 1.3, 3.1))
    material = np.random.default_rng(2).integers(0, 2, len(cells)).astype(np.int32)
    mesh = Mesh(points * np.pi, {"hex8": cells})
    model = Model(mesh, [Isotropic(1.1, 0.3), Isotropic(3.3, 0.21)], material_of_cell=material)
    matrix = block_matrix(assemble(model, resolve_formulation(model, None)).rows).tocsr()
    assert abs(matrix - matrix.T).max() == 0.0


@pytest.mark.parametrize("free", [slice(0, 3), slice(1, 2)])
def test_multigrid_where_no_coarse_node_is_free(free: slice) -> None:
    points, cells = lattice(range(17), range(9), range(9))
    fixed = np.ones(points.shape, dtype=bool)
    odd = int(np.flatnonzero((points == (3.0, 5.0, 1.0)).all(axis=1))[0])
    fixed[odd, free] = False
    forces = np.zeros(points.shape)
    forces[odd] = (1.0, -2.0, 0.5)
    model = Model(Mesh(points, {"hex8": cells}), [Isotropic(7.0, 0.2)], fixed, forces)
    right = solve(model, backend="numpy", method="direct").u
    solution = solve(model, backend="numpy", method="multigrid")
    assert solution.converged
    np.testing.assert_allclose(solution.u, right, atol=1e-6 * np.abs(right).max())


def test_threads_get_the_same_bits_and_leave_blas_as_it_was() -> None:
    models = []
    for counts in ((13, 13, 13), (31, 5, 6)):
        points, cells = lattice(*(range(n) for n in counts))
        fixed = np.repeat(points[:, :1] == 0.0, 3, axis=1)
        forces = np.random.default_rng(3).standard_normal(points.shape)
        mesh = Mesh(points, {"hex8": cells})
        models.append(Model(mesh, [Isotropic(1.0, 0.3)], fixed, forces))
    alone = [solve(model, backend="numpy", method="direct").u for model in models]
    together: dict[int, Float] = {}

    def run(number: int) -> None:
        together[number] = solve(models[number % 2], backend="numpy", method="direct").u

    threads = [threading.Thread(target=run, args=(number,)) for number in range(4)]
    with two_blas_threads():
        before = [one["num_threads"] for one in threadpool_info()]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert [one["num_threads"] for one in threadpool_info()] == before
        assert 2 in before
    for number in range(4):
        assert np.array_equal(together[number], alone[number % 2])


def irregular(tets: bool, size: tuple[float, float, float]) -> Model:
    """A clamped bar, pulled at a corner and twisted, with elements all of different shape."""
    mesh = box(size, tuple(round(5 * length) for length in size))
    mesh = split(mesh, "tet4") if tets else mesh
    low, high = mesh.bounds
    inside = ((mesh.points > low) & (mesh.points < high)).all(axis=1)
    step = 0.03 * np.random.default_rng(6).uniform(-1.0, 1.0, mesh.points.shape)
    mesh = mesh.moved(np.where(inside[:, None], step, 0.0))
    mesh = quadratic(mesh) if tets else mesh
    forces = np.zeros((2, *mesh.points.shape))
    forces[0, int(np.argmax(mesh.points.sum(axis=1)))] = (1.0, 0.3, -2.0)
    end = mesh.points[:, 0] == mesh.points[:, 0].max()
    forces[1, end] = np.cross(mesh.points[end] - mesh.points[end].mean(axis=0), (1.0, 0.0, 0.0))
    fixed = np.repeat(mesh.points[:, :1] == 0.0, 3, axis=1)
    return Model(mesh, [Isotropic(1.0, 0.3)], fixed=fixed, forces=forces)


@pytest.mark.parametrize("tets", [True, False])
@pytest.mark.parametrize("size", [(1.4, 1.0, 0.8), (8.0, 0.8, 0.6)])
def test_the_estimate_covers_every_node(tets: bool, size: tuple[float, float, float]) -> None:
    model = irregular(tets, size)
    exact = solve(model, tolerance=1e-12, method="direct").u
    for tolerance in (1e-2, 1e-4, 1e-6, 1e-8):
        found = solve(model, tolerance=tolerance, method="multigrid", backend="numpy")
        error = np.abs(found.u - exact).max(axis=(1, 2)) / np.abs(exact).max(axis=(1, 2))
        assert found.converged and error.max() <= found.error_estimate <= tolerance


def test_supports_are_looked_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    model = irregular(True, (1.0, 0.6, 0.4))
    looks: list[int] = []
    parts = supports._parts
    monkeypatch.setattr(supports, "_parts", lambda mesh: (looks.append(1), parts(mesh))[1])
    supports.check_supports(model)
    solve(model, backend="numpy")
    assert looks == [1]


@pytest.mark.parametrize("backend", ["numpy", "gpu"])
@pytest.mark.parametrize("other", [False, True])
def test_a_start_near_the_answer_claims_nothing(other: bool, backend: str) -> None:
    """What is left to correct is small beside the start from the first iteration on, which knows
    nothing of soft modes yet: 2 to 4 times the tolerance off, after one iteration."""
    model = cantilever(box((100.0, 1.0, 0.7), (50, 2, 2)))
    exact = solve(model, tolerance=1e-10, method="direct").u
    start = exact + 3e-4 * (exact[::-1] if other else exact)
    found = solve(model, tolerance=1e-4, method="multigrid", backend=backend, start=start)
    error = np.abs(found.u - exact).max(axis=(1, 2)) / np.abs(exact).max(axis=(1, 2))
    assert found.converged and error.max() <= found.error_estimate <= 1e-4


@pytest.mark.parametrize("off", [2.0, 4.0])
def test_a_start_near_the_answer_is_not_taken_for_right_by_a_rough_eigenvalue(
    off: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The hierarchy's least eigenvalue may be several times too large: on loose and curved bodies
    starts counted as right that were 20 times as far off as was stated."""
    model = cantilever(box((100.0, 1.0, 0.7), (50, 2, 2)))
    exact = solve(model, tolerance=1e-10, method="direct").u
    right = hierarchy._lowest_eigenvalue
    monkeypatch.setattr(hierarchy, "_lowest_eigenvalue", lambda *given: 6.0 * right(*given))
    start = (1.0 + off * 1e-3) * exact
    found = solve(model, tolerance=1e-3, method="multigrid", backend="numpy", start=start)
    error = np.linalg.norm(found.u - exact) / np.linalg.norm(exact)
    assert found.converged and error <= found.error_estimate <= 1e-3


def test_a_preconditioner_that_turns_signs_is_told_whatever_the_start(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """r.z below zero: with a start, it once counted as an error of zero."""
    model = irregular(True, (1.0, 0.6, 0.4))
    exact = solve(model, tolerance=1e-10, method="direct").u
    monkeypatch.setattr(Multigrid, "down", lambda self, r, cases: -np.ones(len(cases)))
    with pytest.raises(NotConverged, match="isn't positive definite"):
        solve(model, method="multigrid", backend="numpy", start=0.5 * exact)


@pytest.mark.parametrize("method", ["multigrid", "auto"])
def test_coarse_elements_that_are_held_altogether_tell_nothing(method: str) -> None:
    """Two layers of a lattice clamped: the first coarse element has no free unknown."""
    mesh = box((1.0, 1.0, 1.0), (16, 16, 16))
    fixed = np.repeat(mesh.points[:, :1] <= 2.1 / 16, 3, axis=1)
    forces = np.zeros(mesh.points.shape)
    forces[mesh.points[:, 0] == 1.0] = (0.1, 0.0, 1.0)
    model = Model(mesh, [Isotropic(1.0, 0.3)], fixed=fixed, forces=forces)
    exact = solve(model, tolerance=1e-10, method="direct").u
    found = solve(model, method=method, backend="numpy")
    assert found.converged
    assert np.linalg.norm(found.u - exact) <= 1e-6 * np.linalg.norm(exact)


def test_any_number_of_loose_bodies_is_solved_by_multigrid() -> None:
    """They can't be aggregated beyond one another: 3,500 of them have 21,000 rigid motions."""
    one, count = box((1.0, 1.0, 1.0), (1, 1, 1)), 3500
    points = np.concatenate([one.points + np.array([0.0, 3.0 * k, 0.0]) for k in range(count)])
    cells = np.concatenate([one.cells["hex8"] + 8 * k for k in range(count)]).astype(np.int32)
    fixed = np.repeat(points[:, :1] == 0.0, 3, axis=1)
    forces = np.random.default_rng(1).normal(size=points.shape)
    model = Model(Mesh(points, {"hex8": cells}), [Isotropic(1.0, 0.3)], fixed=fixed, forces=forces)
    found = solve(model, method="multigrid", backend="numpy")
    assert found.converged
    exact = solve(model, tolerance=1e-10, method="direct").u
    assert np.linalg.norm(found.u - exact) <= 1e-6 * np.linalg.norm(exact)


def test_multigrid_where_a_type_of_cells_touches_no_support() -> None:
    mesh = quadratic(mixed_mesh())
    fixed = np.repeat(mesh.points[:, :1] == mesh.points[:, 0].min(), 3, axis=1)
    forces = np.random.default_rng(4).normal(size=mesh.points.shape)
    model = Model(mesh, [Isotropic(1.0, 0.3)], fixed=fixed, forces=forces)
    right = solve(model, backend="numpy", method="direct").u
    solution = solve(model, backend="numpy", method="multigrid")
    assert solution.converged
    np.testing.assert_allclose(solution.u, right, atol=1e-6 * np.abs(right).max())


@pytest.mark.parametrize("method", ["multigrid", "direct"])
@pytest.mark.parametrize(
    ("modulus", "contrast", "load"), [(1e-320, 1.0, 1.0), (1.0, 1.0, 1e-320), (1.0, 1e30, 1.0)]
)
def test_numbers_beyond_float64_are_refused(
    modulus: float, contrast: float, load: float, method: str
) -> None:
    mesh = box((2.0, 1.0, 1.0), (4, 2, 2))
    materials = [Isotropic(modulus, 0.3), Isotropic(contrast * modulus, 0.3)]
    other = (np.arange(mesh.cell_count) % 2).astype(np.int32)
    model = cantilever(mesh, materials, material_of_cell=other, load=load)
    with pytest.raises(NotConverged, match="expected"):
        solve(model, method=method, backend="numpy")


@pytest.mark.parametrize("given", [{"start": np.full((45, 3), 1j)}, {"progress": 3}])
def test_what_is_no_start_or_no_function_is_refused(given: dict[str, Any]) -> None:
    model = cantilever(box((2.0, 1.0, 1.0), (4, 2, 2)))
    with pytest.raises(InputError, match="expected"):
        solve(model, method="multigrid", backend="numpy", **given)
