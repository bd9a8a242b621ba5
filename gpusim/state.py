"""``state.json`` of an output folder: which stage results lie there, and what they depend on."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

from gpusim.errors import InputError

__all__ = ["StateFile", "earlier_programs", "variant_folder"]

_NAME = "state.json"
_VERSION = 1
# larger files are told apart by their size and parts of them
_HASHED_UP_TO, _PARTS, _PART_BYTES = 64 << 20, 128, 128 << 10


@dataclass(frozen=True)
class _Entry:
    stage: str
    files: Mapping[str, Mapping[str, Any]]


class StateFile:
    """The results that an output folder holds, by stage key.

    ``programs``: what the run that wrote it has asked the device for, as plain data. ``folder``
    needn't exist; a ``state.json`` that is missing, of another version or damaged
    holds nothing, so everything is run again. ``problem`` then says why.
    """

    def __init__(self, folder: str | PathLike[str]) -> None:
        self.folder = Path(folder)
        self.problem = ""
        self.programs: list[Any] = []
        self._entries: dict[str, _Entry] = {}
        try:
            content = json.loads((self.folder / _NAME).read_text(encoding="utf-8"))
            if content["version"] != _VERSION:
                self.problem = f"{_NAME} is of version {content['version']}"
                return
            for key, entry in content["stages"].items():
                files = {str(name): dict(facts) for name, facts in entry["files"].items()}
                self._entries[key] = _Entry(str(entry["stage"]), files)
            self.programs = list(content.get("programs", ()))
        except (FileNotFoundError, NotADirectoryError):
            return
        except (
            OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError
        ) as error:  # fmt: skip
            self.problem = f"{_NAME} is damaged ({error})"
            self._entries = {}

    @property
    def begun(self) -> bool:
        """Whether an earlier run has left results."""
        return bool(self._entries)

    def files(self, key: str) -> tuple[Path, ...]:
        """The files recorded for a stage key; empty if there are none."""
        entry = self._entries.get(key)
        return () if entry is None else tuple(self.folder / name for name in entry.files)

    def fault(self, key: str, stage: str) -> str | None:
        """None if this key's result lies there unchanged; else why ``stage`` has to run."""
        entry = self._entries.get(key)
        if entry is None:
            earlier = any(old.stage == stage for old in self._entries.values())
            return self.problem or ("its inputs changed" if earlier else "not made yet")
        for name, facts in entry.files.items():
            path = self.folder / name
            if not path.is_file():
                return f"{name} is gone"
            if _facts(path) != facts:
                return f"{name} was changed"
        return None

    def retire(self, stages: Iterable[str]) -> list[str]:
        """Drop the results of stages that are no longer there, and delete their files.

        Files that somebody has changed are kept; returns a sentence for each.
        """
        current = set(stages)
        gone = {key: old for key, old in self._entries.items() if old.stage not in current}
        if not gone:
            return []
        self._entries = {key: old for key, old in self._entries.items() if key not in gone}
        needed = {name for old in self._entries.values() for name in old.files}
        kept = []
        for old in gone.values():
            for name, facts in old.files.items():
                path = self.folder / name
                if name in needed or not path.is_file():
                    continue
                if _facts(path) != facts:
                    kept.append(
                        f"{name} is of an earlier scene ({old.stage}) and was changed since"
                    )
                    continue
                path.unlink()
                if path.parent != self.folder and not any(path.parent.iterdir()):
                    path.parent.rmdir()
        self._save()
        return kept

    def record(self, stage: str, key: str, files: Iterable[str | PathLike[str]]) -> None:
        """Enter the files of a finished stage (inside the folder) and save.

        Older entries that wrote one of the same files, or belong to the same stage, are dropped:
        their result is no longer there. What else they wrote (a step that the scene no longer has)
        is deleted, unless somebody has changed it. Raises InputError for a file outside the folder
        or absent.
        """
        entry: dict[str, dict[str, Any]] = {}
        root = self.folder.resolve()
        for file in files:
            path = self.folder / file if not Path(file).is_absolute() else Path(file)
            if not path.is_file() or not path.resolve().is_relative_to(root):
                raise InputError(f"state of {stage}; got {file}; expected a file in {self.folder}")
            entry[path.resolve().relative_to(root).as_posix()] = _facts(path)
        kept = {
            other: old
            for other, old in self._entries.items()
            if old.stage != stage and not entry.keys() & old.files.keys()
        }
        needed = {name for old in kept.values() for name in old.files} | entry.keys()
        for other in self._entries.keys() - kept.keys():
            for name, facts in self._entries[other].files.items():
                path = root / name
                inside = path.resolve().is_relative_to(root)
                if name not in needed and inside and path.is_file() and _facts(path) == facts:
                    path.unlink()
        self._entries = kept
        self._entries[key] = _Entry(stage, entry)
        self._save()

    def note_programs(self, programs: Iterable[Any]) -> None:
        """Keep what a run asked the device for, so that the next one can have it ready."""
        noted = json.loads(json.dumps(list(programs), default=float))
        if noted and noted != self.programs:
            self.programs = noted
            self._save()

    def _save(self) -> None:
        from gpusim.export.files import write_text  # the planner reads only and stays quick

        stages = {key: {"stage": e.stage, "files": e.files} for key, e in self._entries.items()}
        content = {"version": _VERSION, "stages": stages, "programs": self.programs}
        text = json.dumps(content, indent=1)
        write_text(self.folder / _NAME, text)


def variant_folder(out: Path, name: str) -> Path:
    """Where the results of a variant lie."""
    return out / "variants" / name


def earlier_programs(out: Path) -> list[Any]:
    """What the last run into ``out`` asked the device for, or one of its variants; [] for none."""
    for folder in (out, *sorted(variant_folder(out, "").glob("*"))):
        programs = StateFile(folder).programs
        if programs:
            return programs
    return []


def _facts(path: Path) -> dict[str, Any]:
    """Size and SHA-256, of the largest files that of parts from the first byte to the last."""
    size = path.stat().st_size
    with path.open("rb") as stream:
        if size <= _HASHED_UP_TO:
            return {"bytes": size, "sha256": hashlib.file_digest(stream, "sha256").hexdigest()}
        parts = hashlib.sha256()
        for number in range(_PARTS):
            stream.seek((size - _PART_BYTES) * number // (_PARTS - 1))
            parts.update(stream.read(_PART_BYTES))
        return {"bytes": size, "sha256 of parts": parts.hexdigest()}
