"""Wavefront's OBJ: faces of all groups, their texture coordinates and the names of their materials.

What would change the surface and isn't read (curves, free-form surfaces) is refused with its line.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gpusim.arrays.array_types import Float, Int, Long
from gpusim.files.input_file import InputFile
from gpusim.mesh.file_content.text import fail, numbers, statements, whole_numbers
from gpusim.mesh.polygons import cut_polygons

# what gives groups, looks and curves to an OBJ, and neither points nor faces
_HARMLESS = {"vn", "g", "o", "s", "l", "p", "mg", "lod"}


@dataclass(frozen=True, eq=False)
class ObjFile:
    """Points (P, 3), faces (F, 4), -1 as a triangle's last corner, and how they look.

    ``uv`` (F, 4, 2): texture coordinates of their corners, NaN where there are none. ``material``
    (F,): which of the ``materials`` each has, -1 none. ``libraries``: what `mtllib` lines say.
    ``fault``: what is wrong with the texture coordinates, if anything is.
    """

    points: Float
    faces: Long
    uv: Float
    material: Int
    materials: tuple[str, ...]
    libraries: tuple[str, ...]
    fault: str


def read_obj(file: InputFile) -> ObjFile:
    """All of a file but groups and normals. Raises InputError with the line."""
    points: list[Sequence[float]] = []
    places: list[Sequence[float]] = [[np.nan, np.nan]]
    corners: list[int] = []
    texture: list[int] = []
    sizes: list[int] = []
    material: list[int] = []
    names: dict[str, int] = {}
    libraries: list[str] = []
    now, fault = -1, ""
    for line, keyword, rest in statements(file, "an OBJ"):
        words = rest.split("#")[0].split()
        if keyword == "v":
            values = numbers(file, words, len(words), line)
            if len(values) not in (3, 4, 6, 7) or (len(values) in (4, 7) and values[3] != 1.0):
                fail(file, f"got v {' '.join(words)[:60]}; expected x, y, z", line)
            points.append(values[:3])
        elif keyword == "vt":
            u, v, *_ = [*numbers(file, words, len(words), line), 0.0, np.nan]
            if not (1 <= len(words) <= 3 and np.isfinite([u, v]).all()):
                fail(file, f"got vt {' '.join(words)[:60]}; expected u and v", line)
            places.append((u, v))
        elif keyword == "f":
            if len(words) < 3:
                fail(file, f"a face of {len(words)} corners; expected at least 3", line)
            of_face = [(word + "//").split("/", 2)[:2] for word in words]
            # a negative number counts from the last one so far
            corners += _places(file, [point for point, _ in of_face], len(points), line)
            chosen = whole_numbers(file, [uv or "0" for _, uv in of_face], len(words), line)
            texture += [n if n >= 0 else len(places) + n or -1 for n in chosen]
            if not all(0 <= n < len(places) for n in texture[-len(words) :]):
                fault = fault or (f"{file.path}:{line}: a face names vt {max(chosen)}; "
                                  f"got {len(places) - 1} so far")  # fmt: skip
            sizes.append(len(words))
            material.append(now)
        elif keyword == "usemtl":
            now = names.setdefault(rest, len(names))
        elif keyword == "mtllib":
            libraries.append(rest)
        elif keyword not in _HARMLESS:
            fail(file, f"got {keyword[:40]!r}; expected v, f, vt, vn, g, o, s, usemtl …", line)
    place = np.array(points).reshape(-1, 3)
    rows, source = cut_polygons(
        str(file.path), place, np.array(corners, np.int64), np.array(sizes, np.int64)
    )
    found = np.array(places)[np.array(texture, np.int64) if not fault else 0 * np.array(corners)]
    uv = np.where(rows[..., None] < 0, np.nan, found[np.maximum(rows, 0)])
    faces = np.where(rows < 0, -1, np.array(corners, np.int64)[np.maximum(rows, 0)])
    return ObjFile(
        place,
        faces,
        uv,
        np.array(material, np.int32)[source],
        tuple(names),
        tuple(libraries),
        fault,
    )


def _places(file: InputFile, words: Sequence[str], count: int, line: int) -> list[int]:
    """Which of the points, from 0, are named by numbers from 1, or from -1 back from the last."""
    chosen = whole_numbers(file, words, len(words), line)
    places = [number - 1 if number > 0 else count + number for number in chosen]
    for number, place in zip(chosen, places, strict=True):
        if number == 0 or place < 0:
            fail(file, f"a face names point {number}; expected points that are there: from 1, or "
                       "from -1 down", line)  # fmt: skip
    return places
