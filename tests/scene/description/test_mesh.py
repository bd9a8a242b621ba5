"""``[body.mesh]``: builders and files, notches, counts of the plan, faults, and the report."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gpusim as gs
from gpusim.export.meshes import write_vtu
from gpusim.mesh import boundary_faces, box
from gpusim.pipeline.scene_objects.meshing import build_mesh, mesh_summary
from gpusim.pipeline.scene_objects.surfaces import build_body
from gpusim.plan.plan import make_plan
from gpusim.scene import Scene
from gpusim.scene.cost import element_counts, mesh_words
from tests.support.gmsh_meshes import Gmsh, write_two_boxes

SCENE: dict[str, Any] = {
    "schema": 1,
    "name": "part",
    "material": [{"name": "steel", "youngs_modulus_GPa": 210.0, "poissons_ratio": 0.3}],
    "body": [{"name": "part", "material": "steel", "mesh": {},
              "paint": [{"name": "grey", "type": "plain", "albedo": 0.5}]}],
}  # fmt: skip

CELLS = ("hex8", "hex20", "hex27", "tet4", "tet10", "wedge6", "wedge15")
BUILDERS: list[dict[str, Any]] = [
    {"builder": "box", "size_mm": [30.0, 20.0, 10.0], "divisions": [4, 3, 2]},
    {"builder": "beam", "length_mm": 30.0, "width_mm": 20.0, "height_mm": 10.0,
     "end_width_mm": 10.0, "divisions": [5, 3, 2]},
    {"builder": "crane", "element_mm": 40.0, "across": 2},
    {"builder": "plate_with_hole", "length_mm": 60.0, "width_mm": 30.0, "thickness_mm": 3.0,
     "hole_diameter_mm": 10.0, "around": 16, "radial": 3},
    {"builder": "bracket", "around": 16, "radial": 2, "bend": 3, "wall_height_mm": 51.0},
]  # fmt: skip


def document(mesh: dict[str, Any], **body: Any) -> dict[str, Any]:
    return {**SCENE, "body": [{**SCENE["body"][0], "mesh": mesh, **body}]}


def scene_of(mesh: dict[str, Any], folder: Path = Path(), **body: Any) -> Scene:
    return Scene.from_document(document(mesh, **body), folder=folder)


def faults_of(mesh: dict[str, Any], folder: Path = Path(), **body: Any) -> str:
    with pytest.raises(gs.SceneError) as caught:
        scene_of(mesh, folder, **body)
    return str(caught.value)


@pytest.mark.parametrize("cells", CELLS)
@pytest.mark.parametrize("mesh", BUILDERS, ids=lambda mesh: mesh["builder"])
def test_builders_make_about_the_cells_that_the_plan_guesses(
    mesh: dict[str, Any], cells: str
) -> None:
    scene = scene_of({**mesh, "cells": cells})
    recipe = scene.bodies[0].mesh
    grid = build_mesh(recipe)
    assert list(grid.cells) == [cells]
    nodes, elements = element_counts(recipe)
    assert elements == pytest.approx(grid.cell_count, rel=0.03)
    assert 0.55 * grid.node_count <= nodes <= 1.1 * grid.node_count  # most of these are borders
    assert len(boundary_faces(grid)) == len(
        np.unique(np.concatenate(list(grid.face_sets.values())), axis=0)
    ) or mesh["builder"] in ("crane", "bracket")
    assert mesh_words(recipe) == f"about {elements:,} elements"
    words = f"{grid.node_count:,} nodes, {grid.cell_count:,} elements"
    made = {recipe: (grid.node_count, grid.cell_count)}
    assert make_plan(scene, fresh=True, made=made)["mesh"].detail in ("", words)
    assert mesh_words(recipe, made) == words


NOTCHES = [
    {"position_mm": 200.0 * k, "width_mm": 1.0, "depth_mm": 13.33} for k in (1, 2, 3)
]  # fmt: skip
BEAM = {
    "builder": "beam", "length_mm": 800.0, "width_mm": 40.0, "height_mm": 4.0,
    "divisions": [160, 8, 1],
}  # fmt: skip


def test_notches_of_a_beam() -> None:
    where = {"set": "notch_2"}
    paints = [*SCENE["body"][0]["paint"],
              {"name": "slot", "type": "plain", "albedo": 0.1, "where": where}]  # fmt: skip
    scene = scene_of(BEAM, notch=NOTCHES, paint=paints)
    parts = build_body(scene.bodies[0])
    assert set(parts.mesh.face_sets) >= {"notch_1", "notch_2", "notch_3"}
    faces = boundary_faces(parts.mesh)
    volume = np.einsum("fi,fi->", faces.centroids, faces.area_vectors) / 3.0
    assert volume == pytest.approx(0.004 * (0.8 * 0.04 - 3 * 0.001 * 0.01333), rel=1e-9)
    nodes, elements = element_counts(scene.bodies[0].mesh)
    assert nodes == pytest.approx(parts.mesh.node_count, rel=0.15)
    assert elements == pytest.approx(parts.mesh.cell_count, rel=0.1)
    # a notch is part of the mesh: moving one makes everything anew
    moved = scene.replace("body.part.notch.0.position_mm", 210.0)
    assert make_plan(moved)["mesh"].key != make_plan(scene)["mesh"].key
    again = Scene.from_document(scene.document)
    assert again == scene


def test_faults_of_builders_and_notches() -> None:
    text = faults_of(BUILDERS[3], notch=NOTCHES[:1])
    assert "body.part.notch: in a mesh that can't have one" in text and "box or beam" in text
    assert "is along the notch's axis" in faults_of(BEAM, notch=[{**NOTCHES[0], "side": "+x"}])
    where = {"set": "notch_4"}
    paints = [{"name": "slot", "type": "plain", "albedo": 0.1, "where": where}]
    text = faults_of(BEAM, notch=NOTCHES, paint=paints)
    assert "no such set of the mesh" in text and "notch_3" in text
    text = faults_of({**BUILDERS[3], "around": 18, "hole_diameter_mm": 31.0})
    assert "body.part.mesh.around" in text
    assert "too wide" in faults_of({**BUILDERS[3], "hole_diameter_mm": 31.0})
    assert "the leg is too short" in faults_of({**BUILDERS[4], "base_length_mm": 50.0})
    assert "unknown value" in faults_of({**BUILDERS[0], "cells": "hex9"})
    assert "did you mean bracket" in faults_of({"builder": "braket"})


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with mesh files: "two.msh" by Gmsh's groups, "brick.vtu" of one's own."""
    mesh = box((20.0, 10.0, 5.0), (4, 2, 1))
    write_vtu(tmp_path / "brick.vtu", mesh.points, mesh.cells)
    return tmp_path


def test_a_file_beside_the_scene(folder: Path) -> None:
    scene = scene_of({"file": "brick.vtu"}, folder)
    grid = build_mesh(scene.bodies[0].mesh)
    np.testing.assert_allclose(grid.bounds[1], [0.02, 0.01, 0.005], rtol=1e-14)
    assert build_mesh(scene_of({"file": "brick.vtu", "unit": "in"}, folder).bodies[0].mesh).bounds[
        1, 0
    ] == pytest.approx(20 * 0.0254)
    second = build_mesh(scene_of({"file": "brick.vtu", "order": 2}, folder).bodies[0].mesh)
    assert second.cells["hex20"].shape == (8, 20)
    assert make_plan(scene)["surface"].state == "skipped"
    assert (
        mesh_words(scene.bodies[0].mesh)
        == f"brick.vtu, {(folder / 'brick.vtu').stat().st_size / 1e6:.2g} MB"
    )
    # what was resolved finds its file from anywhere
    assert Scene.from_document(scene.document) == scene
    assert scene.replace("name", "other").files == scene.files


def test_the_scene_file_s_own_folder_counts(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = folder / "scene.toml"
    path.write_text(
        'schema = 1\nname = "x"\n[[material]]\nname = "steel"\nyoungs_modulus_GPa = 210.0\n'
        'poissons_ratio = 0.3\n[[body]]\nname = "part"\nmaterial = "steel"\n'
        '[body.mesh]\nfile = "brick.vtu"\n[[body.paint]]\nname = "grey"\ntype = "plain"\n'
        "albedo = 0.5\n"
    )
    monkeypatch.chdir("/")
    scene = gs.load_scene(path)
    (entry,) = scene.files
    assert entry[0] == str(folder / "brick.vtu") and len(entry[1]) == 64
    (folder / "brick.vtu").unlink()
    with pytest.raises(gs.SceneError, match=r"body\.part\.mesh\.file: not found \(line 11\)"):
        gs.load_scene(path)


def test_the_content_of_the_file_decides_what_is_run_again(folder: Path) -> None:
    before = make_plan(scene_of({"file": "brick.vtu"}, folder))
    same = make_plan(scene_of({"file": "brick.vtu"}, folder))
    mesh = box((20.0, 10.0, 5.0), (4, 2, 2))
    write_vtu(folder / "brick.vtu", mesh.points, mesh.cells)
    after = make_plan(scene_of({"file": "brick.vtu"}, folder))
    for stage in ("mesh", "surface"):
        assert same[stage].key == before[stage].key != after[stage].key
    other = scene_of({"file": "brick.vtu"}, folder).replace("solver.tolerance", 1e-4)
    assert make_plan(other)["mesh"].key == after["mesh"].key


def test_faults_of_files(folder: Path) -> None:
    assert "not found" in faults_of({"file": "absent.msh"}, folder)
    (folder / "x.msh").mkdir()
    assert "is a folder" in faults_of({"file": "x.msh"}, folder)
    (folder / "x.obj").write_text("x")
    assert "unknown kind of mesh file" in faults_of({"file": "x.obj"}, folder)
    (folder / "x.step").write_text("x")
    assert "size_mm: missing for a CAD file" in faults_of({"file": "x.step"}, folder)
    text = faults_of({"file": "x.step", "size_mm": 1.0, "unit": "m"}, folder)
    assert "a STEP file says its unit itself" in text
    text = faults_of({"file": "x.step", "size_mm": 1.0, "hexahedra": True, "hex_dominant": True},
                     folder)  # fmt: skip
    assert "body.part.mesh.hex_dominant: beside hexahedra" in text
    assert "is for CAD files" in faults_of({"file": "brick.vtu", "size_mm": 1.0}, folder)
    assert "unknown key" in faults_of({"file": "brick.vtu", "builder": "box", "size": 3}, folder)
    text = faults_of({"file": "brick.vtu", "unti": "m"}, folder)
    assert "body.part.mesh.unti: unknown key" in text and "did you mean unit?" in text


def test_groups_of_a_file_are_selections(tmp_path: Path) -> None:
    write_two_boxes(tmp_path / "two.msh")
    paint = {"name": "end", "type": "plain", "albedo": 0.1, "where": {"set": "clamp"}}
    scene = scene_of({"file": "two.msh"}, tmp_path, paint=[*SCENE["body"][0]["paint"], paint])
    assert mesh_words(scene.bodies[0].mesh).startswith("two.msh, 0.0")
    parts = build_body(scene.bodies[0])
    painted = parts.surface.regions == 2
    assert painted.sum() == len(parts.mesh.face_sets["clamp"])
    paint["where"] = {"set": "clam"}
    wrong = scene_of({"file": "two.msh"}, tmp_path, paint=[*SCENE["body"][0]["paint"], paint])
    with pytest.raises(gs.InputError, match="did you mean 'clamp'"):
        build_body(wrong.bodies[0])


def test_a_cad_file(tmp_path: Path) -> None:
    with Gmsh() as gmsh:
        gmsh.model.occ.addBox(0, 0, 0, 40, 30, 10)
        gmsh.model.occ.synchronize()
        gmsh.write(str(tmp_path / "block.step"))
    mesh = {"file": "block.step", "size_mm": 10.0, "order": 2, "hexahedra": True}
    scene = scene_of(mesh, tmp_path)
    grid = build_mesh(scene.bodies[0].mesh)
    assert set(grid.cells) == {"hex20"}
    np.testing.assert_allclose(grid.bounds[1], [0.04, 0.03, 0.01], rtol=1e-9)
    assert mesh_words(scene.bodies[0].mesh) == (
        "block.step, to be meshed with elements up to 10 mm"
    )


def test_the_summary_names_bad_cells() -> None:
    points = box((3.0, 2.0, 1.0), (3, 2, 1)).points.copy()
    points[np.argmax(points.sum(axis=1))] -= (0.47, 0.48, 0.0)
    mesh = gs.Mesh(points, box((3.0, 2.0, 1.0), (3, 2, 1)).cells)
    summary, warnings = mesh_summary("part", mesh)
    assert summary.bad_cells == (5,) and summary.bad_count == 1
    assert summary.cells == {"hex8": 6} and 0.0 < summary.least_jacobian < 0.1
    assert len(warnings) == 1 and "'part': 1 cells of bad shape: 5 (scaled" in warnings[0]
    json.dumps(summary.content(), allow_nan=False)
    assert mesh_summary("part", box((3.0, 2.0, 1.0), (3, 2, 1)))[1] == []


def test_the_report_has_the_mesh(tmp_path: Path) -> None:
    scene = scene_of(
        {**BUILDERS[0], "divisions": [3, 2, 1]},
        support=[{"name": "clamp", "where": {"set": "x_min"}, "fix": ["x", "y", "z"]}],
        load=[{"name": "pull", "type": "force", "where": {"set": "x_max"},
               "force_N": [10.0, 0.0, 0.0]}],
    )  # fmt: skip
    gs.run(scene, tmp_path / "out", backend="numpy")
    content = json.loads((tmp_path / "out" / "report.json").read_text())
    (entry,) = content["mesh"]
    assert entry["body"] == "part" and entry["cells"] == {"hex8": 6} and entry["nodes"] == 24
    assert entry["least_scaled_jacobian"] == pytest.approx(1.0)
    assert entry["bad_cells"] == {"count": 0, "worst": []}
    page = (tmp_path / "out" / "report.html").read_text()
    assert "<h2>Mesh</h2>" in page and "6 hex8" in page


def test_the_example_with_a_mesh_file(checkout: Path, tmp_path: Path) -> None:
    scene = gs.load_scene(checkout / "examples" / "lug.toml", {"camera": []})
    report = gs.run(scene, tmp_path, backend="numpy")
    (summary,) = report.meshes
    assert dict(summary.cells) == {"tet10": 784} and summary.bad_count == 0
    again = gs.mesh.read_mesh(tmp_path / "solution" / "lug-0001.vtu")
    np.testing.assert_allclose(again.bounds[1], [0.065, 0.015, 0.006], rtol=1e-9)
    # a second run reuses the solution as long as the mesh file stays the same
    assert make_plan(gs.load_scene(tmp_path / "scene.toml"), tmp_path, "numpy")["solve"].state == (
        "reused"
    )
