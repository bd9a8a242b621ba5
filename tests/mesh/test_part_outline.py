"""The outline of a part beside what is known of it in closed form."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gpusim import mesh
from gpusim.cli.scene_templates import coarse_mesh
from gpusim.export import write_stl, write_vtu
from gpusim.mesh.part_outline import PartOutline, part_outline
from tests.support.gmsh_meshes import Gmsh


def outline_of(folder: Path, build: Callable[[Any], object]) -> PartOutline:
    path = folder / "part.step"
    with Gmsh() as gmsh:
        build(gmsh.model.occ)
        gmsh.model.occ.synchronize()
        gmsh.write(str(path))
    return part_outline(coarse_mesh(path))


def test_a_plate_with_a_hole(tmp_path: Path) -> None:
    def build(occ: Any) -> None:
        body, hole = occ.addBox(-50, -20, 0, 100, 40, 3), occ.addCylinder(20, 5, -1, 0, 0, 5, 6)
        occ.cut([(3, body)], [(3, hole)])

    part = outline_of(tmp_path, build)
    np.testing.assert_allclose([part.low, part.high], [[-0.05, -0.02, 0], [0.05, 0.02, 0.003]],
                               atol=1e-9)  # fmt: skip
    front = 4e-3 - np.pi * 6e-3**2
    assert part.volume == pytest.approx(3e-3 * front, rel=2e-3)
    assert part.skin == pytest.approx(2 * front + 3e-3 * (0.28 + np.pi * 12e-3), rel=2e-3)
    assert part.axis == 0
    (hole,) = [face for face in part.faces if face.normal is None]
    assert hole.kind == "hollow, radius 6 mm about z"
    np.testing.assert_allclose(hole.centre, [0.02, 0.005, 0.0015], atol=2e-5)
    assert hole.area == pytest.approx(np.pi * 12e-3 * 3e-3, rel=1e-2)
    assert [face.area for face in part.faces] == sorted((f.area for f in part.faces), reverse=True)
    for sign in (-1, 1):
        end = part.end(sign)
        assert end is not None and end.area == pytest.approx(120e-6)
        np.testing.assert_allclose(end.centre, [sign * 0.05, 0.0, 0.0015], atol=1e-9)
        assert end.kind == f"plane that looks {'+' if sign > 0 else '-'}x"
    seen = part.broadside()
    assert seen in part.faces and seen.normal is not None
    # both sides are as large: from the other one, the picture would be mirrored
    np.testing.assert_allclose(seen.normal, [0, 0, 1], atol=1e-9)
    assert 0.3 * 3e-3 < part.element_size < 0.8 * 3e-3


def test_a_bar_is_seen_from_the_side(tmp_path: Path) -> None:
    part = outline_of(tmp_path, lambda occ: occ.addCylinder(0, 0, 0, 120, 0, 0, 10))
    kinds = sorted(face.kind for face in part.faces)
    assert kinds == ["plane that looks +x", "plane that looks -x", "round, radius 10 mm about x"]
    assert part.broadside() in part.sides and part.broadside().name[1] in "yz"
    ends = part.end(-1), part.end(1)
    assert all(end is not None and end.area == pytest.approx(np.pi * 1e-4, rel=0.02)
               for end in ends)  # fmt: skip


def test_a_whole_plane_is_shown_rather_than_all_that_looks_there(tmp_path: Path) -> None:
    """Of a bracket: the wall's hole and its top look up, too."""

    def build(occ: Any) -> None:
        plate, wall = occ.addBox(0, 0, 0, 80, 40, 6), occ.addBox(0, 0, 0, 6, 40, 60)
        joined, _ = occ.fuse([(3, plate)], [(3, wall)])
        occ.cut(joined, [(3, occ.addCylinder(-1, 20, 40, 10, 0, 0, 4))])

    part = outline_of(tmp_path, build)
    up = next(side for side in part.sides if side.name == "+z")
    seen = part.broadside()
    assert seen in part.faces and seen.kind == "plane that looks -z"
    assert seen.area == pytest.approx(3.2e-3) and up.area > 1.005 * seen.area


def test_bosses_and_troughs_are_told_apart(tmp_path: Path) -> None:
    def build(occ: Any) -> None:
        body, boss = occ.addBox(0, 0, 0, 90, 30, 20), occ.addCylinder(20, 15, 20, 0, 0, 9, 5)
        joined, _ = occ.fuse([(3, body)], [(3, boss)])
        occ.cut(joined, [(3, occ.addCylinder(70, 0, 20, 0, 30, 0, 4))])

    kinds = [face.kind for face in outline_of(tmp_path, build).faces]
    assert "round, radius 5 mm about z" in kinds
    assert "hollow, radius 4 mm about y" in kinds


def test_a_ball_has_no_planes(tmp_path: Path) -> None:
    part = outline_of(tmp_path, lambda occ: occ.addSphere(1, 2, 3, 15))
    assert [face.kind for face in part.faces] == ["curved"]
    assert part.end(-1) is None and part.end(1) is None
    assert part.broadside() in part.sides


def test_an_oblique_plate(tmp_path: Path) -> None:
    def build(occ: Any) -> None:
        body = occ.addBox(-50, -20, 0, 100, 40, 3)
        occ.rotate([(3, body)], 0, 0, 0, 0, 1, 0, np.deg2rad(20))

    part = outline_of(tmp_path, build)
    seen = part.broadside()
    assert seen.normal is not None and seen.area == pytest.approx(4e-3)
    np.testing.assert_allclose(np.abs(seen.normal), [np.sin(np.deg2rad(20)), 0,
                               np.cos(np.deg2rad(20))], atol=1e-6)  # fmt: skip
    assert part.end(1) is None  # no face closes it square to x


def test_meshes_and_stl_files(tmp_path: Path, checkout: Path) -> None:
    lug = part_outline(coarse_mesh(checkout / "examples" / "lug.msh"))
    assert {face.name for face in lug.faces} == {"clamp", "eye"}
    block = mesh.box(size=(60.0, 20.0, 10.0), divisions=(6, 2, 1))
    write_vtu(tmp_path / "block.vtu", block.points, block.cells)
    plain = part_outline(coarse_mesh(tmp_path / "block.vtu"))
    assert plain.faces == ()
    assert plain.volume == pytest.approx(12e-6) and plain.skin == pytest.approx(4e-3)
    assert plain.broadside().name in ("-z", "+z")
    assert plain.broadside().area == pytest.approx(1.2e-3)
    with Gmsh():
        pass  # skipped where Gmsh is missing
    # in mm, of metres
    write_stl(tmp_path / "block.stl", block.points / 1e3, mesh.boundary_faces(block).nodes)
    stl = part_outline(coarse_mesh(tmp_path / "block.stl"))
    assert {face.kind for face in stl.faces} == {
        f"plane that looks {sign}{axis}" for sign in "+-" for axis in "xyz"
    }
    assert stl.volume == pytest.approx(12e-6)
