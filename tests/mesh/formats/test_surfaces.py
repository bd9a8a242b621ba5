"""Files of faces, written by hand in every form that others write, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from gpusim.errors import InputError
from gpusim.files.input_file import read_input
from gpusim.mesh import read_surface

POINTS = np.array([[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0], [1, 3, 0.5]])
FACES = ([0, 1, 2, 3], [3, 2, 4])
AREA = 2.0 + 0.5 * np.linalg.norm(np.cross([2, 0, 0], [1, 2, 0.5]))

OBJ = """# groups; a quad by numbers from the first point, a triangle from the last
mtllib a.mtl
o thing
v 0 0 0
v 2 0 0 1.0
v 2 1 0 0.1 0.2 0.3
v 0 1 0
vt 0 0
vn 0 0 1
g first
usemtl red
f 1/1/1 2/1/1 3//1 4
v 1 3 0.5
s off
g second
f -2 \\
  -3 -1
"""
OFF = "OFF # comment\n5 2 0\n0 0 0\n2 0 0\n2 1 0\n\n0 1 0\n1 3 .5\n4 0 1 2 3 255 0 0\n3 3 2 4\n"
COFF = OFF.replace("OFF", "COFF").replace(" .5\n", " .5 1 1 1 1\n").replace(" 0\n", " 0 1 1 1 1\n")
COFF = COFF.replace("5 2 0 1 1 1 1", "5 2 0").replace("255 0 0 1 1 1 1", "255 0 0")


def stl(solids: int) -> str:
    out = ""
    triangles = [[0, 1, 2], [0, 2, 3], [3, 2, 4]]
    for number in range(solids):
        out += f"solid part {number}\n"
        for triangle in triangles[number::solids]:
            corners = "".join(f"    vertex {x} {y:e} {z}\n" for x, y, z in POINTS[triangle])
            out += f"  facet normal 0 0 1\n  outer loop\n{corners}  endloop\n  endfacet\n"
        out += f"endsolid part {number}\n"
    return out


def ply(order: str, name: str = "vertex_indices") -> bytes:
    kind = {"": "ascii", "<": "binary_little_endian", ">": "binary_big_endian"}[order]
    out = (
        f"ply\nformat {kind} 1.0\ncomment of no matter\nelement vertex 5\n"
        "property uchar red\nproperty double z\nproperty double x\nproperty float y\n"
        f"element face 2\nproperty list uchar short {name}\nproperty int tag\n"
        "element edge 1\nproperty int a\nproperty int b\nend_header\n"
    ).encode()
    for x, y, z in POINTS:
        row = [(9, "u1"), (z, "f8"), (x, "f8"), (y, "f4")]
        out += packed(row, order)
    for face in FACES:
        out += packed([(len(face), "u1"), *((n, "i2") for n in face), (7, "i4")], order)
    return out + packed([(0, "i4"), (1, "i4")], order)


def packed(row: list[tuple[float, str]], order: str) -> bytes:
    if not order:
        return " ".join(f"{value:g}" for value, _ in row).encode() + b"\n"
    return b"".join(np.array(value).astype(order + kind).tobytes() for value, kind in row)


GOOD = {
    "a.obj": OBJ, "a.off": OFF, "c.off": COFF, "one.stl": stl(1), "two.stl": stl(2),
    "text.ply": ply(""), "little.ply": ply("<"), "big.ply": ply(">", "vertex_index"),
    "uv.ply": ply("").replace(b"int tag", b"list uchar float uv").replace(b" 7\n", b" 1 0.25\n"),
}  # fmt: skip


@pytest.mark.parametrize("name", GOOD)
def test_every_form_gives_every_face(name: str, tmp_path: Path) -> None:
    path, content = tmp_path / name, GOOD[name]
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    points, faces = read_surface(read_input(path))
    assert len(points) == 5 and {tuple(p) for p in points} == {tuple(p) for p in POINTS}
    assert len(faces) == (3 if "stl" in name else 2)
    area = 0.0
    for a, b, c, d in faces:
        area += 0.5 * np.linalg.norm(np.cross(points[b] - points[a], points[c] - points[a]))
        if d >= 0:
            area += 0.5 * np.linalg.norm(np.cross(points[c] - points[a], points[d] - points[a]))
    assert area == pytest.approx(AREA, rel=1e-12)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.obj", OBJ + "f 1 2\n", r"a\.obj:18: a face of 2 corners; expected at least 3"),
        ("a.obj", OBJ + "f 1 2 9\n", r"a\.obj: a face names point 8; got 5 points, from 0"),
        ("a.obj", OBJ.replace("g second", "cstype bezier"), r"a\.obj:15: got 'cstype'"),
        ("a.obj", OBJ.replace("2 0 0 1.0", "2 0 0 0.5"), r"a\.obj:5: got v 2 0 0 0.5"),
        ("a.obj", OBJ.replace("3//1 4", "3//1 0"), "point 0"),
        ("a.obj", OBJ.replace("-2 \\", "-9 \\"), "points that are there"),
        ("a.off", OFF.replace("OFF", "4OFF"), r"a\.off:1: got '4OFF'; expected OFF or COFF"),
        ("a.off", OFF.replace("5 2 0", "5 9999999 0"), "5 points and 9999999 faces; got 7 lines"),
        ("a.stl", stl(2)[:-20], r"a\.stl:\d+: .*"),
        ("a.stl", stl(1).replace("endfacet", "shift 1 2 3", 1), r"a\.stl:8: got 'shift'"),
        ("a.stl", b"x" * 80 + b"\xff" * 4, "got 4294967295 triangles, which need"),
        ("a.ply", ply("").replace(b"edge", b"tristrips"), "got element tristrips; expected faces"),
        ("a.ply", ply("<").replace(b"face 2", b"face 99999"), "99999 entries face in"),
        ("a.ply", ply("<")[:-12], "cut off"),
        ("a.ply", ply("").replace(b"double x", b"double w"), "no property x of vertex"),
        ("a.ply", ply("").replace(b"list uchar", b"list float"), r"ply:10: got 'property list"),
        ("a.ply", ply("").replace(b"3 3 2 4", b"3 3 2 4.5"), "names point 4.5; expected whole"),
        ("a.ply", ply("").replace(b"3 3 2 4", b"nan 3 2 4"), "a list of nan entries in face"),
        ("a.ply", ply("").replace(b"3 3 2 4", b"3 3 2 x"), "a.ply: could not convert .*numbers"),
        ("a.glb", b"glTF" + b"\2\0\0\0" * 4, r"a\.glb: damaged, or no glTF"),
        ("a.gltf", '{"asset": {"version": "2.0"}}', r"a\.gltf: "),
        ("a.step", "", "got '.step'; expected one of .stl, .ply, .obj, .off, .glb"),
    ],
)  # fmt: skip
def test_what_would_change_the_surface_is_refused(
    name: str, content: str | bytes, words: str, tmp_path: Path
) -> None:
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(InputError, match=words) as told:
        read_surface(path)
    assert name in str(told.value)


@pytest.mark.parametrize("kind", ["glb", "gltf"])
def test_gltf_is_read_where_its_nodes_place_it(kind: str, tmp_path: Path) -> None:
    scene = trimesh.Scene()
    for shift in (0.0, 5.0):
        box = trimesh.creation.box((1.0, 2.0, 3.0))
        scene.add_geometry(box, transform=trimesh.transformations.translation_matrix((shift, 0, 0)))
    path = tmp_path / f"a.{kind}"
    if kind == "glb":
        path.write_bytes(scene.export(file_type="glb"))
    else:
        files = trimesh.exchange.gltf.export_gltf(scene, embed_buffers=True)
        path.write_bytes(files["model.gltf"])
    points, faces = read_surface(path)
    assert faces.shape == (24, 4) and (faces[:, 3] == -1).all() and len(points) == 16
    np.testing.assert_allclose(points.min(axis=0), (-0.5, -1.0, -1.5))
    np.testing.assert_allclose(points.max(axis=0), (5.5, 1.0, 1.5))
