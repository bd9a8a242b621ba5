"""Which motions supports and constraints leave free."""

from __future__ import annotations

import numpy as np
import pytest

from gpusim.errors import InputError
from gpusim.fem import Equations, Isotropic, Model, equations
from gpusim.fem.model.supports import check_supports
from gpusim.mesh import Mesh, box, select_nodes
from tests.support.tied_blocks import blocks, joined

MATERIAL = Isotropic(200.0, 0.25)


def held(mesh: Mesh, *axes: str) -> np.ndarray:
    """Fixed below, along ``axes``."""
    fixed = np.zeros(mesh.points.shape, dtype=bool)
    for axis in axes:
        fixed[np.isclose(mesh.points[:, 2], 0.0), "xyz".index(axis)] = True
    return fixed


def test_tied_blocks_hold_each_other() -> None:
    mesh = blocks((2, 3, 1), (3, 5, 1))
    with pytest.raises(InputError, match="free translation x"):
        check_supports(Model(mesh, MATERIAL, held(mesh, "x", "y", "z")))
    check_supports(Model(mesh, MATERIAL, held(mesh, "x", "y", "z"), constraints=[joined(mesh)]))


@pytest.mark.parametrize(
    ("axes", "free"),
    [
        ("xz", "got free translation y;"),
        ("z", "got free translation x, translation y, rotation about z through"),
        ("", "got free translation x, translation y, translation z, rotation about x"),
    ],
)
def test_free_motions_of_tied_blocks_are_named(axes: str, free: str) -> None:
    mesh = blocks((2, 3, 1), (3, 5, 1))
    model = Model(mesh, MATERIAL, held(mesh, *axes), constraints=[joined(mesh)])
    with pytest.raises(InputError, match="its 2 parts are joined by constraints") as caught:
        check_supports(model)
    assert free in str(caught.value)


def test_a_hinge_of_equations_leaves_one_motion() -> None:
    """The upper block's edge at x = 0 tied to the lower one's: it can turn about that edge."""
    mesh = blocks((2, 3, 1), (2, 3, 1))
    edge = {"x_max": 0.0, "z_min": 1.0, "z_max": 1.0}
    nodes = select_nodes(mesh, bounds=edge)
    lower, upper = np.sort(nodes)[:4], np.sort(nodes)[4:]
    rows = [
        ([(a, axis, 1.0), (b, axis, -1.0)], 0.0)
        for a, b in zip(lower, upper, strict=True)
        for axis in "xyz"
    ]
    model = Model(mesh, MATERIAL, held(mesh, *"xyz"), constraints=[equations(mesh, rows)])
    with pytest.raises(InputError, match="got free 1 motions"):
        check_supports(model)
    # one more equation stops it, however it is scaled
    stop = ([(lower[0] + 2, "z", 1e6), (upper[0] + 2, "z", -1e6)], 0.0)
    check_supports(
        Model(mesh, MATERIAL, held(mesh, *"xyz"), constraints=[equations(mesh, [*rows, stop])])
    )


def test_a_body_by_itself_is_still_looked_at_alone() -> None:
    """Beside two tied ones a third is free; it is named, not they."""
    pair = blocks((2, 2, 1), (3, 3, 1))
    third = box((1.0, 1.0, 1.0), (1, 1, 1), origin=(9.0, 0.0, 0.0))
    cells = np.concatenate([pair.cells["hex8"], third.cells["hex8"] + pair.node_count])
    mesh = Mesh(np.concatenate([pair.points, third.points]), {"hex8": cells})
    fixed = held(mesh, *"xyz")
    fixed[pair.node_count :] = False
    with pytest.raises(InputError, match=r"8 nodes around \(9.5, 0.5, 0.5\) can move freely"):
        check_supports(Model(mesh, MATERIAL, fixed, constraints=[joined(mesh)]))


def test_a_node_of_no_cell_holds_nothing_unless_it_is_held() -> None:
    whole = box((2.0, 1.0, 1.0), (2, 1, 1))
    mesh = Mesh(np.concatenate([whole.points, [[3.0, 0.5, 0.5]]]), dict(whole.cells))
    last, end = whole.node_count, select_nodes(mesh, bounds={"x_min": 2.0})
    rows = [([3 * int(node) + k, 3 * last + k], [1.0, -1.0], 0.0) for node in end for k in range(3)]
    follow = Equations.build(rows, mesh.points.size)
    fixed = np.zeros(mesh.points.shape, dtype=bool)
    with pytest.raises(InputError, match="free translation x, translation y, translation z; exp"):
        check_supports(Model(mesh, MATERIAL, fixed, constraints=[follow]))
    fixed[last] = True
    check_supports(Model(mesh, MATERIAL, fixed, constraints=[follow]))


def test_nodes_of_no_cell_that_only_follow_each_other_are_free() -> None:
    whole = box((2.0, 1.0, 1.0), (2, 1, 1))
    mesh = Mesh(np.concatenate([whole.points, [[3.0, 0, 0], [4.0, 0, 0]]]), dict(whole.cells))
    last = whole.node_count
    pair = Equations.build([([3 * last, 3 * last + 3], [1.0, -2.0], 0.0)], mesh.points.size)
    fixed = np.isclose(mesh.points[:, :1], 0.0).repeat(3, axis=1)
    with pytest.raises(InputError, match="can move freely"):
        check_supports(Model(mesh, MATERIAL, fixed, constraints=[pair]))
