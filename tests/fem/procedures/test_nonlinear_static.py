"""Large displacements against closed forms and integrated bars, and all that may go wrong."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest
from scipy.spatial.transform import Rotation

from gpusim.errors import InputError, NotConverged
from gpusim.fem import (
    Hencky,
    Isotropic,
    Model,
    NeoHookean,
    Solution,
    face_force,
    solve,
)
from gpusim.fem.assembly.element_responses import element_responses
from gpusim.fem.assembly.equation import Equation
from gpusim.fem.model.model import resolve_formulation
from gpusim.fem.sparse.block_rows import block_matrix
from gpusim.mesh import Mesh, box, select_faces
from tests.support.nonlinear_cases import (
    PUBLISHED_CANTILEVER,
    NonlinearCase,
    bimetal_strip,
    curved_cantilever,
    end_load,
    following_pressure,
    own_weight,
    pressed_column,
    published_cantilever,
    ring,
    roll_up,
    rolled_by_pressures,
    shallow_arch,
)

Float = npt.NDArray[np.float64]

# tolerances are what the mesh reaches; `python -m benchmarks.nonlinear` has finer ones
CASES: dict[str, tuple[Callable[[], NonlinearCase], float]] = {
    "end load": (lambda: end_load("hex8", (60, 1, 1)), 1e-3),
    "end load, tet10": (lambda: end_load("tet10", (50, 1, 1)), 1e-3),
    "end load, hex20": (lambda: end_load("hex20", (40, 1, 1)), 2e-3),
    "end load, wedge15": (lambda: end_load("wedge15", (40, 1, 1)), 2e-3),
    "Sze's cantilever": (lambda: published_cantilever("hex8", (60, 1, 1)), 1e-3),
    "Sze's cantilever, hex20": (lambda: published_cantilever("hex20", (40, 1, 1)), 1e-3),
    "own weight": (lambda: own_weight("hex8", (100, 1, 1)), 1e-3),
    "following pressure": (lambda: following_pressure("hex8", (100, 1, 1)), 1e-3),
    "ring": (lambda: ring("hex8", (80, 1, 1)), 1e-3),
    "ring, hex20": (lambda: ring("hex20", (40, 1, 1)), 2e-3),
    "one turn": (lambda: roll_up("hex8", (50, 1, 1), 1.0, 10), 5e-4),
    "one turn, by pressures": (lambda: rolled_by_pressures("hex8", (50, 1, 2), 1.0, 4), 5e-3),
    "arch, second branch": (lambda: shallow_arch("hex8", (60, 1, 1), 12.0), 1e-3),
    "3DNLG-5": (lambda: curved_cantilever("hex20", (20, 2, 2)), 1e-2),
    "bimetal strip": (lambda: bimetal_strip((100, 1, 2), (52, 137)), 5e-3),
    "column": (lambda: pressed_column((60, 1, 1), 3.0, 1e-2), 1e-3),
}


@pytest.mark.parametrize("name", CASES)
def test_case_against_its_reference(name: str) -> None:
    build, tolerance = CASES[name]
    case = build()
    solution = case.solve()
    assert np.abs(case.errors(solution)).max() <= tolerance
    # a reference that is off by twice the tolerance is seen
    size = np.abs(case.expected) if case.size is None else case.size
    wrong = replace(case, expected=case.expected + 2.0 * tolerance * size)
    assert np.abs(wrong.errors(solution)).max() > tolerance


def test_the_integrated_cantilever_is_the_published_one() -> None:
    (integrated,) = published_cantilever("hex8", (1, 1, 1)).expected
    assert integrated == pytest.approx(np.array(PUBLISHED_CANTILEVER), rel=2e-3)


def test_errors_shrink_with_the_square_of_the_cells() -> None:
    worst = []
    for cells in (10, 20, 40):
        case = end_load("hex8", (cells, 1, 1), (1.0, 4.0))
        worst.append(np.abs(case.errors(case.solve())).max())
    assert np.log2(worst[0] / worst[1]) > 1.9 and np.log2(worst[1] / worst[2]) > 1.9


def test_moment_of_a_rolled_up_strip() -> None:
    case = roll_up("hex8", (100, 1, 1), 1.0, 10)
    mesh, last = case.model.mesh, case.solve().steps[-1]
    end = mesh.points[:, 0] >= 100.0 - 1e-6
    arm = mesh.points[end] + last.u[end]
    arm -= arm.mean(axis=0)
    force = last.reactions[end]
    moment = float((arm[:, 0] * force[:, 2] - arm[:, 2] * force[:, 0]).sum())
    assert moment == pytest.approx(1e6 / 12.0 * 2.0 * np.pi / 100.0, rel=2e-3)


def beam(alpha: float = 1.0, scale: float = 1.0, E: float = 1e6, offset: float = 0.0) -> Model:
    """Slender cantilever, P L^2 / E I = ``alpha``."""
    mesh = box((100.0 * scale, scale, scale), (20, 1, 1))
    mesh = Mesh(mesh.points + offset, mesh.cells, mesh.node_sets, mesh.face_sets)
    fixed = np.zeros(mesh.points.shape, dtype=bool)
    fixed[mesh.points[:, 0] == offset] = True
    force = alpha * E * scale**2 / 12.0 / 1e4
    end = select_faces(mesh, name="x_max")
    return Model(mesh, Isotropic(E, 0.0), fixed, face_force(mesh, end, (0.0, 0.0, force)))


def large(model: Model, factors: object = None, **options: object) -> Solution:
    return solve(model, geometry="nonlinear", factors=factors, **options)  # type: ignore[arg-type]


@pytest.mark.parametrize("alpha", [1e-6, 1e-9, 1e-15])
def test_small_loads_are_linear(alpha: float) -> None:
    model = beam(alpha)
    found, linear = large(model), solve(model, tolerance=1e-10)
    assert np.abs(found.u - linear.u).max() <= max(alpha, 1e-10) * np.abs(linear.u).max()
    forces = np.abs(linear.reactions).max()
    np.testing.assert_allclose(found.reactions, linear.reactions, atol=max(alpha, 1e-9) * forces)


def test_no_load_no_motion() -> None:
    assert not large(beam(0.0)).u.any() and not large(beam(), [0.0]).u.any()


def test_up_and_down_and_back() -> None:
    steps = large(beam(4.0), [0.5, 1.0, 0.5, 0.0, -0.5, -1.0]).steps
    size = np.abs(steps[1].u).max()
    assert np.abs(steps[2].u - steps[0].u).max() <= 1e-6 * size
    assert np.abs(steps[3].u).max() <= 1e-6 * size
    # mirrored: nodes of the two sides change places
    for one, other in ((0, 4), (1, 5)):
        up, down = steps[one].u.reshape(2, -1, 3), steps[other].u.reshape(2, -1, 3)
        assert np.abs(down[::-1] - up * [1, 1, -1]).max() <= 1e-6 * size


@pytest.mark.parametrize(
    ("scale", "E", "offset"), [(1e-3, 210e9, 0.0), (1e6, 1e-9, 0.0), (1.0, 1e6, 2.0**20)]
)
def test_units_and_places_do_not_matter(scale: float, E: float, offset: float) -> None:
    wanted = large(beam()).u
    assert np.abs(large(beam(1.0, scale, E, offset)).u / scale - wanted).max() <= 1e-9 * 30.0


@pytest.mark.parametrize("method", ["direct", "multigrid"])
def test_any_rotation_of_the_problem_rotates_its_answer(method: str) -> None:
    mesh = box((6.0, 1.0, 1.0), (12, 2, 2))
    random = np.random.default_rng(3)
    points = mesh.points + 0.05 * random.uniform(-1.0, 1.0, mesh.points.shape)
    ends = (mesh.points[:, 0] == 0.0) | (mesh.points[:, 0] == 6.0)
    given = np.where((mesh.points[:, 0] == 6.0)[:, None], [-0.5, 1.0, 2.0], 0.0)
    fixed = np.repeat(ends[:, None], 3, axis=1)
    turn = Rotation.from_rotvec([0.4, -1.3, 2.0]).as_matrix()

    def solved(matrix: Float) -> Float:
        turned = Mesh(points @ matrix.T, mesh.cells)
        model = Model(turned, Isotropic(1e5, 0.3), fixed, prescribed=given @ matrix.T)
        return large(model, method=method, tolerance=1e-10).u

    wanted = solved(np.eye(3)) @ turn.T
    assert np.abs(solved(turn) - wanted).max() <= 1e-9 * np.abs(wanted).max()


@pytest.mark.parametrize("alpha", [30.0, 1000.0, 1e4])
def test_one_great_step_ends_where_many_do(alpha: float) -> None:
    model = beam(alpha)
    one, many = large(model), large(model, np.geomspace(1.0 / alpha, 1.0, 20))
    error = np.abs(one.u - many.u).max() / np.abs(many.u).max()
    assert error <= one.error_estimate + many.error_estimate <= 2e-6


def test_load_cases_add_up_on_any_way() -> None:
    base = beam(2.0)
    forces = np.stack([base.forces, 0.5 * base.forces[:, [0, 2, 1]]])
    model = Model(base.mesh, base.materials, base.fixed, forces)
    one, other = large(model, [[1, 0], [1, 1]]), large(model, [[0, 1], [1, 1]])
    assert np.abs(one.u - other.u).max() <= 1e-6 * np.abs(one.u).max()
    assert np.abs(one.steps[0].u - other.steps[0].u).max() > 1.0


def test_stretched_rubber_follows_its_law() -> None:
    law, mesh = NeoHookean(1.0, 0.45), box((2.0, 1.0, 1.0), (2, 2, 2))
    low = mesh.points == 0.0
    fixed = low.copy()
    fixed[:, 0] |= mesh.points[:, 0] == 2.0
    given = np.where((mesh.points[:, :1] == 2.0) & (np.arange(3) == 0), 1.0, 0.0)
    for share in (1.0, -0.5):
        found = large(Model(mesh, law, fixed, prescribed=given), [share], tolerance=1e-10)
        along = 1.0 + 0.5 * share
        across = 1.0 + found.u[mesh.points[:, 1] == 1.0, 1]
        assert np.ptp(across) <= 1e-9
        # free sides: no stress across
        green = 0.5 * (np.array([along**2, across[0] ** 2, across[0] ** 2, 1, 1, 1]) - 1.0)
        stress = law.update(green[None], None, moduli=False).stress[0]
        assert np.abs(stress[1:]).max() <= 1e-8 * abs(stress[0])
        pull = found.reactions[mesh.points[:, 0] == 2.0, 0].sum()
        assert pull == pytest.approx(stress[0] * along, rel=1e-8)


@pytest.mark.parametrize(
    "law", [Isotropic(1.0, 0.0), NeoHookean(1.0, 0.0), Hencky(1.0, 0.0)],
    ids=["isotropic", "neo_hooke", "hencky"],
)  # fmt: skip
@pytest.mark.parametrize("aspect", [1.0, 20.0, 100.0])
def test_flat_cells_have_no_mode_that_buckles_before_the_body(
    law: Isotropic | NeoHookean | Hencky, aspect: float
) -> None:
    """Pressed through its thickness by 30 %, between smooth walls (Sussman & Bathe, Comput. Struct.
    140 (2014) 14); a body as thick as long buckles at some 40 %."""
    mesh = box((4.0 * aspect, 1.0, 4.0), (4, 1, 4))
    sides = np.isclose(mesh.points, 0.0) | np.isclose(mesh.points, mesh.points.max(axis=0))
    sides[:, 0] = mesh.points[:, 0] == 0.0
    model = Model(mesh, law, sides)
    equation = Equation(model, element_responses(model, resolve_formulation(model, None)))
    tangent = equation.linearised(mesh.points * [0.0, 0.0, -0.3], np.zeros(1))
    free = equation.free.ravel()
    matrix = block_matrix(tangent.assembled.rows).toarray()[np.ix_(free, free)]
    assert np.linalg.eigvalsh(matrix)[0] > 1e-5


def test_steps_before_one_without_equilibrium_are_kept() -> None:
    mesh = box((1.0, 1.0, 1.0), (2, 2, 2))
    ends = (mesh.points[:, :1] == 0.0) | (mesh.points[:, :1] == 1.0)
    given = np.where(mesh.points[:, :1] == 1.0, [-1.0, 0.0, 0.0], 0.0)
    model = Model(mesh, Isotropic(1.0, 0.3), np.repeat(ends, 3, axis=1), prescribed=given)
    found = large(model, [0.1, 2.0, 3.0])
    assert not found.converged and len(found.steps) == 1 and found.steps[0].factors == 0.1
    np.testing.assert_array_equal(found.u, found.steps[0].u)
    assert found.message.startswith("load step 2 of 3, at 0.")
    with pytest.raises(NotConverged, match=r"load step 1 of 1, at 0\.\d+ of it: .*inside out"):
        large(model, [2.0])


@pytest.mark.parametrize(
    "factors", [[], [np.nan], [np.inf], [[1.0, 2.0]], "all", [[]], [1.0 + 1.0j]]
)
def test_factors_that_are_none_are_refused(factors: object) -> None:
    with pytest.raises(InputError, match="solve: factors"):
        large(beam(), factors)


def test_factors_of_load_cases_are_asked_for() -> None:
    base = beam()
    model = Model(base.mesh, base.materials, base.fixed, np.stack([base.forces] * 2))
    for factors in (None, [1.0], [[1.0, np.nan]], [[1.0], [2.0]]):
        with pytest.raises(InputError, match=r"solve: factors.*\(K, 2\).*how load cases add up"):
            large(model, factors)
