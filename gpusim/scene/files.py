"""Files that a scene names, meshes and results: found beside it, and known by their content."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gpusim.errors import Fault, InputError
from gpusim.files.file_series import SERIES_SUFFIXES, read_series
from gpusim.files.includes import included_files
from gpusim.files.input_file import InputFile, read_input
from gpusim.scene.faults.faults import unread
from gpusim.scene.faults.key_path import dotted
from gpusim.scene.faults.line_numbers import Keys

__all__ = ["find_files"]

Found = list[tuple[Keys, Fault]]


def find_files(
    document: dict[str, Any], folder: Path, known: Mapping[str, str]
) -> tuple[Found, tuple[tuple[str, str], ...]]:
    """Make the files in ``document`` absolute, in place; relative ones lie in ``folder``.

    Returns faults for files that can't be read, or aren't what is ``known`` of them, and (path,
    SHA-256) of all, with those that they name. A mesh with
    ``file`` and no ``builder`` gets the builder "file", a prop without a type the type "plate".
    What isn't of the right shape is left to the schema.
    """
    found: Found = []
    hashes = _Hashes(known)
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
    return found, tuple(sorted(hashes.found.items()))


def _pictures(
    thing: dict[str, Any], keys: Keys, folder: Path, found: Found, hashes: _Hashes
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
    hashes: _Hashes,
) -> None:
    """Make the file of a table absolute and enter its hash, or its fault."""
    key = str(keys[-1])
    if not table[key]:
        return
    path = folder.absolute() / table[key]
    try:
        hashes.enter(path, expected)
    except InputError as error:
        found.append((keys, unread(error, dotted(keys), path)))
    table[key] = str(path)


class _Hashes:
    """SHA-256 by path of files that were ``found``, with those that they name."""

    def __init__(self, known: Mapping[str, str]) -> None:
        self.known, self.found = known, dict[str, str]()

    def enter(self, path: Path, expected: str) -> None:
        """Raises InputError for a file, or one that it names, that can't be read or has changed."""
        if str(path) in self.found:
            return
        file = read_input(path, expected, self.known.get(str(path)))
        self.found[str(path)] = file.sha256
        for included in included_files(file):
            key = str(included.path)
            self.found[key] = read_input(included, sha256=self.known.get(key)).sha256
        for name in _series(file):
            try:
                self.enter(name, expected)
            except InputError as error:
                text = str(error).removeprefix(f"{name}: ")
                raise InputError(f"{path}: names {name.name}, {text}") from None


def _series(file: InputFile) -> list[Path]:
    """The files that a series names."""
    return [path for _, path in read_series(file)] if file.suffix in SERIES_SUFFIXES else []
