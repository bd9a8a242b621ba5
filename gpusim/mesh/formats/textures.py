"""What OBJ and glTF files say of how their faces look: texture coordinates, pictures, colours."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.field_summary import field_summary
from gpusim.files.input_file import InputFile, read_input
from gpusim.mesh.formats.gltf.base_colors import gltf_looks
from gpusim.mesh.formats.surfaces import fail, numbered_surface, text_lines

__all__ = ["TEXTURED_SUFFIXES", "FileMaterial", "TexturedSurface", "read_textured"]

TEXTURED_SUFFIXES = (".obj", ".glb", ".gltf")


@dataclass(frozen=True)
class FileMaterial:
    """A named material: its ``color`` (red, green, blue; linear), by which its picture, if it has
    one, is multiplied. Names needn't differ.

    ``picture`` is a file, its bytes read. ``missing``: the name of a picture that isn't there.
    ``wrap``: how it goes on beyond its sides, along u and v, as of `gpusim.surface.texture`.
    """

    name: str
    color: tuple[float, float, float] = (0.8, 0.8, 0.8)
    picture: InputFile | None = field(default=None, repr=False)
    missing: str = ""
    wrap: tuple[str, str] = ("repeat", "repeat")


@dataclass(frozen=True, eq=False)
class TexturedSurface:
    """Points (P, 3), faces (F, 4) as of `read_surface`, and how they look.

    ``uv`` (F, 4, 2): texture coordinates of each face's corners, from the picture's lower left
    corner, in its widths and heights; NaN where the file has none. ``material`` (F,): which of the
    ``materials`` a face has, -1 none.
    """

    points: npt.NDArray[np.float64]
    faces: npt.NDArray[np.int32]
    uv: npt.NDArray[np.float64]
    material: npt.NDArray[np.int32]
    materials: tuple[FileMaterial, ...]
    __repr__ = field_summary


def read_textured(path: str | os.PathLike[str] | InputFile) -> TexturedSurface:
    """A surface of an OBJ or glTF file with its texture coordinates and materials.

    An OBJ's materials are those of its ``mtllib`` beside it: ``Kd`` and ``map_Kd``. A glTF's are
    the base colours, by which vertices' colours are multiplied, and their textures.

    Raises
    ------
    InputError
        As `read_surface`, or texture coordinates that a face names but the file hasn't.

    Examples
    --------
    >>> import pathlib
    >>> text = "v 0 0 0\\nv 1 0 0\\nv 0 1 0\\nvt 0 0\\nvt 1 0\\nvt 0 1\\nf 1/1 2/2 3/3\\n"
    >>> _ = pathlib.Path("corner.obj").write_text(text)
    >>> gs.mesh.read_textured("corner.obj").uv[0, :3].tolist()
    [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]
    """
    file = read_input(path, "a file of faces")
    if file.suffix not in TEXTURED_SUFFIXES:
        raise InputError(
            f"{file.path}: got {file.suffix!r}; expected one with texture coordinates: "
            f"{', '.join(TEXTURED_SUFFIXES)}"
        )
    points, faces, number = numbered_surface(file)
    uv, material, materials = _obj(file) if file.suffix == ".obj" else _gltf(file)
    return TexturedSurface(points, faces, uv[number], material[number], materials)


Looks = tuple[npt.NDArray[np.float64], npt.NDArray[np.int32], tuple[FileMaterial, ...]]


def _obj(file: InputFile) -> Looks:
    whole = InputFile(file.path, re.sub(rb"\\[ \t]*\r?\n", b" ", file.data))
    places: list[list[float]] = [[np.nan, np.nan]]
    corners: list[list[int]] = []
    material: list[int] = []
    names: dict[str, int] = {}
    library: dict[str, FileMaterial] = {}
    now = -1
    for line, (word, *rest) in text_lines(whole):
        if word == "vt":
            try:
                places.append([float(value) for value in [*rest, "0"][:2]])
            except ValueError as error:
                fail(file, f"{error}; expected u and v", line)
        elif word == "mtllib":
            library |= _library(file, " ".join(rest))
        elif word == "usemtl":
            now = names.setdefault(" ".join(rest), len(names))
        elif word == "f":
            given = [[*corner.split("/"), ""][1] or "0" for corner in rest]
            try:
                numbers = [int(text) for text in given]
            except ValueError as error:
                fail(file, f"{error}; expected numbers of points", line)
            # a negative number counts from the last so far, as of points
            numbers = [n if n >= 0 else len(places) + n or -1 for n in numbers]
            if not all(0 <= n < len(places) for n in numbers):
                fail(file, f"a face names vt {max(given)}; got {len(places) - 1} so far", line)
            corners.append([*numbers, 0][:4])
            material.append(now)
    uv = np.array(places)[np.array(corners, np.int64).reshape(-1, 4)]
    materials = tuple(library.get(name, FileMaterial(name)) for name in names)
    return uv, np.array(material, np.int32), materials


def _library(file: InputFile, name: str) -> dict[str, FileMaterial]:
    """The materials of an OBJ's .mtl, by name; none if it isn't there."""
    if not (file.path.parent / name).is_file():
        return {}
    mtl = file.beside(name, "materials")
    found: dict[str, dict[str, Any]] = {}
    values: dict[str, Any] = {}
    for line, (word, *rest) in text_lines(mtl):
        if word == "newmtl":
            values = found[" ".join(rest)] = {}
        elif word == "Kd":
            try:
                red, green, blue = (float(value) for value in rest)
            except ValueError:
                fail(mtl, f"got Kd {' '.join(rest)[:60]}; expected red, green, blue", line)
            values["color"] = red, green, blue
        elif word == "map_Kd":
            values.setdefault("color", (1.0, 1.0, 1.0))
            picture = rest[-1] if rest and rest[0].startswith("-") else " ".join(rest)
            if (mtl.path.parent / picture).is_file():
                values["picture"] = InputFile(mtl.path, b"", file.known).beside(
                    picture, "a picture"
                )
            else:
                values["missing"] = picture
    return {name: FileMaterial(name, **values) for name, values in found.items()}


def _gltf(file: InputFile) -> Looks:
    triangles, material, looks = gltf_looks(file)
    uv = np.concatenate([triangles, np.full((len(triangles), 1, 2), np.nan)], axis=1)
    return uv, material, tuple(FileMaterial(**look) for look in looks)
