"""The folder of a data set: files that are written once, and a log that says what they hold."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

from gpusim.files.atomic_files import atomic_stream, clean_leftovers
from gpusim.files.output_folder import delete, inside
from gpusim.graph.folder import INNER
from gpusim.graph.log import Log, read_log
from gpusim.graph.store import DAMAGED

Content = bytes | Callable[[BinaryIO], object]
NAME = "dataset"


class DatasetFolder:
    """Units of files in ``out``/dataset: an item, a shard of items, or what tells about them all.

    A unit that lies there with the digest and the sizes with which it was written isn't written
    again. ``root``: the folder. ``written``: how many units were.
    """

    def __init__(self, out: Path) -> None:
        self.root, self.written = inside(out, NAME), 0
        self._units: dict[str, tuple[str, dict[str, int]]] = {}
        logs = inside(out, INNER, NAME)
        paths = sorted(logs.glob("*.log"))
        for line in (line for path in paths for line in read_log(path)[0]):
            with suppress(*DAMAGED):
                sizes = {str(file): int(size) for file, size in line["files"].items()}
                self._units[str(line["unit"])] = str(line["digest"]), sizes
        last = int(paths[-1].stem) if paths else 0
        self._log = Log(logs / f"{last + 1:06d}.log")
        clean_leftovers(self.root)

    def holds(self, unit: str, digest: str) -> bool:
        """Whether a unit lies there as it was written."""
        known, files = self._units.get(unit, ("", {}))
        return known == digest and all(self._size(file) == files[file] for file in files)

    def put(self, unit: str, digest: str, files: Mapping[str, Content]) -> None:
        """Write the files of a unit, and delete those that it had and has no more."""
        before = self._units.get(unit, ("", {}))[1]
        for file, content in files.items():
            with atomic_stream(inside(self.root, file)) as stream:
                if isinstance(content, bytes):
                    stream.write(content)
                else:
                    content(stream)
        self._enter(unit, digest, {file: self._size(file) for file in files})
        for file in before.keys() - files.keys():
            delete(self.root, file)
        self.written += 1

    def keep(self, units: Mapping[str, object]) -> None:
        """Delete all other units, and end."""
        present = {file for unit in units for file in self._units[unit][1]}
        for unit in [unit for unit in self._units if unit not in units]:
            for file in self._units[unit][1].keys() - present:
                delete(self.root, file)
            if self._units[unit][1]:
                self._enter(unit, "", {})
        self._log.close()

    def _enter(self, unit: str, digest: str, sizes: dict[str, int]) -> None:
        self._log.append({"unit": unit, "digest": digest, "files": sizes})
        self._units[unit] = digest, sizes

    def _size(self, file: str) -> int:
        try:
            return inside(self.root, file).stat().st_size
        except FileNotFoundError:
            return -1
