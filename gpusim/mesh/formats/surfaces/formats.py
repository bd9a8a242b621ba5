"""Points and faces of STL, OBJ, OFF and glTF files, as they are written there.

Each function takes a file and returns points (P, 3) float64 and faces (F, 4) int64, -1 as the last
corner of a triangle. All refuse, with the line where there are lines, what they don't know.

trimesh reads glTF alone: of the others it takes files that are cut off or say what it doesn't know,
and its triangles are the halves of quadrilaterals.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NoReturn

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.files.input_file import InputFile

__all__ = ["fail", "gltf", "obj", "off", "stl", "text_lines"]

Surface = tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]

# what gives groups, looks and curves to an OBJ, and neither points nor faces
_OBJ_HARMLESS = {"vt", "vn", "g", "o", "s", "usemtl", "mtllib", "l", "p", "mg", "lod"}


def fail(file: InputFile, problem: str, line: int | None = None) -> NoReturn:
    where = f":{line}" if line else ""
    raise InputError(f"{file.path}{where}: {problem}")


def text_lines(file: InputFile) -> Iterator[tuple[int, list[str]]]:
    """Number and words of every line that has some, without comments (#)."""
    for number, line in enumerate(file.data.decode("latin-1").splitlines(), start=1):
        words = line.split("#", 1)[0].split()
        if words:
            yield number, words


def stl(file: InputFile) -> Surface:
    """All solids of a text file, or the triangles of a binary one."""
    data = file.data
    count = int.from_bytes(data[80:84], "little")
    if len(data) == 84 + 50 * count:
        rows = np.frombuffer(data, np.uint8, offset=84).reshape(count, 50)
        corners = rows[:, 12:48].copy().view("<f4").astype(np.float64).reshape(-1, 3)
    elif data.lstrip()[:5].lower() == b"solid":
        corners = _stl_corners(file)
    else:
        fail(file, f"an STL of {len(data)} bytes; got {count} triangles, which need "
                   f"{84 + 50 * count}: cut off, or no STL")  # fmt: skip
    faces = np.arange(len(corners)).reshape(-1, 3)
    return corners, np.column_stack([faces, np.full(len(faces), -1)])


def _stl_corners(file: InputFile) -> npt.NDArray[np.float64]:
    corners: list[Sequence[float]] = []
    solids, open_facet = 0, False
    number = 0
    for number, line in enumerate(file.data.decode("latin-1").splitlines(), start=1):
        words = line.split()
        word = words[0].lower() if words else ""
        if word == "vertex":
            corners.append(_numbers(file, words[1:], 3, number))
        elif word in ("facet", "endfacet"):
            if open_facet == (word == "facet") or len(corners) % 3:
                fail(file, f"{word}; got {len(corners)} corners so far; expected 3 of each", number)
            open_facet = word == "facet"
        elif word in ("solid", "endsolid"):
            solids += 1 if word == "solid" else -1
        elif word not in ("", "outer", "endloop"):
            fail(file, f"got {word[:40]!r}; expected vertex, facet, solid …", number)
    if solids or open_facet:
        fail(file, "no endsolid: the file is cut off", number)
    return np.array(corners, dtype=np.float64).reshape(-1, 3)


def _numbers(file: InputFile, words: Sequence[str], count: int, line: int) -> list[float]:
    try:
        numbers = [float(word) for word in words]
    except ValueError as error:
        fail(file, f"{error}; expected {count} numbers", line)
    if len(numbers) != count:
        fail(file, f"got {len(numbers)} numbers; expected {count}", line)
    return numbers


def _whole(file: InputFile, words: Sequence[str], count: int, line: int) -> list[int]:
    numbers = _numbers(file, words, count, line)
    if not all(abs(number) < 2**53 and number == int(number) for number in numbers):
        fail(file, f"got {' '.join(words)[:60]}; expected whole numbers", line)
    return [int(number) for number in numbers]


def obj(file: InputFile) -> Surface:
    """Points and faces of all groups."""
    points: list[list[float]] = []
    faces: list[list[int]] = []
    before: list[str] = []
    for number, line in text_lines(file):
        words = before + line
        before = []
        if words[-1] == "\\":  # goes on
            before = words[:-1]
            continue
        if words[0] == "v":
            values = _numbers(file, words[1:], len(words) - 1, number)
            if len(values) not in (3, 4, 6, 7) or (len(values) in (4, 7) and values[3] != 1.0):
                fail(file, f"got v {' '.join(words[1:])[:60]}; expected x, y, z", number)
            points.append(values[:3])
        elif words[0] == "f":
            first = [word.split("/")[0] for word in words[1:]]
            corners = _whole(file, first, len(first), number)
            # a negative number counts from the last point so far
            places = [corner - 1 if corner > 0 else len(points) + corner for corner in corners]
            if 0 in corners:
                fail(file, "a face names point 0; expected 1 and above, or below 0", number)
            faces.append(_padded(file, places, number))
        elif words[0] not in _OBJ_HARMLESS:
            fail(file, f"got {words[0][:40]!r}; expected v, f, vt, vn, g, o, s, usemtl …", number)
    return np.array(points).reshape(-1, 3), np.array(faces, dtype=np.int64).reshape(-1, 4)


def _padded(file: InputFile, corners: list[int], line: int | None) -> list[int]:
    if len(corners) not in (3, 4) or min(corners) < 0:
        fail(file, f"a face of {len(corners)} corners, {corners[:6]}; expected 3 or 4 points that "
                   "are there (triangulate the surface first)", line)  # fmt: skip
    return [*corners, -1][:4]


def off(file: InputFile) -> Surface:
    """OFF and COFF (colours are passed over)."""
    lines = text_lines(file)
    number, words = next(lines, (1, [""]))
    kind = words.pop(0)
    if kind not in ("OFF", "COFF"):
        fail(file, f"got {kind[:40]!r}; expected OFF or COFF", number)
    if not words:
        number, words = next(lines, (number, []))
    points, faces = _whole(file, words[:2], 2, number)
    rows = list(lines)
    if min(points, faces) < 0 or len(rows) < points + faces:
        fail(file, f"{points} points and {faces} faces; got {len(rows)} lines", number)
    if len(rows) > points + faces:
        fail(file, "more lines than its counts say", rows[points + faces][0])
    width = 3 if kind == "OFF" else 7
    place = [_numbers(file, words, width, line)[:3] for line, words in rows[:points]]
    corners = []
    for line, words in rows[points:]:
        (size,) = _whole(file, words[:1], 1, line)
        corners.append(_padded(file, _whole(file, words[1 : 1 + size], size, line), line))
    return np.array(place).reshape(-1, 3), np.array(corners, dtype=np.int64).reshape(-1, 4)


def gltf(file: InputFile) -> Surface:
    """All meshes of a glTF where its nodes place them; a .gltf holds its buffers itself."""
    import trimesh  # takes a second, for one format

    kind = file.path.suffix.lower()[1:]
    try:
        scene = trimesh.load_scene(file.stream(), file_type=kind, process=False)
        placed = [mesh for mesh in scene.dump() if isinstance(mesh, trimesh.Trimesh)]
        found: Any = trimesh.util.concatenate(placed) if placed else trimesh.Trimesh()
        points, faces = np.asarray(found.vertices), np.asarray(found.faces, np.int64)
    except (ValueError, KeyError, IndexError, TypeError, AttributeError, MemoryError) as error:
        said = f"{type(error).__name__}: {' '.join(str(error).split())[:200]}"
        fail(file, f"damaged, no glTF, or with buffers in other files (save as .glb); got {said}")
    return points.reshape(-1, 3), np.column_stack([faces.reshape(-1, 3), np.full(len(faces), -1)])
