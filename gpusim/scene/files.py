"""Files that a scene names, meshes and results: found beside it, and known by their content."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gpusim.errors import Fault, InputError
from gpusim.files.input_file import (
    SERIES_SUFFIXES,
    InputFile,
    included_files,
    read_input,
    read_series,
)
from gpusim.scene.faults.faults import unread
from gpusim.scene.faults.key_paths import Keys, dotted
from gpusim.scene.tables.table import tables_of

Found = list[tuple[Keys, Fault]]


def find_files(
    document: dict[str, Any], folder: Path, known: Mapping[str, str], found: bool = False
) -> tuple[Found, tuple[tuple[str, str], ...]]:
    """Make the files in ``document`` absolute, in place; relative ones lie in ``folder``.

    Returns faults for files that can't be read, or aren't what is ``known`` of them, and (path,
    SHA-256) of all, with those that they name. A mesh with
    ``file`` and no ``builder`` gets the builder "file", a prop without a type the type "plate".
    What isn't of the right shape is left to the schema. ``found``: all that is ``known`` is what
    there is, and nobody looks again.
    """
    if found:
        return [], tuple(known.items())
    files = _Files(folder, known)
    for index, body in tables_of(document, "body"):
        files.enter_pictures(body, ("body", index))
        for key, expected in (("mesh", "a mesh or CAD file"), ("field", "a result file")):
            table = body.get(key)
            if not isinstance(table, dict) or not isinstance(table.get("file"), str):
                continue
            if key == "mesh":
                table.setdefault("builder", "file")
                if table["builder"] != "file":
                    continue
            files.enter(table, ("body", index, key, "file"), expected)
    for index, prop in tables_of(document, "prop"):
        files.enter_pictures(prop, ("prop", index))
        prop.setdefault("type", "plate")
        if prop["type"] == "mesh":
            files.enter(prop, ("prop", index, "file"), "a file of faces or a mesh")
    analysis = document.get("analysis")
    ground = analysis.get("base_motion") if isinstance(analysis, dict) else None
    if isinstance(ground, dict):
        files.enter(ground, ("analysis", "base_motion", "file"), "a CSV file")
    for index, camera in tables_of(document, "camera"):
        files.enter(camera, ("camera", index, "calibration"), "a calibration file")
    for index, measure in tables_of(document, "measure"):
        if measure.get("calibration") != "true":
            files.enter(measure, ("measure", index, "calibration"), "a calibration file")
    for index, light in tables_of(document, "light"):
        files.enter(light, ("light", index, "file"), "a picture of radiances")
    return files.faults, tuple(sorted(files.hashes.items()))


class _Files:
    """SHA-256 by path of files that were found, with those that they name; and faults."""

    def __init__(self, folder: Path, known: Mapping[str, str]) -> None:
        self.folder, self.known = folder, known
        self.faults: Found = []
        self.hashes: dict[str, str] = {}

    def enter(self, table: dict[str, Any], keys: Keys, expected: str) -> None:
        """Make the file of a table, if it names one, absolute; enter its hash, or its fault."""
        key = str(keys[-1])
        if not isinstance(table.get(key), str) or not table[key]:
            return
        path = self.folder.absolute() / table[key]
        try:
            self._hash(path, expected)
        except InputError as error:
            self.faults.append((keys, unread(error, dotted(keys), path)))
        table[key] = str(path)

    def enter_pictures(self, painted: dict[str, Any], keys: Keys) -> None:
        """The bitmaps that a body or prop is painted with."""
        for place, paint in tables_of(painted, "paint"):
            self.enter(paint, (*keys, "paint", place, "file"), "a PNG or TIFF")

    def _hash(self, path: Path, expected: str) -> None:
        """Raises InputError for a file, or one that it names, that can't be read or has changed."""
        if str(path) in self.hashes:
            return
        file = read_input(path, expected, self.known.get(str(path)))
        self.hashes[str(path)] = file.sha256
        for included in included_files(file):
            key = str(included.path)
            self.hashes[key] = read_input(included, sha256=self.known.get(key)).sha256
        for name in _series(file):
            try:
                self._hash(name, expected)
            except InputError as error:
                text = str(error).removeprefix(f"{name}: ")
                raise InputError(f"{path}: names {name.name}, {text}") from None


def _series(file: InputFile) -> list[Path]:
    """The files that a series names."""
    return [path for _, path in read_series(file)] if file.suffix in SERIES_SUFFIXES else []
