"""The static solver against references, closed forms, and everything that must be refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from scipy.sparse.linalg import splu

from gpusim.errors import InputError, NotConverged, OutOfDeviceMemory, TwinMismatch
from gpusim.fem import Isotropic, Model, Solution, face_force, solve
from gpusim.fem.assembly.assembly import assemble
from gpusim.fem.device.stiffness import DeviceStiffness
from gpusim.fem.krylov.cg import NumpyCG, Preconditioner
from gpusim.fem.model.model import resolve_formulation
from gpusim.fem.sparse.block_rows import block_matrix
from gpusim.fem.sparse.stiffness_product import apply_stiffness
from gpusim.gpu import Device, compare
from gpusim.mesh import Mesh, box, select_faces


def cantilever(
    size: tuple[float, float, float] = (10.0, 1.0, 0.7),
    divisions: tuple[int, int, int] = (20, 2, 3),
    material: Isotropic = Isotropic(1e5, 0.0),  # noqa: B008 - frozen
    load: float = 1.0,
) -> Model:
    mesh = box(size, divisions)
    fixed = np.zeros(mesh.points.shape, dtype=bool)
    fixed[mesh.points[:, 0] == 0.0] = True
    tip = select_faces(mesh, name="x_max")
    forces = np.stack(
        [face_force(mesh, tip, (0.0, 0.0, load)), face_force(mesh, tip, (load, 0, 0))]
    )
    return Model(mesh, [material], fixed=fixed, forces=forces)


def reference(refs: Path, name: str) -> tuple[Model, Any]:
    with np.load(refs / name) as archive:
        data = dict(archive)
    mesh = Mesh(data["points"], {str(data["cell_type"]): data["cells"]})
    materials = [Isotropic(float(e), float(n)) for e, n in zip(data["E"], data["nu"], strict=True)]
    model = Model(
        mesh,
        materials,
        material_of_cell=data["mat"],
        fixed=data["fixed_dofs"],
        forces=data["loads"],
    )
    return model, data


def worst(u: np.ndarray, wanted: np.ndarray) -> float:
    assert np.isfinite(u).all() and u.shape == wanted.shape
    return max(float(np.abs(a - b).max() / np.abs(b).max()) for a, b in zip(u, wanted, strict=True))


def trusted(solution: Solution, tolerance: float = 1e-6) -> None:
    assert solution.converged, solution.message
    assert solution.error_estimate <= tolerance
    assert solution.energy_balance <= 1e-5


@pytest.mark.parametrize(("rule", "backend"), [("incomp", "gpu"), ("full", "numpy")])
def test_notched_cantilever(refs: Path, device: Device, rule: str, backend: str) -> None:
    model, data = reference(refs, "ref1_notched_cantilever_hex8_n0.npz")
    formulation = {"incomp": "incompatible"}.get(rule, rule)
    solution = solve(model, device, formulation=formulation, backend=backend)
    trusted(solution)
    error = worst(solution.u, data[f"u_{rule}"])
    assert error <= 1e-6
    # the estimate is a bound, not a guess: never below the truth, and not absurdly above it
    assert error <= solution.error_estimate


def test_two_materials(refs: Path) -> None:
    model, data = reference(refs, "ref4_two_material_bar_hex8.npz")
    solution = solve(model, backend="numpy", formulation="full")
    trusted(solution)
    assert worst(solution.u, data["u_full"]) <= 1e-6


@pytest.mark.parametrize("method", ["direct", "multigrid"])
def test_tets(refs: Path, device: Device, method: str) -> None:
    model, data = reference(refs, "ref6_cube_tet4.npz")
    solution = solve(model, device, method=method)
    trusted(solution)
    assert worst(solution.u, data["u_full"]) <= 1e-6


@pytest.mark.parametrize("real", ["f64", "double_single"])
def test_device_and_twin_backend_agree_and_the_beam_formula_holds(real: str) -> None:
    model = cantilever()
    on_device = solve(model, Device(real=real), tolerance=1e-8, method="multigrid")
    twin = solve(model, backend="numpy", tolerance=1e-8, method="multigrid")
    assert on_device.real == real and twin.backend == "numpy"
    trusted(on_device, 1e-8)
    assert worst(on_device.u, twin.u) <= 2e-8
    tip = model.mesh.points[:, 0] == 10.0
    # Timoshenko beam, kappa = 5/6, nu = 0
    inertia, area, shear = 1.0 * 0.7**3 / 12, 0.7, 0.5e5
    bending = 10.0**3 / (3 * 1e5 * inertia) + 10.0 / (5 / 6 * shear * area)
    assert twin.u[0, tip, 2].mean() == pytest.approx(bending, rel=4e-3)
    assert twin.u[1, tip, 0].mean() == pytest.approx(10.0 / (1e5 * 0.7), rel=1e-8)
    np.testing.assert_allclose(twin.reactions.sum(axis=1), [[0, 0, -1], [-1, 0, 0]], atol=1e-6)


def test_repeatable_to_the_last_bit(device: Device) -> None:
    model = cantilever()
    for method in ("direct", "multigrid"):
        one, two = (solve(model, device, method=method) for _ in range(2))
        np.testing.assert_array_equal(one.u, two.u)


@pytest.mark.parametrize("formulation", ["incompatible", "full", "bbar"])
def test_patch_test_by_prescribed_displacements(device: Device, formulation: str) -> None:
    mesh = box((1.0, 0.8, 1.3), (3, 4, 3))
    low, high = mesh.bounds
    skin = ((mesh.points == low) | (mesh.points == high)).any(axis=1)
    points = mesh.points.copy()
    points[~skin] += 0.04 * np.random.default_rng(3).uniform(-1, 1, (int((~skin).sum()), 3))
    gradient = 1e-3 * np.array([[1.0, 0.3, -0.2], [0.5, -0.7, 0.1], [0.4, 0.2, 0.6]])
    exact = points @ gradient.T
    fixed = np.repeat(skin[:, None], 3, axis=1)
    model = Model(
        Mesh(points, mesh.cells),
        [Isotropic(210e9, 0.3)],
        fixed=fixed,
        prescribed=np.where(fixed, exact, 0.0),
    )
    solution = solve(model, device, formulation=formulation, tolerance=1e-10)
    assert solution.converged
    assert np.abs(solution.u - exact).max() <= 1e-9 * np.abs(exact).max()


def test_the_estimate_on_a_device_bounds_the_error(device: Device) -> None:
    model = cantilever(material=Isotropic(2e5, 0.3))
    exact = solve(model, backend="numpy", tolerance=1e-10).u
    solution = solve(model, device, method="multigrid", tolerance=1e-5)
    trusted(solution, 1e-5)
    assert worst(solution.u, exact) <= 1e-5
    assert solution.residuals.shape == (solution.iterations, 2)


def test_no_load_is_exactly_zero_at_once(device: Device) -> None:
    solution = solve(cantilever(load=0.0), device)
    assert solution.converged and solution.iterations == 0
    np.testing.assert_array_equal(solution.u, 0.0)


def test_a_case_without_load_beside_one_with() -> None:
    model = cantilever()
    forces = model.load_cases.copy()
    forces[1] = 0.0
    solution = solve(
        Model(model.mesh, model.materials, fixed=model.fixed, forces=forces),
        backend="numpy",
        method="multigrid",
    )
    trusted(solution)
    assert solution.message == "converged"
    np.testing.assert_array_equal(solution.u[1], 0.0)
    assert np.abs(solution.u[0]).max() > 0.0


@pytest.mark.parametrize("factor", [1e-30, 1e30])
def test_extreme_units_do_not_matter(factor: float) -> None:
    model = cantilever()
    scaled = Model(
        model.mesh,
        [Isotropic(1e5 * factor, 0.0)],
        fixed=model.fixed,
        forces=model.load_cases * factor**2,
    )
    one = solve(model, backend="numpy").u
    np.testing.assert_allclose(
        solve(scaled, Device(real="double_single")).u / factor, one, atol=1e-5 * np.abs(one).max()
    )


def test_start_at_the_answer_takes_hardly_an_iteration() -> None:
    model = cantilever()
    first = solve(model, backend="numpy", method="multigrid")
    # of a start that is merely close, its own residual decides how many
    answer = solve(model, tolerance=1e-9, method="direct").u
    again = solve(model, backend="numpy", method="multigrid", start=answer)
    trusted(again)
    assert again.iterations <= 1
    assert first.iterations > 5


def test_too_few_iterations_are_reported_not_hidden(device: Device) -> None:
    solution = solve(cantilever(), device, method="multigrid", max_iterations=3)
    assert not solution.converged
    assert "3 iterations" in solution.message
    assert solution.error_estimate > 1e-6


@pytest.mark.parametrize(
    ("hold", "words"),
    [
        ([], "translation x, translation y, translation z, rotation about x"),
        ([(0, 0), (0, 1), (0, 2)], r"rotation about x through \(1, 0, 0\), rotation about y"),
        ([(n, 2) for n in range(12)], "translation x, translation y, rotation about z through"),
    ],
)
def test_free_rigid_motions_are_named(hold: list[tuple[int, int]], words: str) -> None:
    mesh = box((2.0, 1.0, 1.5), (2, 1, 1))
    fixed = np.zeros(mesh.points.shape, dtype=bool)
    for node, axis in hold:
        fixed[node, axis] = True
    model = Model(mesh, [Isotropic(1.0, 0.3)], fixed=fixed, forces=np.ones(mesh.points.shape))
    with pytest.raises(InputError, match=words):
        solve(model, backend="numpy")


def test_a_second_body_and_a_hinge_are_found() -> None:
    one = box((1.0, 1.0, 1.0), (1, 1, 1))
    apart = np.concatenate([one.points, one.points + np.array([3.0, 0.0, 0.0])])
    cells = np.concatenate([one.cells["hex8"], one.cells["hex8"] + 8])
    fixed = np.zeros((16, 3), dtype=bool)
    fixed[:4] = True
    with pytest.raises(InputError, match="8 nodes around"):
        solve(
            Model(Mesh(apart, {"hex8": cells}), [Isotropic(1.0, 0.3)], fixed=fixed), backend="numpy"
        )
    # two cubes that share one edge: a hinge
    moved = one.points + np.array([1.0, 1.0, 0.0])
    points = np.concatenate([one.points, moved])
    _, index, number = np.unique(points, axis=0, return_index=True, return_inverse=True)
    joined = Mesh(points[index], {"hex8": number.ravel()[cells]})
    hinge = np.zeros(joined.points.shape, dtype=bool)
    hinge[joined.points[:, 0] == 0.0] = True
    with pytest.raises(InputError, match="2 parts touch only"):
        solve(Model(joined, [Isotropic(1.0, 0.3)], fixed=hinge), backend="numpy")


@pytest.mark.parametrize(
    "arguments",
    [
        {"tolerance": float("nan")},
        {"tolerance": 0.0},
        {"tolerance": "1e-6"},
        {"backend": "cuda"},
        {"method": "magic"},
        {"max_iterations": 0},
        {"max_iterations": 2.5},
        {"max_iterations": True},
        {"start": np.zeros(3)},
        {"start": "rest"},
        {"device": 3},
        {"formulation": "reduced"},
        {"formulation": 5},
    ],
)
def test_wrong_arguments(arguments: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=next(iter(arguments))):
        solve(cantilever(), **{"backend": "numpy", **arguments})


def test_a_preconditioner_that_returns_nan_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "gpusim.fem.krylov.multigrid_preconditioner.Multigrid.down",
        lambda self, r, cases: np.full(len(r), np.nan),
    )
    with pytest.raises(NotConverged, match="finite"):
        solve(cantilever(), backend="numpy", method="multigrid")


def test_a_load_case_at_rest_is_left_alone_while_others_go_on() -> None:
    rng = np.random.default_rng(5)
    root = rng.normal(size=(30, 30))
    matrix = root @ root.T + 3.0 * np.eye(30)

    class Scaling(Preconditioner):
        seen: ClassVar[list[int]] = []

        def apply(self, r: np.ndarray) -> np.ndarray:
            self.seen.append(len(r))
            return r / matrix.diagonal()

    b = rng.normal(size=(3, 30))
    loop, alone = (NumpyCG(lambda v: v @ matrix, Scaling()) for _ in range(2))
    loop.begin(b)
    alone.begin(b[2:])
    loop.run(3, np.array([True, True, True]))
    before, residual = loop.correction(), np.array(loop.residual())
    history = loop.run(60, np.array([False, False, True]))
    assert Scaling.seen == [3, 1, 3, 3, 3] + 60 * [1]
    assert not history[:, :2, 1:3].any() and (history[:, :2, 3] > 0.0).all()
    assert (loop.correction()[:2] == before[:2]).all()
    assert (np.array(loop.residual())[:2] == residual[:2]).all()
    # the third goes its own way, as if it were alone
    wanted = alone.run(63, np.array([True]))
    np.testing.assert_allclose(history[:5, 2], wanted[3:8, 0], rtol=1e-9)
    assert np.abs(loop.correction()[2] - np.linalg.solve(matrix, b[2])).max() <= 1e-9


def test_memory_is_asked_for_before_it_is_taken() -> None:
    small = Device(memory_limit=100_000)
    with pytest.raises(OutOfDeviceMemory, match="solve"):
        solve(cantilever(), small, method="multigrid")
    assert small.allocated == 0


def test_a_solve_gives_its_memory_back(device: Device) -> None:
    before = device.allocated
    solve(cantilever(), device)
    assert device.allocated == before


def test_a_corrupted_row_is_seen_by_the_twin(device: Device) -> None:
    model = cantilever()
    rows = assemble(model, {"hex8": "incompatible"}).rows
    u = np.random.default_rng(1).normal(size=(1, *model.mesh.points.shape))
    operator = DeviceStiffness(device, rows, 1.0, 1)
    result = operator.vector(np.zeros_like(u))
    with device.recording("test") as recording:
        operator.record(recording, operator.vector(u), result)
    twin = apply_stiffness(rows, u)
    scale = np.abs(twin).max()
    # a pair of float32 holds 48 bits
    compare("fem/device/stiffness", result.read(1) / scale, twin / scale, atol=1e-12, rtol=1e-11)
    rows.table[0, 1, 2] *= 1.0 + 1e-6
    with pytest.raises(TwinMismatch):
        compare(
            "fem/device/stiffness",
            result.read(1) / scale,
            apply_stiffness(rows, u) / scale,
            atol=1e-12,
            rtol=1e-11,
        )


def test_a_body_too_slender_for_float64_is_told_in_words() -> None:
    model = cantilever((10_000.0, 1.0, 1.0), (200, 2, 2), Isotropic(1e3, 0.3))
    with pytest.raises(NotConverged, match="slender"):
        solve(model, backend="numpy")


def test_multigrid_states_its_error_honestly_on_a_thin_plate() -> None:
    """Flat elements, badly conditioned: hundreds of iterations, and an estimate that holds."""
    plate = box((100.0, 100.0, 1.0), (10, 10, 1))
    fixed = np.isclose(plate.points[:, :1], 0.0).repeat(3, axis=1)
    end = select_faces(plate, name="x_max")
    model = Model(
        plate,
        [Isotropic(210e3, 0.3)],
        fixed=fixed,
        forces=face_force(plate, end, (0.0, 1.0, 3.0)),
    )
    # 960 to 1000 iterations by the processor's kernels: orthogonality is lost on the way
    solution = solve(model, backend="numpy", method="multigrid", max_iterations=3000)
    rows = assemble(model, resolve_formulation(model, None)).rows
    free = ~model.fixed.ravel()
    matrix = block_matrix(rows).tocsr()[free][:, free].tocsc()
    factor = splu(matrix)
    force = model.load_cases[0].ravel()[free]
    exact = factor.solve(force)
    exact += factor.solve(force - matrix @ exact)
    error = np.abs(solution.u.ravel()[free] - exact).max() / np.abs(exact).max()
    assert solution.converged
    assert error <= solution.error_estimate <= 1e-6
