"""Models that can't be solved as given: one clear error each, before any work."""

from __future__ import annotations

import numpy as np
import pytest

from gpusim.errors import InputError, OutOfDeviceMemory
from gpusim.fem import Isotropic, Model, solve
from gpusim.gpu import Device
from gpusim.mesh import Mesh, box, select_faces

STEEL = Isotropic(210e9, 0.3)
BLOCK = box((2.0, 1.0, 1.5), (4, 3, 2))


def held(*walls: str) -> Model:
    """The block between frictionless walls: "x" holds u_x on x = 0, and so on."""
    fixed = np.zeros(BLOCK.points.shape, dtype=bool)
    for wall in walls:
        axis = "xyz".index(wall)
        fixed[BLOCK.points[:, axis] == 0.0, axis] = True
    return Model(BLOCK, [STEEL], fixed=fixed, forces=np.ones(BLOCK.points.shape))


@pytest.mark.parametrize("method", ["auto", "direct", "multigrid"])
@pytest.mark.parametrize(
    ("walls", "free"),
    [
        ("", ["translation x", "translation y", "translation z", "rotation about x",
              "rotation about y", "rotation about z"]),
        ("x", ["translation y", "translation z", "rotation about x"]),
        ("z", ["translation x", "translation y", "rotation about z"]),
        ("xy", ["translation z"]),
    ],
)  # fmt: skip
def test_sliding_walls_leave_named_motions(method: str, walls: str, free: list[str]) -> None:
    with pytest.raises(InputError) as caught:
        solve(held(*walls), backend="numpy", method=method)
    named = str(caught.value).split("got free ")[1].split("; expected")[0]
    assert [part.split(" through")[0] for part in named.replace("), ", ")|").replace(
        "translation x, ", "translation x|").replace("translation y, ", "translation y|").replace(
        "translation z, ", "translation z|").split("|")] == free  # fmt: skip


def test_three_walls_hold() -> None:
    solution = solve(held("x", "y", "z"), backend="numpy")
    assert solution.converged and np.isfinite(solution.u).all()


def test_flat_cells_are_named() -> None:
    points = np.array(BLOCK.points)
    points[points[:, 2] == 1.5, 2] = 0.75  # the upper layer of cells has no height
    with pytest.raises(InputError, match=r"12 inverted or zero-volume cells; got cells 12, 13"):
        Mesh(points, BLOCK.cells)


def test_a_cell_upside_down_is_named() -> None:
    cells = np.array(BLOCK.cells["hex8"])
    cells[7] = cells[7][[4, 5, 6, 7, 0, 1, 2, 3]]
    with pytest.raises(InputError, match=r"1 inverted .* got cells 7 "):
        Mesh(BLOCK.points, {"hex8": cells})


def test_dangling_nodes_are_a_warning_and_under_load_an_error() -> None:
    points = np.concatenate([BLOCK.points, [[9.0, 8.0, 7.0]]])
    mesh = Mesh(points, BLOCK.cells)
    fixed = np.repeat(points[:, :1] == 0.0, 3, axis=1)
    forces = np.zeros(points.shape)
    forces[points[:, 0] == 2.0, 2] = 1.0
    solution = solve(Model(mesh, [STEEL], fixed=fixed, forces=forces), backend="numpy")
    assert solution.converged and "1 nodes belong to no cell" in solution.warnings[0]
    np.testing.assert_array_equal(solution.u[-1], 0.0)
    forces[-1, 0] = 1.0
    with pytest.raises(InputError, match=f"got node {len(points) - 1}"):
        Model(mesh, [STEEL], fixed=fixed, forces=forces)


def test_no_material_and_no_such_material() -> None:
    with pytest.raises(InputError, match="materials; got none"):
        Model(BLOCK, [])
    numbers = np.zeros(BLOCK.cell_count, dtype=np.int32)
    numbers[5] = 2
    with pytest.raises(InputError, match=r"material_of_cell: got 0 … 2; expected 0 … 0"):
        Model(BLOCK, [STEEL], material_of_cell=numbers)


def test_an_unknown_group_lists_the_known_ones() -> None:
    with pytest.raises(InputError, match=r"got 'lid'; expected one of x_max, x_min"):
        select_faces(BLOCK, name="lid")


def test_ten_gigabytes_on_a_device_of_eight_are_refused_at_once() -> None:
    device = Device(memory_limit=8 << 30)
    before = device.allocated
    with pytest.raises(OutOfDeviceMemory, match=r"10737 MB .* limit of 8590 MB"):
        device.require_memory(10 << 30, "solve")
    assert device.allocated == before
