"""Direct solvers: condensed sections and banded Cholesky against each other and against SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import splu

from benchmarks.solver.reference import reference_solution
from gpusim.errors import InputError
from gpusim.fem import Isotropic, Model, solve
from gpusim.fem.assembly.assembly import Assembled, assemble
from gpusim.fem.assembly.system import System
from gpusim.fem.direct_solvers import banded_cholesky
from gpusim.fem.direct_solvers.banded_cholesky import BandedFactor, band_ordering
from gpusim.fem.direct_solvers.substructuring import SubstructuredFactor, cut_slabs
from gpusim.fem.linear.solve_plan import direct_solver, least_seconds
from gpusim.fem.model.model import resolve_formulation
from gpusim.fem.sparse.block_rows import block_matrix
from gpusim.mesh import Mesh, box
from gpusim.mesh.builders.conversion import split

RNG = np.random.default_rng(3)


def beam(divisions: tuple[int, int, int] = (37, 3, 2)) -> Model:
    mesh = box((9.0, 0.7, 0.4), divisions)
    fixed = np.zeros(mesh.points.shape, dtype=bool)
    fixed[mesh.points[:, 0] == 0.0] = True
    forces = RNG.normal(size=(2, *mesh.points.shape))
    # a stiffer stretch: not all sections are alike
    centre = mesh.points[mesh.cells["hex8"]].mean(axis=1)
    of_cell = ((centre[:, 0] > 3.0) & (centre[:, 0] < 3.6)).astype(np.int32)
    return Model(
        mesh, [Isotropic(1.0, 0.3), Isotropic(50.0, 0.2)], fixed, forces, material_of_cell=of_cell
    )


def assembled(model: Model) -> Assembled:
    return assemble(model, resolve_formulation(model, None))


def exact(model: Model) -> np.ndarray:
    free = ~model.fixed.ravel()  # type: ignore[union-attr]
    matrix = block_matrix(assembled(model).rows).tocsr()[free][:, free].tocsc()
    factor = splu(matrix)
    u = np.zeros((len(model.load_cases), len(free)))
    for case, force in enumerate(model.load_cases.reshape(len(u), -1)):
        u[case, free] = factor.solve(force[free])
        u[case, free] += factor.solve(force[free] - matrix @ u[case, free])
    return u


def without_some_cells(mesh: Mesh) -> Mesh:
    """A notch: cells left out, their nodes too."""
    cells = mesh.cells["hex8"]
    centre = mesh.points[cells].mean(axis=1)
    cells = cells[~((centre[:, 0] > 5.0) & (centre[:, 0] < 5.5) & (centre[:, 1] > 0.4))]
    used = np.unique(cells)
    number = np.full(mesh.node_count, -1)
    number[used] = np.arange(len(used))
    return Mesh(mesh.points[used], {"hex8": number[cells]})


@pytest.mark.parametrize("divisions", [(37, 3, 2), (16, 2, 3), (1, 2, 2), (2, 3, 1), (3, 5, 4)])
def test_both_direct_solvers_give_scipys_answer(divisions: tuple[int, int, int]) -> None:
    model = beam(divisions)
    parts = assembled(model)
    free = ~model.fixed  # type: ignore[operator]
    force = np.where(free, model.load_cases, 0.0).reshape(2, -1)
    wanted = exact(model)
    ordering = band_ordering(parts.rows, free, model.mesh.points)
    assert parts.lattice is not None
    slabs = cut_slabs(parts.groups[0], parts.lattice, free)
    assert slabs is not None
    for solver in (
        BandedFactor(parts.rows, ordering, 1.0),
        SubstructuredFactor(slabs, parts.groups[0], parts.lattice, 1.0),
    ):
        u = solver.apply(force)
        assert np.abs(u - wanted).max() <= 1e-9 * np.abs(wanted).max()
        solver.invert()
        assert np.abs(solver.apply(force) - wanted).max() <= 1e-9 * np.abs(wanted).max()


def test_equal_sections_are_condensed_once() -> None:
    mesh = box((64.0, 1.0, 1.0), (64, 2, 2))
    fixed = np.zeros(mesh.points.shape, dtype=bool)
    fixed[mesh.points[:, 0] == 0.0] = True
    model = Model(mesh, [Isotropic(1.0, 0.3)], fixed)
    parts = assembled(model)
    slabs = cut_slabs(parts.groups[0], parts.lattice, ~fixed)  # type: ignore[arg-type]
    assert slabs is not None
    # 63 joins: in each of six rounds the clamped one differs from the others
    assert [len(one.number) for one in slabs.rounds] == [32, 16, 8, 4, 2, 1]
    assert [len(one.pairs) for one in slabs.rounds] == [2, 2, 2, 2, 2, 1]


def test_a_notched_body_and_one_of_single_supports_take_the_chain() -> None:
    mesh = without_some_cells(box((9.0, 0.7, 0.4), (36, 3, 2)))
    fixed = np.zeros(mesh.points.shape, dtype=bool)
    corner = np.flatnonzero(mesh.points[:, 0] == 0.0)
    fixed[corner[:3]] = True
    fixed[np.flatnonzero(mesh.points[:, 0] == 9.0)[0], 2] = True
    model = Model(mesh, [Isotropic(1.0, 0.3)], fixed, RNG.normal(size=mesh.points.shape))
    parts = assembled(model)
    slabs = cut_slabs(parts.groups[0], parts.lattice, ~fixed)  # type: ignore[arg-type]
    assert slabs is not None
    chain = SubstructuredFactor(slabs, parts.groups[0], parts.lattice, 1.0)  # type: ignore[arg-type]
    force = np.where(fixed, 0.0, model.load_cases).reshape(1, -1)
    wanted = exact(model)
    assert np.abs(chain.apply(force) - wanted).max() <= 1e-8 * np.abs(wanted).max()


@pytest.mark.parametrize("part", ["left", "whole"])
def test_a_wrong_join_is_seen(part: str) -> None:
    model = beam()
    parts = assembled(model)
    free = ~model.fixed  # type: ignore[operator]
    slabs = cut_slabs(parts.groups[0], parts.lattice, free)  # type: ignore[arg-type]
    assert slabs is not None and parts.lattice is not None
    chain = SubstructuredFactor(slabs, parts.groups[0], parts.lattice, 1.0)
    if part == "whole":
        chain.invert()
    wrong = getattr(chain._eliminations[3].join, part)
    wrong *= 1.0 + 1e-4
    wanted = exact(model)
    u = chain.apply(np.where(free, model.load_cases, 0.0).reshape(2, -1))
    assert np.abs(u - wanted).max() > 1e-7 * np.abs(wanted).max()


def test_slender_bodies_are_factorised_and_chunky_ones_iterate() -> None:
    long = solve(beam(), backend="numpy")
    assert long.method == "direct" and long.converged and long.backend == "numpy"
    assert "condensed" in long.message or "banded" in long.message
    mesh = box((1.0, 1.0, 1.0), (17, 17, 17))
    fixed = np.zeros(mesh.points.shape, dtype=bool)
    fixed[mesh.points[:, 0] == 0.0] = True
    cube = Model(mesh, [Isotropic(1.0, 0.3)], fixed, RNG.normal(size=mesh.points.shape))
    assert solve(cube, backend="numpy").method == "multigrid"


def frame(kind: str) -> Model:
    """Two members at a right angle, as thick as two cells, clamped at one end."""
    mesh = box((30.0, 1.0, 30.0), (60, 2, 60))
    cells = mesh.cells["hex8"]
    centre = mesh.points[cells].mean(axis=1)
    cells = cells[(centre[:, 0] < 1.0) | (centre[:, 2] > 29.0)]
    used, cells = np.unique(cells, return_inverse=True)
    mesh = Mesh(mesh.points[used], {"hex8": cells.reshape(-1, 8).astype(np.int32)})
    if kind == "tetrahedra":
        mesh = split(mesh, "tet4")
    fixed = np.zeros(mesh.points.shape, dtype=bool)
    fixed[mesh.points[:, 2] == 0.0] = True
    force = np.zeros(mesh.points.shape)
    force[mesh.points[:, 0] == 30.0, 2] = -1e-4
    return Model(mesh, [Isotropic(1.0, 0.3)], fixed, force)


@pytest.mark.parametrize("kind", ["lattice", "tetrahedra"])
def test_a_frame_is_numbered_around_its_corner(kind: str) -> None:
    model = frame(kind)
    parts = assembled(model)
    free = ~model.fixed  # type: ignore[operator]
    wide = band_ordering(parts.rows, free, model.mesh.points, hopeless=10.0).bandwidth
    assert wide > 500  # the second member lies across the first one's length
    assert band_ordering(parts.rows, free, model.mesh.points, hopeless=400.0).bandwidth < 100
    direct = direct_solver(parts, free, model.mesh.points, 1.0)
    assert least_seconds(parts, free) == 0.0 and direct is not None
    assert "banded" in direct.description
    solution = solve(model, backend="numpy")
    assert solution.method == "direct" and solution.converged
    other = solve(model, backend="numpy", method="multigrid", tolerance=1e-8)
    assert np.abs(solution.u - other.u).max() <= 1e-6 * np.abs(other.u).max()


def test_the_widest_place_is_counted_in_steps_from_an_end() -> None:
    for divisions, wanted in (((12, 1, 2), 10), ((1, 1, 1), 7)):
        parts = assembled(Model(box((1.0, 1.0, 1.0), divisions), [Isotropic(1.0, 0.3)]))
        rows = parts.rows
        graph = csr_matrix(
            (np.ones(len(rows.neighbour)), rows.neighbour, rows.start),
            shape=(rows.node_count, rows.node_count),
        )
        assert banded_cholesky._widest(graph, 0) == wanted


@pytest.mark.parametrize("bandwidth", [0, 5, 8, 100, 128, 129, 152, 700])
def test_tiles_hold_the_band_and_little_more(bandwidth: int) -> None:
    tile, deep = banded_cholesky._tiles(bandwidth)
    assert (deep - 1) * tile >= bandwidth and 8 <= tile <= 128
    assert (deep - 1) * tile <= max(bandwidth + deep - 2, 8)


def test_direct_and_multigrid_agree() -> None:
    model = beam((24, 4, 4))
    one, two = (
        solve(model, backend="numpy", method=method, tolerance=1e-8)
        for method in ("direct", "multigrid")
    )
    assert one.converged and two.converged
    assert np.abs(one.u - two.u).max() <= 2e-8 * np.abs(one.u).max()


def soft_root(contrast: float) -> Model:
    """A stiff body on a soft root turns as a whole: no residual in differences shows the rounding
    of its stiffness."""
    mesh = box((12.0, 3.0, 2.0), (12, 3, 2))
    fixed = np.repeat(mesh.points[:, :1] == 0.0, 3, axis=1)
    centre = mesh.points[mesh.cells["hex8"]].mean(axis=1)
    of_cell = (centre[:, 0] > 1.0).astype(np.int32)
    forces = np.zeros(mesh.points.shape)
    forces[mesh.points[:, 0] == 12.0, 1] = 1.0
    materials = [Isotropic(1.0, 0.3), Isotropic(contrast, 0.3)]
    return Model(mesh, materials, fixed, forces, material_of_cell=of_cell)


@pytest.mark.parametrize("contrast", [1e4, 1e8, 1e12])
def test_a_stiff_body_on_a_soft_root_is_right(contrast: float) -> None:
    model = soft_root(contrast)
    wanted = reference_solution(model, {"hex8": "incompatible"}).u[0]
    solution = solve(model, backend="numpy")
    assert solution.converged and solution.method == "direct"
    assert np.abs(solution.u - wanted).max() <= 1e-7 * np.abs(wanted).max()


def test_the_estimate_covers_the_rounding_of_the_stiffness(monkeypatch: pytest.MonkeyPatch) -> None:
    # without forces by deformation
    monkeypatch.setattr(System, "by_deformation", lambda self: self)
    solution = solve(soft_root(1e10), backend="numpy")
    assert not solution.converged
    assert "rounding of the stiffness" in solution.message
    assert "stiffnesses in the ratio" in solution.message


def test_direct_is_refused_where_its_factors_do_not_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gpusim.fem.linear.solve_plan.host_memory", lambda: 1000)
    with pytest.raises(InputError, match=r"direct.*GB.*expected"):
        solve(beam(), backend="numpy", method="direct")
    assert solve(beam(), backend="numpy").method == "multigrid"


def test_an_estimate_knows_what_is_cheap() -> None:
    parts = assembled(beam())
    direct = direct_solver(parts, ~beam().fixed, beam().mesh.points, 1.0)  # type: ignore[operator]
    assert direct is not None and direct.fits and 0.0 < direct.seconds < 1.0


@pytest.mark.parametrize("divisions", [(37, 3, 2), (6, 12, 9), (9, 9, 9), (2, 2, 2), (3, 1, 5)])
def test_what_counting_planes_says_is_less_than_the_estimate(
    divisions: tuple[int, int, int],
) -> None:
    whole = box((1.0, 0.8, 0.9), divisions)
    notched = without_some_cells(box((9.0, 0.7, 0.4), divisions))
    for mesh in (whole, notched):
        fixed = np.zeros(mesh.points.shape, dtype=bool)
        fixed[mesh.points[:, 0] == 0.0] = True
        fixed[mesh.points[:, 2] == 0.0, 2] = True
        parts = assembled(Model(mesh, [Isotropic(1.0, 0.3)], fixed, np.ones(mesh.points.shape)))
        direct = direct_solver(parts, ~fixed, mesh.points, 1.0)
        assert direct is not None and least_seconds(parts, ~fixed) <= direct.seconds
    assert max(divisions) < 3 or least_seconds(parts, ~fixed) > 0.0


def test_thick_bodies_are_factorised_only_where_multigrid_has_failed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    mesh = box((1.0, 1.0, 1.0), (24, 24, 24))
    fixed = np.zeros(mesh.points.shape, dtype=bool)
    fixed[mesh.points[:, 0] == 0.0] = True
    cube = Model(mesh, [Isotropic(1.0, 0.3)], fixed, RNG.normal(size=mesh.points.shape))
    looked = []

    def look(*_: object) -> None:
        looked.append(True)

    monkeypatch.setattr("gpusim.fem.linear.solve_plan.direct_solver", look)
    assert solve(cube, backend="numpy").method == "multigrid" and not looked
    failed = solve(cube, backend="numpy", max_iterations=1)
    assert not failed.converged and looked


@pytest.mark.parametrize(("software", "backend"), [(True, "numpy"), (False, "gpu")])
def test_auto_iterates_where_it_is_quicker(
    monkeypatch: pytest.MonkeyPatch, software: bool, backend: str
) -> None:
    monkeypatch.setattr("gpusim.fem.linear.solve_plan.software_adapter", lambda: software)
    assert solve(beam((9, 3, 2)), method="multigrid").backend == backend
