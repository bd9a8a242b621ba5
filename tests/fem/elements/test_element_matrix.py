"""Element matrices, assembled rows and loads, judged by exact answers."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from gpusim.arrays.unique import congruence_classes
from gpusim.errors import InputError
from gpusim.fem import Isotropic, Model, body_force, face_force, nodal_force, pressure, traction
from gpusim.fem.assembly.assembly import assemble
from gpusim.fem.elements.element_matrix import element_stiffness
from gpusim.fem.model.model import resolve_formulation
from gpusim.fem.model.supports import rigid_modes
from gpusim.fem.sparse.stiffness_product import apply_stiffness
from gpusim.mesh import Mesh, box, select_faces

Float = npt.NDArray[np.float64]
STEEL = Isotropic(210e3, 0.3, 7.85e-9)


def distorted(amount: float = 0.04) -> Mesh:
    """A brick whose inner nodes are moved at random; its surface stays flat."""
    mesh = box((1.0, 0.8, 1.3), (3, 4, 2))
    points = mesh.points.copy()
    inner = ((points > 1e-9) & (points < np.array([1.0, 0.8, 1.3]) - 1e-9)).all(axis=1)
    points[inner] += amount * np.random.default_rng(3).uniform(-1, 1, (int(inner.sum()), 3))
    return Mesh(points, mesh.cells)


def as_tets(mesh: Mesh) -> Mesh:
    """Each hex cut into six tets around its diagonal."""
    around = [1, 2, 3, 7, 4, 5]
    pattern = np.array([[0, around[k], around[(k + 1) % 6], 6] for k in range(6)])
    return Mesh(mesh.points, {"tet4": mesh.cells["hex8"][:, pattern].reshape(-1, 4)})


CASES = [
    (distorted(), {"hex8": "incompatible"}),
    (distorted(), {"hex8": "full"}),
    (distorted(), {"hex8": "bbar"}),
    (as_tets(distorted()), {"tet4": "full"}),
]


def rows_of(mesh: Mesh, formulation: dict[str, str]) -> object:
    free = np.zeros(mesh.points.shape, dtype=bool)
    return assemble(Model(mesh, [STEEL], fixed=free), formulation).rows


@pytest.mark.parametrize(("mesh", "formulation"), CASES)
def test_rigid_motion_takes_no_force(mesh: Mesh, formulation: dict[str, str]) -> None:
    rows = rows_of(mesh, formulation)
    modes = rigid_modes(mesh.points, np.array([5.0, -3.0, 1.0]), 1.0).transpose(2, 0, 1)
    force = apply_stiffness(rows, modes.copy())  # type: ignore[arg-type]
    assert np.abs(force).max() <= 1e-13 * 210e3 * np.abs(modes).max()


@pytest.mark.parametrize(("mesh", "formulation"), CASES)
def test_constant_strain_leaves_inner_nodes_in_balance(
    mesh: Mesh, formulation: dict[str, str]
) -> None:
    gradient = np.array([[1.0, 0.3, -0.2], [0.5, -0.7, 0.1], [0.4, 0.2, 0.6]])
    u = (mesh.points @ gradient.T)[None]
    force = apply_stiffness(rows_of(mesh, formulation), u)[0]  # type: ignore[arg-type]
    low, high = mesh.bounds
    inner = ((mesh.points > low + 1e-9) & (mesh.points < high - 1e-9)).all(axis=1)
    assert inner.sum() >= 6
    assert np.abs(force[inner]).max() <= 1e-12 * np.abs(force).max()
    # on the face x = 1 the forces add up to the stress times the area
    strain = 0.5 * (gradient + gradient.T)
    stress = STEEL.stiffness()[0] @ [
        strain[0, 0], strain[1, 1], strain[2, 2], 0.0, 0.0, 0.0,
    ]  # fmt: skip
    moment = np.einsum("n,n->", mesh.points[:, 0], force[:, 0])
    assert moment == pytest.approx(stress * 0.8 * 1.3, rel=1e-11)


def test_stiffness_is_positive_with_six_rigid_modes() -> None:
    mesh = distorted(0.06)
    nodes = mesh.points[mesh.cells["hex8"][:2]]
    for formulation in ("incompatible", "full", "bbar"):
        values = np.linalg.eigvalsh(
            element_stiffness("hex8", nodes, STEEL.stiffness(), formulation)
        )
        assert (np.abs(values[:, :6]) <= 1e-10 * values[:, -1:]).all()
        assert (values[:, 6:] >= 1e-4 * values[:, -1:]).all()


def test_mean_dilatation_sees_only_the_mean_volume_change() -> None:
    # u_x = x y has zero mean dilatation on a centred brick: only shear energy may be left
    mesh = box((1.0, 0.7, 0.4), (1, 1, 1), origin=(-0.5, -0.35, -0.2))
    cell = mesh.cells["hex8"]
    u = np.zeros((8, 3))
    u[:, 0] = mesh.points[:, 0] * mesh.points[:, 1]
    energies = {}
    for nu in (0.3, 0.49999):
        moduli = Isotropic(2.0 * (1.0 + nu), nu).stiffness()  # shear modulus 1
        for rule in ("bbar", "full"):
            matrix = element_stiffness("hex8", mesh.points[cell], moduli, rule)[0]
            order = u[cell[0]].ravel()
            energies[rule, nu] = float(order @ matrix @ order)
    assert energies["bbar", 0.49999] == pytest.approx(energies["bbar", 0.3], rel=1e-9)
    assert energies["full", 0.49999] > 100 * energies["full", 0.3]


def test_equal_elements_share_a_class_and_others_do_not() -> None:
    mesh = box((1.0, 0.7, 0.4), (40, 7, 3), origin=(100.0, 0.1, -3.0))
    nodes = mesh.points[mesh.cells["hex8"]]
    material = np.zeros(len(nodes), dtype=np.int32)
    representative, label = congruence_classes(nodes, material)
    assert len(representative) <= 40
    exact = element_stiffness("hex8", nodes, STEEL.stiffness())
    shared = exact[representative][label]
    assert np.abs(shared - exact).max() <= 1e-10 * np.abs(exact).max()
    material[5] = 1
    assert (
        congruence_classes(nodes, material)[1][5] not in congruence_classes(nodes, material)[1][:5]
    )


def test_structured_rows_are_shared_and_distorted_ones_are_not() -> None:
    regular = rows_of(box((1.0, 0.5, 0.25), (8, 8, 8)), {"hex8": "full"})
    assert regular.class_count == 27  # type: ignore[attr-defined]
    assert rows_of(distorted(), {"hex8": "full"}).class_count > 40  # type: ignore[attr-defined]


def test_formulations_are_resolved_per_type() -> None:
    mesh = distorted()
    model = Model(mesh, [STEEL], fixed=np.zeros(mesh.points.shape, dtype=bool))
    assert resolve_formulation(model, None) == {"hex8": "incompatible"}
    assert resolve_formulation(model, "bbar") == {"hex8": "bbar"}
    with pytest.raises(InputError, match="reduced"):
        resolve_formulation(model, {"hex8": "reduced"})
    with pytest.raises(InputError, match="hex9"):
        resolve_formulation(model, {"hex9": "full"})
    # also where the mesh has no cell that it could be about
    with pytest.raises(InputError, match="incompatible"):
        resolve_formulation(model, {"tet4": "incompatible"})
    tets = as_tets(mesh)
    held = np.zeros(tets.points.shape, dtype=bool)
    for name in ("hourglass", "reduced"):  # unknown; known, but not for tet4
        with pytest.raises(InputError, match=name):
            resolve_formulation(Model(tets, [STEEL], fixed=held), name)


def test_node_numbers_of_a_force_are_not_rounded() -> None:
    with pytest.raises(InputError, match="integer"):
        nodal_force(distorted(), np.array([0.0, 1.5]), (0.0, 0.0, 1.0))


def test_loads_have_the_right_sums_and_moments() -> None:
    for mesh in (distorted(), as_tets(distorted())):
        top = select_faces(mesh, normal="+z", bounds={"z_min": 1.3})
        force = face_force(mesh, top, (2.0, -3.0, 5.0))
        np.testing.assert_allclose(force.sum(axis=0), (2.0, -3.0, 5.0), rtol=1e-13)
        centre = np.einsum("ni,n->i", mesh.points, force[:, 2]) / 5.0
        np.testing.assert_allclose(centre, (0.5, 0.4, 1.3), rtol=1e-12)
        np.testing.assert_allclose(
            traction(mesh, top, (0.0, 4.0, 0.0)).sum(axis=0), (0.0, 4.0 * 0.8, 0.0), rtol=1e-13
        )
        np.testing.assert_allclose(
            pressure(mesh, top, 7.0).sum(axis=0), (0.0, 0.0, -7.0 * 0.8), atol=1e-13
        )
        weight = body_force(mesh, 2.0, (0.0, 0.0, -9.81))
        np.testing.assert_allclose(
            weight.sum(axis=0), (0.0, 0.0, -9.81 * 2.0 * 0.8 * 1.3), atol=1e-12
        )
    point = nodal_force(mesh, [3, 3, 8], (1.0, 0.0, -2.0))
    np.testing.assert_array_equal(point[[3, 8]], [[0.5, 0.0, -1.0], [0.5, 0.0, -1.0]])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"E": -1.0, "nu": 0.3}, "E out of range"),
        ({"E": 0.0, "nu": 0.3}, "E out of range"),
        ({"E": float("nan"), "nu": 0.3}, "E out of range"),
        ({"E": 1.0, "nu": 0.5}, "nu out of range"),
        ({"E": 1.0, "nu": 0.3, "density": -1.0}, "density"),
        ({"E": "steel", "nu": 0.3}, "steel|nan"),
    ],
)
def test_bad_materials(arguments: dict[str, float], words: str) -> None:
    with pytest.raises(InputError, match=words):
        Isotropic(**arguments)


def test_bad_models() -> None:
    mesh = box((1.0, 2.0, 3.0), (1, 2, 3))
    shape = mesh.points.shape
    fixed = np.zeros(shape, dtype=bool)
    nan = np.zeros(shape)
    nan[2, 1] = np.nan
    for words, arguments in {
        "isotropic|Isotropic": {"materials": [], "fixed": fixed},
        "got int; expected Isotropic": {"materials": 5, "fixed": fixed},
        "fixed": {"materials": [STEEL], "fixed": fixed[:-1]},
        "have a displacement but": {"materials": [STEEL], "prescribed": np.ones(shape)},
        "complex": {"materials": [STEEL], "fixed": fixed, "forces": np.ones(shape) * 1j},
        r"\(2, 1\)": {"materials": [STEEL], "fixed": fixed, "forces": nan},
        "aren't fixed": {"materials": [STEEL], "fixed": fixed, "prescribed": np.ones(shape)},
        "material_of_cell": {
            "materials": [STEEL], "fixed": fixed, "material_of_cell": np.ones(6, dtype=int),
        },
        "forces: wrong shape": {"materials": [STEEL], "fixed": fixed, "forces": np.ones(3)},
    }.items():  # fmt: skip
        with pytest.raises(InputError, match=words):
            Model(mesh, **arguments)  # type: ignore[arg-type]
