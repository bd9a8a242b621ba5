"""Files that a scene names, meshes and results: found beside it, and known by their content."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

from gpusim.errors import Fault, InputError
from gpusim.includes import INCLUDING_SUFFIXES, included_files
from gpusim.input_file import read_input
from gpusim.series import SERIES_SUFFIXES, read_series

from .faults import shown
from .lines import Keys
from .path import dotted

__all__ = ["find_files"]

Found = list[tuple[Keys, Fault]]


def find_files(document: dict[str, Any], folder: Path) -> tuple[Found, tuple[tuple[str, str], ...]]:
    """Make the files in ``document`` absolute, in place; relative ones lie in ``folder``.

    Returns faults for files that can't be read, and (path, SHA-256) of the others. A mesh with
    ``file`` and no ``builder`` gets the builder "file", a prop without a type the type "plate".
    What isn't of the right shape is left to the schema.
    """
    found: Found = []
    hashes: dict[str, str] = {}
    bodies = document.get("body")
    for index, body in enumerate(bodies if isinstance(bodies, list) else ()):
        if not isinstance(body, dict):
            continue
        _pictures(body, ("body", index), folder, found, hashes)
        for key, expected in (("mesh", "a mesh or CAD file"), ("field", "a result file")):
            table = body.get(key)
            if not isinstance(table, dict) or not isinstance(table.get("file"), str):
                continue
            if key == "mesh":
                table.setdefault("builder", "file")
                if table["builder"] != "file":
                    continue
            _enter(table, ("body", index, key, "file"), folder, expected, found, hashes)
    props = document.get("prop")
    for index, prop in enumerate(props if isinstance(props, list) else ()):
        if isinstance(prop, dict):
            _pictures(prop, ("prop", index), folder, found, hashes)
            prop.setdefault("type", "plate")
            if prop["type"] == "mesh" and isinstance(prop.get("file"), str):
                _enter(prop, ("prop", index, "file"), folder, "a file of faces or a mesh", found,
                       hashes)  # fmt: skip
    cameras = document.get("camera")
    for index, camera in enumerate(cameras if isinstance(cameras, list) else ()):
        if isinstance(camera, dict) and isinstance(camera.get("calibration"), str):
            _enter(camera, ("camera", index, "calibration"), folder, "a calibration file", found,
                   hashes)  # fmt: skip
    lights = document.get("light")
    for index, light in enumerate(lights if isinstance(lights, list) else ()):
        if isinstance(light, dict) and isinstance(light.get("file"), str):
            _enter(light, ("light", index, "file"), folder, "a picture of radiances", found, hashes)
    return found, tuple(sorted(hashes.items()))


def _pictures(
    thing: dict[str, Any], keys: Keys, folder: Path, found: Found, hashes: dict[str, str]
) -> None:
    """The bitmaps that a body or prop is painted with."""
    paints = thing.get("paint")
    for place, paint in enumerate(paints if isinstance(paints, list) else ()):
        if isinstance(paint, dict) and isinstance(paint.get("file"), str):
            _enter(paint, (*keys, "paint", place, "file"), folder, "a PNG or TIFF", found, hashes)


def _enter(
    table: dict[str, Any],
    keys: Keys,
    folder: Path,
    expected: str,
    found: Found,
    hashes: dict[str, str],
) -> None:
    """Make the file of a table absolute and enter its hash, or its fault."""
    key = str(keys[-1])
    if not table[key]:
        return
    path = folder.absolute() / table[key]
    if problem := _hash(path, hashes):
        found.append((keys, Fault(dotted(keys), problem, shown(str(path)), expected)))
    table[key] = str(path)


def _hash(path: Path, hashes: dict[str, str]) -> str:
    """Enter the hash of a file and of the files that it names; returns the problem, or ""."""
    if not path.is_file():
        return "is a folder" if path.is_dir() else "not found"
    try:
        with path.open("rb") as stream:
            hashes[str(path)] = hashlib.file_digest(stream, "sha256").hexdigest()
        if path.suffix.lower() in INCLUDING_SUFFIXES:
            for one in included_files(read_input(path)):
                hashes[str(one.path)] = one.sha256
        if path.suffix.lower() in SERIES_SUFFIXES:
            for _, file in read_series(path):
                if problem := _hash(file, hashes):
                    return f"names {file.name}, {problem}"
    except OSError as error:
        return f"unreadable ({error.strerror})"
    except InputError as error:
        return str(error)
    return ""
