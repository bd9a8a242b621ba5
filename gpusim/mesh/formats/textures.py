"""What OBJ and glTF files say of how their faces look: texture coordinates, pictures, colours."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from gpusim.arrays.array_types import Float, Int
from gpusim.errors import InputError
from gpusim.field_summary import field_summary
from gpusim.files.input_file import InputFile, read_input
from gpusim.mesh.file_content.text import fail, numbers, statements
from gpusim.mesh.formats.gltf.base_colors import textured_gltf
from gpusim.mesh.formats.obj import ObjFile, read_obj
from gpusim.mesh.formats.surfaces import welded

TEXTURED_SUFFIXES = (".obj", ".glb", ".gltf")


@dataclass(frozen=True)
class FileMaterial:
    """A named material: its ``color`` (grey, or red, green, blue; linear), by which its picture, if
    it has one, is multiplied. Names needn't differ.

    ``picture`` is a file, its bytes read. ``missing``: a picture or library of materials that isn't
    there, or the material itself, ``newmtl …``.
    ``wrap``: how it goes on beyond its sides, along u and v, as of `gpusim.surface.texture`.
    """

    name: str
    color: float | tuple[float, float, float] = (0.8, 0.8, 0.8)
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

    points: Float
    faces: Int
    uv: Float
    material: Int
    materials: tuple[FileMaterial, ...]
    __repr__ = field_summary


def read_textured(path: str | os.PathLike[str] | InputFile) -> TexturedSurface:
    """A surface of an OBJ or glTF file with its texture coordinates and materials.

    An OBJ's materials are those of its ``mtllib`` beside it: ``Kd``, by which its ``map_Kd`` is
    multiplied, with the options -s, -o and -clamp; others are refused. A glTF's are the base
    colours, by which vertices' colours are multiplied, and their textures.

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
    if file.suffix == ".obj":
        content = read_obj(file)
        if content.fault:
            raise InputError(content.fault)
        points, corners = content.points, content.faces
        uv, material, materials = _obj(file, content)
    else:
        points, corners, triangles, material, looks = textured_gltf(file)
        materials = tuple(FileMaterial(**look) for look in looks)
        uv = np.concatenate([triangles, np.full((len(triangles), 1, 2), np.nan)], axis=1)
    points, faces, number = welded(str(file.path), points, corners)
    return TexturedSurface(points, faces, uv[number], material[number], materials)


def _obj(file: InputFile, content: ObjFile) -> tuple[Float, Int, tuple[FileMaterial, ...]]:
    """Texture coordinates, material of each face, and materials, as of `TexturedSurface`."""
    library: dict[str, _Look] = {}
    absent = ""
    for names in content.libraries:
        for name in [names] if _name_beside(file, names) else names.split():
            path = _name_beside(file, name)
            absent = absent or ("" if path else name)
            library |= _library(file.beside(path, "materials")) if path else {}
    uv, materials = content.uv.copy(), []
    for number, name in enumerate(content.materials):
        look = library.get(name) or _Look({"missing": absent or f"newmtl {name}"})
        of_it = content.material == number
        uv[of_it] = uv[of_it] * look.scale + look.offset
        materials.append(FileMaterial(name, **look.fields))
    return uv, content.material, tuple(materials)


@dataclass
class _Look:
    """The fields of a `FileMaterial`, and what texture coordinates are multiplied by and moved."""

    fields: dict[str, Any] = field(default_factory=dict)
    scale: tuple[float, float] = (1.0, 1.0)
    offset: tuple[float, float] = (0.0, 0.0)


def _name_beside(file: InputFile, name: str) -> str:
    """The name of a file beside it, also with separators of Windows; "" if none is there."""
    names = name, name.strip("\"'"), name.strip("\"'").replace("\\", "/")
    return next((one for one in names if os.path.isfile(file.path.parent / one)), "")


def _library(mtl: InputFile) -> dict[str, _Look]:
    """The materials of an OBJ's .mtl, by name."""
    looks: dict[str, _Look] = {}
    look = _Look()
    for line, keyword, rest in statements(mtl, "materials"):
        keyword = keyword.lower()
        if keyword == "newmtl":
            look = looks[rest] = _Look()
        elif keyword == "kd":
            words = rest.split("#")[0].split()
            color = numbers(mtl, words * 3 if len(words) == 1 else words, 3, line)
            if not all(0.0 <= value <= 1.0 for value in color):
                fail(mtl, f"got Kd {rest[:60]}; expected red, green, blue from 0 to 1", line)
            look.fields["color"] = tuple(color)
        elif keyword == "map_kd":
            look.fields.setdefault("color", (1.0, 1.0, 1.0))
            name = _picture_name(mtl, rest, look, line)
            path = _name_beside(mtl, name)
            if not name:
                fail(mtl, "map_Kd without a name; expected a picture's", line)
            look.fields |= {"picture": mtl.beside(path, "a picture")} if path else {"missing": name}
    return looks


def _picture_name(mtl: InputFile, rest: str, look: _Look, line: int) -> str:
    """The picture's name behind the options of `map_Kd`, which go to ``look``."""
    while match := re.match(r"(-[a-z]+)\s+(?=\S)", rest):
        option, rest = match[1], rest[match.end() :]
        values: list[str] = []
        most = {"-s": 3, "-o": 3, "-t": 3, "-mm": 2}.get(option, 1)
        while len(values) < most and (word := re.match(_ARGUMENT[most > 1], rest)):
            values.append(word[1])
            rest = rest[word.end() :]
        u, v, *_ = [*map(float, values), *(1.0, 1.0)[len(values) :]] if most > 1 else (0.0, 0.0)
        finite = bool(values) and bool(np.isfinite([u, v]).all())
        if option == "-s" and finite:
            look.scale = u, v
        elif option == "-o" and finite:
            look.offset = u, v if len(values) > 1 else 0.0
        elif option == "-clamp" and values == ["on"]:
            look.fields["wrap"] = "clamp", "clamp"
        elif not (
            option in ("-blendu", "-blendv", "-texres")
            or (option in ("-clamp", "-cc") and values == ["off"])
            or (option == "-mm" and (u, v) == (0.0, 1.0))
        ):
            fail(mtl, f"got option {option} {' '.join(values)}; expected -s, -o or -clamp", line)
    return rest


# a number, or a word, with something behind it
_ARGUMENT = (re.compile(r"(\S+)\s+"), re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s+"))
