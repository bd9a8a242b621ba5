"""Ties and equations as objects of a model."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import csc_matrix, csr_matrix

from gpusim.errors import InputError
from gpusim.fem import Equations, Isotropic, Model, equations, tie
from gpusim.mesh import Mesh, box, select_nodes
from tests.support.tied_blocks import Divisions, blocks, joined, joint

MATERIAL = Isotropic(200.0, 0.25)


@pytest.mark.parametrize("kind", ["hex8", "hex20", "tet4", "tet10"])
def test_linear_fields_obey_a_tie(kind: str) -> None:
    mesh = blocks((2, 3, 1), (3, 5, 1), kind=kind)
    gradient = np.array([[1.0, 2.0, 3.0], [-2.0, 0.5, 1.0], [0.3, -1.0, 2.0]])
    u = mesh.points @ gradient + [4.0, 5.0, 6.0]
    made = joined(mesh)
    assert np.abs(made.matrix @ u.ravel()).max() <= 1e-13
    assert not made.right.any()
    # and others don't: a tie that held nothing would pass as well
    assert np.abs(made.matrix @ (mesh.points[:, [2, 0, 1]] ** 3).ravel()).max() > 0.01


@pytest.mark.parametrize(("kind", "exact"), [("hex20", True), ("tet10", True), ("hex8", False)])
def test_quadratic_faces_carry_quadratic_fields(kind: str, exact: bool) -> None:
    mesh = blocks((2, 3, 1), (3, 5, 1), kind=kind)
    x, y, _ = mesh.points.T
    u = np.stack([x * x - 2 * x * y, y * y, x * y], axis=1)
    assert (np.abs(joined(mesh).matrix @ u.ravel()).max() <= 1e-12) == exact


def test_nodes_follow_the_face_that_holds_them() -> None:
    """Node 11 of the deck's example: shares of bilinear interpolation on one large face."""
    mesh = blocks((1, 1, 1), (4, 3, 1))
    faces, above = joint(mesh)
    node = int(np.flatnonzero(np.isclose(mesh.points, [0.5, 1.0, 1.0]).all(axis=1))[0])
    row = tie(mesh, faces, [node]).matrix[0].toarray().ravel()
    x, y = 0.25, 1.0 / 3.0
    at = {(0, 0): (1 - x) * (1 - y), (2, 0): x * (1 - y), (0, 3): (1 - x) * y, (2, 3): x * y}
    wanted = np.zeros(len(row))
    wanted[3 * node] = 1.0
    for (right, back), share in at.items():
        corner = np.isclose(mesh.points, [right, back, 1.0]).all(axis=1) & (
            np.arange(mesh.node_count) < 8
        )
        wanted[3 * int(np.flatnonzero(corner)[0])] = -share
    np.testing.assert_allclose(row, wanted, atol=1e-14)
    assert len(tie(mesh, faces, above).right) == 3 * 20


def test_nodes_of_the_faces_move_along_anyway() -> None:
    mesh = blocks((2, 2, 1), (3, 3, 1))
    faces, above = joint(mesh)
    both = np.concatenate([faces.node_numbers(), above.node_numbers()])
    assert (tie(mesh, faces, both).matrix != tie(mesh, faces, above).matrix).nnz == 0
    with pytest.raises(InputError, match="tie: nodes; got none beside those of the faces"):
        tie(mesh, faces, faces)


def test_a_large_face_beside_many_small_ones_is_found() -> None:
    """The nearest centres may all be those of small faces."""
    fine = box((0.1, 1.0, 1.0), (8, 40, 1))
    coarse = box((1.0, 1.0, 1.0), (1, 1, 1), origin=(0.1, 0.0, 0.0))
    cells = np.concatenate([fine.cells["hex8"], coarse.cells["hex8"] + fine.node_count])
    top = box((1.1, 1.0, 1.0), (11, 3, 1), origin=(0.0, 0.0, 1.0))
    count = fine.node_count + coarse.node_count
    mesh = Mesh(
        np.concatenate([fine.points, coarse.points, top.points]),
        {"hex8": np.concatenate([cells, top.cells["hex8"] + count])},
    )
    made = joined(mesh)
    assert len(made.right) == 3 * 48
    u = mesh.points @ np.array([[1.0, 2.0, 3.0], [-2.0, 0.5, 1.0], [0.3, -1.0, 2.0]])
    assert np.abs(made.matrix @ u.ravel()).max() <= 1e-13


def test_a_gap_needs_a_tolerance() -> None:
    mesh = blocks((2, 3, 1), (3, 5, 1), gap=0.05)
    faces, above = joint(mesh, gap=0.05)
    with pytest.raises(InputError, match=r"24 of 24 nodes lie off .* at a distance of 0\.05"):
        tie(mesh, faces, above)
    made = tie(mesh, faces, above, tolerance=0.06)
    assert np.abs(made.matrix @ np.ones(mesh.points.size)).max() <= 1e-14
    with pytest.raises(InputError, match=r"distance of inf \(inf: beside them\)"):
        tie(mesh, faces[[0]], above, tolerance=0.06)


def test_wrong_arguments() -> None:
    mesh = blocks((1, 1, 1), (2, 2, 1))
    faces, _ = joint(mesh)
    with pytest.raises(InputError, match="tie: no faces"):
        tie(mesh, faces[np.zeros(0, dtype=int)], [9])
    for nodes in ([mesh.node_count], [-1]):
        with pytest.raises(InputError, match=f"at least one in 0 … {mesh.node_count - 1}"):
            tie(mesh, faces, nodes)
    with pytest.raises(InputError, match="integer node numbers"):
        tie(mesh, faces, [0.5])
    rows = [([(0, "x", 1.0)], 0.0)]
    with pytest.raises(InputError, match="row 1: node; got 26; expected 0 … 25"):
        equations(mesh, [*rows, ([(26, "x", 1.0)], 0.0)])
    with pytest.raises(InputError, match=r"row 0: node; got 1\.5; expected 0 … 25"):
        equations(mesh, [([(1.5, "x", 1.0)], 0.0)])  # type: ignore[list-item]
    with pytest.raises(InputError, match="row 0: axis; got 'w'"):
        equations(mesh, [([(0, "w", 1.0)], 0.0)])
    with pytest.raises(InputError, match="finite numbers"):
        equations(mesh, [([(0, "x", float("nan"))], 0.0)])
    with pytest.raises(InputError, match="no terms"):
        equations(mesh, [([], 0.0)])


def test_a_model_takes_constraints_of_its_own_size_alone() -> None:
    mesh = blocks((1, 1, 1), (2, 2, 1))
    made = joined(mesh)
    assert Model(mesh, MATERIAL, constraints=made).constraints == (made,)
    with pytest.raises(InputError, match=r"constraints\[1\]; got str"):
        Model(mesh, MATERIAL, constraints=[made, "tie"])  # type: ignore[list-item]
    other = joined(blocks((1, 1, 1), (2, 3, 1)))
    with pytest.raises(InputError, match=r"constraints\[0\]: wrong shape"):
        Model(mesh, MATERIAL, constraints=[other])
    broken = Equations(csr_matrix(made.matrix * np.nan), made.right)
    with pytest.raises(InputError, match="finite"):
        Model(mesh, MATERIAL, constraints=[broken])


def test_forces_on_a_node_of_no_cell_need_an_equation() -> None:
    whole = box((2.0, 1.0, 1.0), (2, 1, 1))
    mesh = Mesh(np.concatenate([whole.points, [[3.0, 0.0, 0.0]]]), dict(whole.cells))
    forces = np.zeros(mesh.points.shape)
    forces[-1, 0] = 1.0
    end = select_nodes(mesh, bounds={"x_min": 2.0})
    mean = ([(12, "x", -4.0), *((int(n), "x", 1.0) for n in end)], 0.0)
    with pytest.raises(InputError, match="loaded nodes belong to no cell"):
        Model(mesh, MATERIAL, forces=forces)
    assert Model(mesh, MATERIAL, forces=forces, constraints=equations(mesh, [mean])).constraints
    with pytest.raises(InputError, match="loaded nodes belong to no cell"):
        Model(mesh, MATERIAL, forces=forces[:, [1, 0, 2]], constraints=equations(mesh, [mean]))


def test_matrices_of_any_format() -> None:
    dense = np.arange(1.0, 13.0).reshape(2, 6)
    for matrix in (dense, csc_matrix(dense)):
        made = Equations(matrix, np.array([1, 2]))
        np.testing.assert_array_equal(made.matrix.toarray(), dense)
        np.testing.assert_array_equal(
            made.renumbered(np.array([1, 0])).matrix.toarray()[:, 0], [4, 10]
        )


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_renumbered(order: tuple[int, int]) -> None:
    made = Equations(csr_matrix(np.arange(6.0)[None]), np.array([7.0]))
    found = made.renumbered(np.array(order))
    wanted = np.arange(6.0).reshape(2, 3)[list(order)].ravel()
    np.testing.assert_array_equal(found.matrix.toarray()[0], wanted)


def test_divisions_are_what_they_say() -> None:
    divisions: Divisions = (2, 3, 1)
    assert blocks(divisions, (4, 6, 2)).cell_count == 6 + 48
