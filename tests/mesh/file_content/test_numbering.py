"""Orders of nodes of other programs: a table for every type of cell, or a refusal."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gpusim.errors import InputError
from gpusim.export.meshes import _MESHIO_NAME
from gpusim.mesh import CELL_TYPES, read_mesh
from gpusim.mesh.file_content import numbering
from gpusim.mesh.formats import exodus
from gpusim.mesh.formats.abaqus.elements import SOLID_TYPES
from gpusim.mesh.shape_functions import reference_nodes

QUADRATIC = {kind for kind, cell in CELL_TYPES.items() if cell.parents}


def test_every_type_of_cell_is_known_to_every_format() -> None:
    everything = set(CELL_TYPES)
    assert everything <= set(numbering.GMSH_KINDS.values())
    assert everything <= set(numbering.VTK_KINDS.values())
    assert everything <= set(exodus._TYPE.values()) and everything <= set(_MESHIO_NAME)
    # MED's H27 has an order of its own; Abaqus has pyramids with corners only
    assert everything - {"hex27"} <= set(numbering.MED_KINDS.values())
    assert everything - {"pyramid13"} <= set(SOLID_TYPES.values())


@pytest.mark.parametrize("kind", sorted(QUADRATIC))
def test_orders_are_permutations(kind: str) -> None:
    nodes = np.arange(CELL_TYPES[kind].nodes)[None]
    for order in (numbering.from_gmsh_order, numbering.from_upright_first):
        found = order(kind, nodes)[0]
        assert sorted(found) == [*range(CELL_TYPES[kind].nodes)]
        assert (found[: CELL_TYPES[kind].corners] == nodes[0, : CELL_TYPES[kind].corners]).all()


def test_a_quadratic_solid_without_a_table_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(numbering._GMSH_BETWEEN, "wedge15")
    monkeypatch.delitem(numbering._UPRIGHT_FIRST, "wedge15")
    nodes = np.arange(15)[None]
    for order in (numbering.from_gmsh_order, numbering.from_upright_first):
        with pytest.raises(KeyError):
            order("wedge15", nodes)
        np.testing.assert_array_equal(order("tri6", nodes[:, :6]), nodes[:, :6])


def brick(order: list[int], shift: float = 0.0) -> str:
    """A bent C3D27 whose nodes 21 to 27 come in an ``order`` of our last seven."""
    points = reference_nodes("hex27") * [2.0, 3.0, 5.0]
    points[:, 0] += 0.1 * points[:, 2] ** 2
    points[-1, 1] += shift
    lines = [
        "*NODE",
        *(f"{k + 1}, {x!r}, {y!r}, {z!r}" for k, (x, y, z) in enumerate(points.tolist())),
    ]
    row = [1, *range(1, 21), *(21 + k for k in order)]
    words = [str(number) for number in row]
    return "\n".join(
        [*lines, "*ELEMENT, TYPE=C3D27", ", ".join(words[:16]) + ",", ", ".join(words[16:])]
    )


@pytest.mark.parametrize(
    "order",
    [[0, 1, 2, 3, 4, 5, 6], [6, 4, 5, 2, 1, 3, 0], [6, 0, 1, 2, 3, 4, 5]],
    ids=["VTK", "middle, then sides S1 to S6", "middle, then sides by axes"],
)
def test_middles_of_c3d27_may_come_in_any_order(order: list[int], tmp_path: Path) -> None:
    path = tmp_path / "brick.inp"
    path.write_text(brick(order))
    np.testing.assert_array_equal(read_mesh(path).cells["hex27"][0], np.arange(27))


def test_a_c3d27_with_two_nodes_in_a_face_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "brick.inp"
    path.write_text(brick([*range(7)], shift=2.9))
    with pytest.raises(InputError, match=r"brick\.inp: bricks of 27 nodes; got 1 whose nodes"):
        read_mesh(path)
