"""CAD files meshed by Gmsh: sizes, order, hexahedra, names, and what can't be meshed."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np
import pytest

from gpusim.errors import InputError
from gpusim.files.input_file import read_input
from gpusim.mesh import (
    Mesh,
    SizeBox,
    boundary_faces,
    mesh_cad,
    mesh_quality,
    set_faces,
)
from gpusim.mesh.formats import cad
from tests.support.gmsh_meshes import Gmsh

PLATE = 40 * 30 * 10 - np.pi * 6**2 * 10


def volume(mesh: Mesh) -> float:
    faces = boundary_faces(mesh)
    return float(np.einsum("fi,fi->", faces.centroids, faces.area_vectors)) / 3.0


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A plate with a hole as STEP, BREP and STL; a box; two boxes that touch; a lone face."""
    folder = tmp_path_factory.mktemp("cad")
    with Gmsh() as gmsh:
        occ = gmsh.model.occ
        occ.cut([(3, occ.addBox(0, 0, 0, 40, 30, 10))],
                [(3, occ.addCylinder(20, 15, -1, 0, 0, 12, 6))])  # fmt: skip
        occ.synchronize()
        for suffix in ("step", "brep"):
            gmsh.write(str(folder / f"plate.{suffix}"))
        gmsh.option.setNumber("Mesh.MeshSizeMax", 4)
        gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", 60)
        gmsh.model.mesh.generate(2)
        gmsh.write(str(folder / "plate.stl"))
        gmsh.model.add("box")
        occ.addBox(0, 0, 0, 40, 30, 10)
        occ.synchronize()
        gmsh.write(str(folder / "box.step"))
        gmsh.model.add("two")
        occ.addBox(0, 0, 0, 40, 30, 10)
        occ.addBox(40, 5, 0, 20, 20, 10)
        occ.synchronize()
        gmsh.write(str(folder / "two.step"))
        gmsh.model.add("face")
        occ.addRectangle(0, 0, 0, 4, 3)
        occ.synchronize()
        gmsh.write(str(folder / "face.step"))
    return folder


@pytest.mark.parametrize(("suffix", "curvature"), [("step", 24), ("brep", 24), ("stl", 0)])
def test_tetrahedra_of_each_format(files: Path, suffix: str, curvature: int) -> None:
    mesh = mesh_cad(files / f"plate.{suffix}", size=5.0, curvature=curvature)
    assert set(mesh.cells) == {"tet4"}
    # without curvature the hole is a coarse polygon
    assert volume(mesh) == pytest.approx(PLATE, rel=5e-3 if curvature else 2e-2)
    quality = mesh_quality(mesh)
    assert quality.scaled_jacobian.min() > 0.02 and len(mesh.face_sets) >= 7
    every = np.concatenate(list(mesh.face_sets.values()))
    assert len(every) == len(boundary_faces(mesh))
    if suffix == "step":
        again = mesh_cad(files / "plate.step", size=5.0, curvature=curvature)
        np.testing.assert_array_equal(again.points, mesh.points)
        np.testing.assert_array_equal(again.cells["tet4"], mesh.cells["tet4"])


def test_second_order_follows_the_curve(files: Path) -> None:
    mesh = mesh_cad(files / "plate.step", size=6.0, order=2, curvature=16)
    assert set(mesh.cells) == {"tet10"}
    radius = np.hypot(mesh.points[:, 0] - 20, mesh.points[:, 1] - 15)
    (hole,) = (
        faces for faces in (set_faces(mesh, pairs) for pairs in mesh.face_sets.values())
        if np.abs(radius[faces.node_numbers()] - 6).max() <= 1e-6
    )  # fmt: skip
    assert hole.areas.sum() == pytest.approx(2 * np.pi * 6 * 10, rel=2e-3)


@pytest.mark.parametrize("order", [1, 2])
def test_hexahedra(files: Path, order: int) -> None:
    kind = "hex8" if order == 1 else "hex20"
    box = mesh_cad(files / "box.step", size=5.0, hexahedra=True, order=order)
    assert set(box.cells) == {kind}
    assert mesh_quality(box).scaled_jacobian.min() == pytest.approx(1.0)
    assert volume(box) == pytest.approx(12000.0, rel=1e-12)
    edge = np.linalg.norm(np.diff(box.points[box.cells[kind][:, :2]], axis=1), axis=2)
    assert edge.max() <= 5.0 * 1.2
    plate = mesh_cad(files / "plate.step", size=6.0, hexahedra=True, order=order)
    assert set(plate.cells) == {kind}
    assert volume(plate) == pytest.approx(PLATE, rel=2e-2)


def test_touching_solids_share_nodes_and_have_cell_sets(files: Path) -> None:
    mesh = mesh_cad(files / "two.step", size=5.0, scale=1e-3 * 1e3)
    assert set(mesh.cell_sets) == {"solid_1", "solid_2"}
    assert sum(map(len, mesh.cell_sets.values())) == mesh.cell_count
    surface = boundary_faces(mesh).areas.sum()
    boxes = 2 * (40 * 30 + 40 * 10 + 30 * 10) + 2 * (20 * 20 + 20 * 10 + 20 * 10)
    assert surface == pytest.approx(boxes - 2 * 20 * 10, rel=1e-12)


@pytest.mark.parametrize("order", [1, 2])
def test_hex_dominant(files: Path, tmp_path: Path, order: int) -> None:
    with Gmsh() as gmsh:
        occ = gmsh.model.occ
        occ.addBox(0, 0, 0, 40, 30, 10)
        occ.addCylinder(40, 15, 5, 20, 0, 0, 4)
        occ.synchronize()
        gmsh.write(str(tmp_path / "both.brep"))
    mesh = mesh_cad(tmp_path / "both.brep", size=5.0, hex_dominant=True, order=order)
    assert set(mesh.cells) == ({"tet4", "pyramid5"} if order == 1 else {"tet10", "pyramid13"})
    faces = boundary_faces(mesh)
    np.testing.assert_allclose(faces.area_vectors.sum(axis=0), 0.0, atol=1e-10)
    two = mesh_cad(files / "two.step", size=5.0, hex_dominant=True, order=order)
    assert volume(two) == pytest.approx(16000.0, rel=1e-12)
    boxes = 2 * (40 * 30 + 40 * 10 + 30 * 10) + 2 * (20 * 20 + 20 * 10 + 20 * 10)
    assert boundary_faces(two).areas.sum() == pytest.approx(boxes - 2 * 20 * 10, rel=1e-12)
    mixed = {"hex8", "pyramid5", "tet4"} if order == 1 else {"hex20", "pyramid13", "tet10"}
    assert set(two.cells) == mixed


def test_sizes_at_places(files: Path) -> None:
    plain = mesh_cad(files / "box.step", size=0.01, scale=1e-3)
    near = SizeBox((0.0, 0.0, 0.0), (0.01, 0.01, 0.01), 0.002, transition=0.005)
    boxed = mesh_cad(files / "box.step", size=0.01, scale=1e-3, boxes=[near])
    faced = mesh_cad(files / "box.step", size=0.01, scale=1e-3, sizes={"face_2": 0.002})
    assert boxed.cell_count > 2 * plain.cell_count
    corner = (boxed.points <= 0.01 + 1e-9).all(axis=1).mean()
    assert corner > 0.3
    for mesh in (plain, boxed, faced):
        assert volume(mesh) == pytest.approx(12e-6, rel=1e-12)
    for name, count in ((n, len(p)) for n, p in plain.face_sets.items()):
        more = len(faced.face_sets[name]) / count
        assert more > 5 if name == "face_2" else more < 3


def test_names_of_the_file(files: Path) -> None:
    text = (files / "box.step").read_text()
    label = text[text.index("PRODUCT('") + 9 :].split("'")[0]
    named = files / "named.step"
    named.write_text(text.replace(label, "lever"))
    mesh = mesh_cad(named, size=10.0)
    assert set(mesh.cell_sets) == {"lever"}
    assert len(mesh.cell_sets["lever"]) == mesh.cell_count


@pytest.mark.parametrize("suffix", ["step", "stl"])
def test_more_elements_than_any_machine_holds(files: Path, suffix: str) -> None:
    """... are refused at once: 11 cm3 in elements of 0.1 um."""
    size, scale = (1e-4, 1.0) if suffix == "step" else (1e-7, 1e-3)
    with pytest.raises(InputError, match=r"size; got .*which makes about .*e\+1\d elements"):
        mesh_cad(files / f"plate.{suffix}", size=size, scale=scale)


@pytest.mark.parametrize("suffix", ["step", "stl"])
def test_a_sheet_is_estimated_by_its_faces(
    tmp_path: Path, suffix: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By its volume it would be refused twenty times too late."""
    path = tmp_path / f"sheet.{suffix}"
    with Gmsh() as gmsh:
        gmsh.model.occ.addBox(0, 0, 0, 200, 100, 0.2)
        gmsh.model.occ.synchronize()
        gmsh.model.mesh.generate(2)
        gmsh.write(str(path))
    real = mesh_cad(path, size=5.0).cell_count
    monkeypatch.setattr(cad, "_MAX_ELEMENTS", 5000.0)
    with Gmsh() as gmsh, pytest.raises(InputError, match="size; got 5 in the file") as error:
        cad._load(gmsh, read_input(path, "a CAD file"), path)
        cad._refuse_too_many(gmsh, read_input(path, "a CAD file"), 5e-3, 1e-3)
    found = re.search(r"about (\S+) elements; expected at least (\S+)", str(error.value))
    assert found is not None
    assert float(found[1]) == pytest.approx(real, rel=0.15)  # of one digit
    assert mesh_cad(path, size=float(found[2])).cell_count == pytest.approx(5000, rel=0.15)


def test_files_on_which_gmsh_dies_or_hangs(files: Path, tmp_path: Path) -> None:
    """Three lines of a STEP file run into one, and a count of a BREP file."""
    text = (files / "box.step").read_text()
    dies, hangs = tmp_path / "dies.step", tmp_path / "hangs.brep"
    dies.write_text(re.sub(r"FACE_BOUND\('',#139,.*?#140 = [^\n]*", "FACF.);", text, flags=re.S))
    with pytest.raises(InputError, match=r"dies\.step: can't be meshed: .* died \(SIGSEGV\)"):
        mesh_cad(dies, size=5.0)
    text = (files / "plate.brep").read_text()
    hangs.write_text(re.sub(r"Curve2ds \d+", "Curve2ds 9223372036854775807", text))
    with pytest.raises(InputError, match=r"hangs\.brep: .* not done after 1\.5 s, its time limit"):
        mesh_cad(hangs, size=5.0, time_limit=1.5)


@pytest.mark.parametrize("fault", ["OSError('libGLU.so.1')", "ImportError('libGL.so.1')"])
def test_a_gmsh_that_cannot_be_loaded(
    files: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fault: str
) -> None:
    (tmp_path / "gmsh.py").write_text(f"raise {fault}")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "gmsh", raising=False)
    words = r"gmsh can't be loaded; got libGLU?\.so\.1; expected .*apt install libgl1 .*pip install"
    with pytest.raises(InputError, match=words):
        mesh_cad(files / "box.step", size=5.0)


def test_what_cannot_be_meshed(files: Path, tmp_path: Path) -> None:
    for name, words in (("face.step", "no solid; got 1 faces"), ("absent.step", "not found")):
        with pytest.raises(InputError, match=words):
            mesh_cad(files / name, size=1.0)
    for suffix in ("step", "brep", "stl"):
        bad = tmp_path / f"bad.{suffix}"
        bad.write_bytes(bytes(range(256)) * 8)
        with pytest.raises(InputError, match=rf"bad\.{suffix}"):
            mesh_cad(bad, size=1.0)
    lost = tmp_path / "lost.stl"
    text = (files / "plate.stl").read_text()
    lost.write_text(re.sub(r"vertex +\S+", "vertex nan", text, count=1))
    with pytest.raises(InputError, match=r"lost\.stl: corners; got 1 that aren't finite"):
        mesh_cad(lost, size=5.0)
    facet = np.zeros(50, np.uint8)
    facet[44:48] = np.array([np.inf], "<f4").view(np.uint8)
    lost.write_bytes(bytes(80) + (2).to_bytes(4, "little") + bytes(50) + facet.tobytes())
    with pytest.raises(InputError, match=r"lost\.stl: corners; got 1 that aren't finite"):
        mesh_cad(lost, size=5.0)
    cut = tmp_path / "cut.step"
    cut.write_text((files / "box.step").read_text()[:4000])
    with pytest.raises(InputError, match=r"cut\.step"):
        mesh_cad(cut, size=1.0)
    with pytest.raises(InputError, match="curvature for a surface of flat triangles"):
        mesh_cad(files / "plate.stl", size=5.0, curvature=16)
    with pytest.raises(InputError, match="did you mean 'face_1'"):
        mesh_cad(files / "box.step", size=5.0, sizes={"face1": 1.0})


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"size": 0.0}, "size; got 0.0"),
        ({"size": float("nan")}, "size; got nan"),
        ({"size": 1.0, "scale": -1.0}, "scale; got -1.0"),
        ({"size": 1.0, "order": 3}, "order; got 3"),
        ({"size": 1.0, "hexahedra": True, "hex_dominant": True}, "got both"),
        ({"size": 1.0, "curvature": 1.5}, "curvature; got 1.5"),
        ({"size": 1.0, "sizes": {"face_1": -2.0}}, r"sizes\['face_1'\]; got -2.0"),
        ({"size": 1.0, "boxes": [SizeBox((0, 0, 0), (1, 0, 1), 0.5)]}, r"boxes\[0\]; got"),
    ],
)
def test_wrong_options(tmp_path: Path, options: dict[str, object], words: str) -> None:
    path = tmp_path / "x.step"
    path.write_text("x")
    with pytest.raises(InputError, match=words):
        mesh_cad(path, **options)  # type: ignore[arg-type]


def test_without_gmsh_the_message_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "x.step"
    path.write_text("x")
    monkeypatch.setitem(sys.modules, "gmsh", None)
    with pytest.raises(
        InputError, match=r"x\.step: .* gmsh, which is not installed.*pip install gmsh"
    ):
        mesh_cad(path, size=1.0)
