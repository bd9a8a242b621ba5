"""Damaged mesh, field, surface and CAD files: a result, or one error that names the file, soon and
without taking memory that the file's size doesn't warrant."""

from __future__ import annotations

import base64
import json
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError
from gpusim.export import write_pvd, write_stl
from gpusim.files.input_file import included_files, read_input
from gpusim.mesh import box, mesh_cad, read_mesh, read_surface, read_textured
from tests.field import test_read as fields
from tests.hostile.mutations import SEED, mutations, share
from tests.support.gltf_files import pictured
from tests.support.gmsh_meshes import Gmsh, write_two_boxes
from tests.support.vtk_files import BRICK, Vtu, legacy

pytestmark = pytest.mark.hostile

SECONDS, BYTES = 60.0, 100e6
ZLIB, LZMA = "vtkZLibDataCompressor", "vtkLZMADataCompressor"
OBJ = b"v 0 0 0\nv 1 0 0\nv 1 1 0 1.0\nv 0 1 .5\ng side\nf 1/1 2/2 3/3\nf -4 -3 -2 -1\n"
OFF = b"OFF\n4 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 .5\n3 0 1 2\n4 0 1 2 3\n"
PLY = (
    "ply\nformat {} 1.0\ncomment x\nelement vertex 4\nproperty float x\nproperty float y\n"
    "property float z\nproperty uchar red\nelement face 2\n"
    "property list uchar int vertex_indices\nend_header\n"
)


def field_of(path: Path) -> None:
    field = gs.read_field(path)
    for number in range(len(field.times)):
        field.step(number)


def vtu_of(how: Vtu) -> bytes:
    piece = {"points": BRICK, "cells": np.arange(8)[None], "data": {"U": 0.1 * BRICK}}
    return how.text([piece, {**piece, "points": BRICK + np.array([0.0, 0.0, 20.0])}])


def binary_ply(order: str) -> bytes:
    kind = "little" if order == "<" else "big"
    data = PLY.format(f"binary_{kind}_endian").encode()
    for point in BRICK[:4]:
        data += point.astype(order + "f4").tobytes() + b"\x80"
    for face in ([0, 1, 2], [0, 1, 2, 3]):
        data += bytes([len(face)]) + np.array(face, order + "i4").tobytes()
    return data


def msh(folder: Path, version: float, binary: int) -> bytes:
    write_two_boxes(folder / "m.msh", MshFileVersion=version, Binary=binary)
    return (folder / "m.msh").read_bytes()


def stl(folder: Path, binary: bool) -> bytes:
    write_stl(folder / "m.stl", BRICK, np.array([[0, 1, 2], [0, 2, 4]]))
    data = (folder / "m.stl").read_bytes()
    if binary:
        return data
    triangle = "facet normal 0 0 1\nouter loop\n" + "vertex 0 1 .5\nvertex 1 2 3\nvertex 0 3 1\n"
    return ("solid a\n" + 2 * (triangle + "endloop\nendfacet\n") + "endsolid a\n").encode()


def gltf_text() -> bytes:
    file = pictured()
    data = base64.b64encode(file.data).decode()
    uri = f"data:application/octet-stream;base64,{data}"
    buffers = [{"byteLength": len(file.data), "uri": uri}]
    return json.dumps({**file.json, "buffers": buffers}).encode()


def med(folder: Path) -> bytes:
    write_two_boxes(folder / "m.med")
    return (folder / "m.med").read_bytes()


def exodus_of(folder: Path, hdf: bool) -> bytes:
    return fields.exodus_file(folder / "m.e", "hex20", hdf).read_bytes()


def pvd(folder: Path) -> bytes:
    return write_pvd(
        folder / "m.pvd", [(0.5, folder / "a.vtu"), (1.0, folder / "b.vtu")]
    ).read_bytes()


def legacy_of(binary: bool, version: str) -> bytes:
    bricks = box((3.0, 2.0, 1.0), (3, 2, 1))
    return legacy(bricks.points, bricks.cells["hex8"], binary, version, True)


LOOKS = b"""mtllib {name}
v 0 0 0
v 4 0 0
v 4 4 0
v 1 1 0
v 0 4 0
vt 0 0
vt 1 0
vt 1 1
usemtl A
f 1/1 2/2 3/3 4/1 5/2
usemtl B c
f 1/1 2/2 4/-1 5/3
"""
MTL = b"""newmtl A
Kd 0.5 0.2 0.1
map_Kd -s 2 2 1 -o 0.5 0 0 q.png
newmtl B c
Kd 0.1
map_KD -clamp on \\
  q.png
"""


def looks_of(path: Path) -> None:
    """As a scene reads them; of an .mtl, those of an OBJ that names it."""
    (path.parent / "q.png").write_bytes(b"of no matter here")
    if path.suffix == ".mtl":
        path.with_suffix(".obj").write_bytes(LOOKS.replace(b"{name}", path.name.encode()))
    file = read_input(path.with_suffix(".obj"))
    known = {str(one.path): one.sha256 for one in (file, *included_files(file))}
    read_textured(read_input(file, known=known))


Make = Callable[[Path], bytes]
CASES: dict[str, tuple[str, Callable[[Path], Any], Make]] = {
    "msh 2.2 text": (".msh", read_mesh, lambda f: msh(f, 2.2, 0)),
    "msh 2.2 binary": (".msh", read_mesh, lambda f: msh(f, 2.2, 1)),
    "msh 4.1 text": (".msh", read_mesh, lambda f: msh(f, 4.1, 0)),
    "msh 4.1 binary": (".msh", read_mesh, lambda f: msh(f, 4.1, 1)),
    "vtu text": (".vtu", field_of, lambda f: vtu_of(Vtu())),
    "vtu base64": (".vtu", field_of, lambda f: vtu_of(Vtu("binary"))),
    "vtu zlib": (".vtu", field_of, lambda f: vtu_of(Vtu("raw", compressor=ZLIB))),
    "vtu lzma": (".vtu", read_mesh, lambda f: vtu_of(Vtu("base64", compressor=LZMA))),
    "vtk text": (".vtk", read_mesh, lambda f: legacy_of(False, "4.2")),
    "vtk binary": (".vtk", read_mesh, lambda f: legacy_of(True, "4.2")),
    "vtk 5.1": (".vtk", read_mesh, lambda f: legacy_of(True, "5.1")),
    "exodus mesh": (".e", read_mesh, lambda f: exodus_of(f, False)),
    "exodus field": (".e", field_of, lambda f: exodus_of(f, False)),
    "pvd": (".pvd", field_of, pvd),
    "frd": (".frd", field_of, lambda f: fields.frd(f / "m.frd", "wedge15").read_bytes()),
    "npz": (".npz", field_of, lambda f: fields.npz(f / "m.npz", "hex8").read_bytes()),
    "stl text": (".stl", read_surface, lambda f: stl(f, False)),
    "stl binary": (".stl", read_surface, lambda f: stl(f, True)),
    "ply text": (".ply", read_surface, lambda f: PLY.format("ascii").encode()
                 + b"0 0 0 9\n1 0 0 9\n1 1 0 9\n0 1 .5 9\n3 0 1 2\n4 0 1 2 3\n"),
    "ply binary": (".ply", read_surface, lambda f: binary_ply("<")),
    "obj": (".obj", read_surface, lambda f: OBJ),
    "obj looks": (".obj", looks_of, lambda f: LOOKS.replace(b"{name}", b"a.mtl")),
    "mtl": (".mtl", looks_of, lambda f: MTL),
    "off": (".off", read_surface, lambda f: OFF),
    "glb": (".glb", read_textured, lambda f: pictured().glb()),
    "gltf": (".gltf", read_textured, lambda f: gltf_text()),
}  # fmt: skip
# in processes of their own, which takes some tenths of a second each
CHILDREN: dict[str, tuple[str, Callable[[Path], Any], Make]] = {
    "med": (".med", read_mesh, med),
    "exodus hdf5": (".e", field_of, lambda f: exodus_of(f, True)),
    "step": (
        ".step",
        lambda path: mesh_cad(path, size=8.0, time_limit=8),
        lambda f: cad(f, "step"),
    ),
    "brep": (
        ".brep",
        lambda path: mesh_cad(path, size=8.0, time_limit=8),
        lambda f: cad(f, "brep"),
    ),
}


def cad(folder: Path, kind: str) -> bytes:
    with Gmsh() as gmsh:
        gmsh.model.occ.addCylinder(0, 0, 0, 4, 5, 9, 3)
        gmsh.model.occ.synchronize()
        gmsh.write(str(folder / f"m.{kind}"))
    return (folder / f"m.{kind}").read_bytes()


def try_all(case: tuple[str, Callable[[Path], Any], Make], folder: Path, count: int) -> None:
    suffix, read, make = case
    data = make(folder)
    path = folder / f"valid{suffix}"
    for name in ("a.vtu", "b.vtu"):
        (folder / name).write_bytes(vtu_of(Vtu()))
    path.write_bytes(data)
    read(path)
    path = folder / f"damaged{suffix}"
    for damage, content in mutations(data, np.random.default_rng(SEED), count):
        path.write_bytes(content)
        tracemalloc.start()
        began = time.monotonic()
        try:
            with np.errstate(all="ignore"):
                read(path)
        except InputError as error:
            text = str(error)
            assert folder.name in text, f"{damage}: not named: {text}"
            assert len(text) < 1000 and "\x1b" not in text, f"{damage}: {text!r}"
        except Exception as error:
            raise AssertionError(f"{damage}: {type(error).__name__}: {error}") from error
        finally:
            peak = tracemalloc.get_traced_memory()[1]
            tracemalloc.stop()
        assert peak < BYTES, f"{damage}: {peak / 1e6:.0f} MB"
        assert time.monotonic() - began < SECONDS, damage


@pytest.mark.parametrize("name", CASES)
def test_damaged_files(name: str, tmp_path: Path) -> None:
    try_all(CASES[name], tmp_path, share(300))


@pytest.mark.parametrize("name", CHILDREN)
def test_damaged_files_of_native_libraries(name: str, tmp_path: Path) -> None:
    try_all(CHILDREN[name], tmp_path, share(75))
