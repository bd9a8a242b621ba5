"""OBJ and MTL as others write them: options, names, several libraries, what isn't there."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from gpusim.errors import InputError
from gpusim.files.input_file import included_files, read_input
from gpusim.mesh import read_surface, read_textured
from gpusim.mesh.formats.textures import FileMaterial, TexturedSurface

QUAD = """v -0.5 -0.5 0
v 0.5 -0.5 0
v 0.5 0.5 0
v -0.5 0.5 0
vt 0 0
vt 1 0
vt 1 1
vt 0 1
usemtl {name}
f 1/1 2/2 3/3 4/4
"""
UV = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])


def picture(path: Path) -> None:
    path.parent.mkdir(exist_ok=True)
    cv2.imwrite(str(path), np.arange(12, dtype=np.uint8).reshape(2, 2, 3))


def read(folder: Path, mtl: str, name: str = "A", head: str = "mtllib a.mtl\n") -> TexturedSurface:
    """As a scene reads it: what wasn't found beforehand is refused."""
    (folder / "a.mtl").write_bytes(mtl.encode())
    (folder / "a.obj").write_bytes((head + QUAD.format(name=name)).encode())
    file = read_input(folder / "a.obj")
    known = {str(one.path): one.sha256 for one in (file, *included_files(file))}
    return read_textured(read_input(file, known=known))


def material(folder: Path, mtl: str, name: str = "A", head: str = "mtllib a.mtl\n") -> FileMaterial:
    return read(folder, mtl, name, head).materials[0]


@pytest.mark.parametrize(
    ("options", "scale", "offset"),
    [
        ("", (1, 1), (0, 0)),
        ("-s 2 2 1", (2, 2), (0, 0)),
        ("-s 2 3", (2, 3), (0, 0)),
        ("-s 0.5", (0.5, 1), (0, 0)),
        ("-o 0.5 0 0", (1, 1), (0.5, 0)),
        ("-o .25", (1, 1), (0.25, 0)),
        ("-s 2 2 1 -o 0.5 1e-1 0 -blendu on -clamp off -mm 0 1 -texres 512 -cc off", (2, 2),
         (0.5, 0.1)),
    ],
)  # fmt: skip
def test_options_move_the_picture(
    options: str, scale: tuple[float, float], offset: tuple[float, float], tmp_path: Path
) -> None:
    picture(tmp_path / "q.png")
    look = read(tmp_path, f"newmtl A\nmap_Kd {options} q.png\n")
    np.testing.assert_allclose(look.uv[0], UV * scale + offset)
    assert look.materials[0].picture is not None and not look.materials[0].missing


def test_a_picture_that_is_clamped(tmp_path: Path) -> None:
    picture(tmp_path / "q.png")
    found = material(tmp_path, "newmtl A\nmap_Kd -clamp on -s 3 3 q.png\n")
    assert found.wrap == ("clamp", "clamp") and found.picture is not None
    assert material(tmp_path, "newmtl A\nmap_Kd q.png\n").wrap == ("repeat", "repeat")


@pytest.mark.parametrize(
    "option",
    [
        "-mm 0.2 0.5",
        "-cc on",
        "-t 1 1 1",
        "-imfchan r",
        "-boost 2",
        "-type sphere",
        "-s 1e999 1",
        "-o 0 1e999",
    ],
)
def test_options_that_are_not_done_are_refused(option: str, tmp_path: Path) -> None:
    picture(tmp_path / "q.png")
    with pytest.raises(InputError, match=rf"a\.mtl:2: got option {option}.*; expected -s, -o"):
        read(tmp_path, f"newmtl A\nmap_Kd {option} q.png\n")


@pytest.mark.parametrize(
    ("written", "there"),
    [
        ("q.png", "q.png"),
        ("my  new picture.png", "my  new picture.png"),
        ("-s 1 1 1 my picture 2.png", "my picture 2.png"),
        ("2.png", "2.png"),
        ('"q.png"', "q.png"),
        (r"textures\q.png", "textures/q.png"),
        (r"-o 0 0 0 .\textures\my q.png", "textures/my q.png"),
        ("q#1.png", "q#1.png"),
        ("Träger.png", "Träger.png"),
    ],
)
@pytest.mark.parametrize("keyword", ["map_Kd", "map_KD", "map_kd"])
def test_names_of_pictures(written: str, there: str, keyword: str, tmp_path: Path) -> None:
    picture(tmp_path / there)
    found = material(tmp_path, f"newmtl A\n\t{keyword} {written}   \r\n")
    assert found.picture is not None
    assert found.picture.data == (tmp_path / there).read_bytes()


@pytest.mark.parametrize("rest", ["", "   ", " # none"])
def test_a_picture_without_a_name(rest: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"a\.mtl:2: map_Kd without a name"):
        read(tmp_path, f"newmtl A\nmap_Kd{rest}\n")


def test_a_colour_beside_a_picture_multiplies_it(tmp_path: Path) -> None:
    picture(tmp_path / "q.png")
    for text in ("Kd 0.5 0.25 0.125\nmap_Kd q.png\n", "map_Kd q.png\nKd 0.5 0.25 0.125\n"):
        assert material(tmp_path, "newmtl A\n" + text).color == (0.5, 0.25, 0.125)
    assert material(tmp_path, "newmtl A\nmap_Kd q.png\n").color == (1.0, 1.0, 1.0)
    assert material(tmp_path, "newmtl A\nKd 0.4 # grey\n").color == (0.4, 0.4, 0.4)


@pytest.mark.parametrize("mark", ["", "\ufeff"])
def test_several_libraries_and_byte_order_marks(mark: str, tmp_path: Path) -> None:
    (tmp_path / "b c.mtl").write_text(f"{mark}newmtl red paint #2\nKd 1 0 0\n")
    (tmp_path / "c.mtl").write_text("newmtl A\nKd 0 0 1\n")
    green = f"{mark}newmtl A\nKd 0 1 0 # as agreed\n"
    for head, name, color in (
        ("mtllib b c.mtl\n", "red paint #2", (1.0, 0.0, 0.0)),
        ("mtllib away.mtl c.mtl a.mtl\n", "A", (0.0, 1.0, 0.0)),
        ("mtllib a.mtl \\\n  c.mtl\n", "A", (0.0, 0.0, 1.0)),
        ("mtllib a.mtl\nmtllib c.mtl\n", "A", (0.0, 0.0, 1.0)),
        ("mtllib .\\c.mtl\n", "A", (0.0, 0.0, 1.0)),
    ):
        found = material(tmp_path, green, name, mark + head)
        assert (found.name, found.color, found.missing) == (name, color, "")


def test_what_is_not_there_is_named(tmp_path: Path) -> None:
    mtl = "newmtl A\nKd 1 1 1\n"
    assert material(tmp_path, mtl, head="mtllib away.mtl\n").missing == "away.mtl"
    assert material(tmp_path, mtl, "B").missing == "newmtl B"
    assert material(tmp_path, mtl, head="").missing == "newmtl A"
    assert material(tmp_path, "newmtl A\nmap_Kd -s 2 2 2 away.png\n").missing == "away.png"
    # a name that no file system takes, too
    assert material(tmp_path, mtl, head=f"mtllib {'x' * 5000}\n").missing == "x" * 5000
    assert material(tmp_path, f"newmtl A\nmap_Kd {'y' * 5000}\n").missing == "y" * 5000
    assert len(read_surface(tmp_path / "a.obj")[1]) == 1


@pytest.mark.parametrize("color", ["nan 2e5 -1", "0.5 0.5 nan", "1.5 0 0", "-0.1 0 0", "inf",
                                   "x 1 1", "1 1", "spectral a.rfl"])  # fmt: skip
def test_colours_that_are_none(color: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"a\.mtl:2: "):
        read(tmp_path, f"newmtl A\nKd {color}\n")


@pytest.mark.parametrize("line", ["vt nan 0", "vt 0 inf", "vt", "vt 1 2 3 4", "v nan 0 0"])
def test_places_that_are_none(line: str, tmp_path: Path) -> None:
    path = tmp_path / "a.obj"
    path.write_text(QUAD.format(name="A").replace("usemtl", f"{line}\nusemtl"))
    with pytest.raises(InputError, match=r"a\.obj(:9)?: "):
        read_textured(path)
