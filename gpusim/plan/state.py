"""``state.json`` of an output folder: which stage results lie there, and what they depend on."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from gpusim.errors import InputError
from gpusim.files.input_file import InputFile, open_input, read_input
from gpusim.files.output_folder import delete, inside

__all__ = ["StateFile", "earlier_programs", "variant_folder"]

_NAME = "state.json"
_VERSION = 2
_DAMAGE = (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError)

Facts = Mapping[str, Any]
"""``bytes`` and ``sha256`` of a file, all of it."""


@dataclass(frozen=True)
class _Entry:
    """A stage's result: its files by name, and what the report says of it."""

    stage: str
    files: Mapping[str, Facts]
    notes: Mapping[str, Any]

    def content(self) -> dict[str, Any]:
        """As it is kept; ``check`` tells whether anything else has been."""
        plain = {"stage": self.stage, "files": dict(self.files), "notes": dict(self.notes)}
        text = json.dumps(plain, sort_keys=True)
        return {**plain, "check": hashlib.sha256(text.encode()).hexdigest()}

    @staticmethod
    def of(content: Mapping[str, Any], folder: Path) -> _Entry:
        """The inverse of `content`. Raises ValueError, KeyError or TypeError for damage, and for
        files that aren't in ``folder``."""
        files = {
            str(name): {"bytes": int(facts["bytes"]), "sha256": str(facts["sha256"])}
            for name, facts in content["files"].items()
        }
        entry = _Entry(str(content["stage"]), files, dict(content["notes"]))
        if entry.content()["check"] != content["check"]:
            raise ValueError(f"what it says of {entry.stage} was changed")
        for name in files:
            inside(folder, name)
        return entry


class StateFile:
    """The results that an output folder holds, by stage key.

    ``programs``: what its pictures have asked the device for, as plain data. ``folder``
    needn't exist; a ``state.json`` that is missing, of another version or damaged
    holds nothing, so everything is run again. ``problem`` then says why. So is a stage whose entry
    is damaged.
    """

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        self.folder = Path(folder)
        self.problem = ""
        self.programs: list[Any] = []
        self._entries: dict[str, _Entry] = {}
        self._faults: dict[str, str] = {}
        path = self.folder / _NAME
        if not os.path.exists(path):
            return
        try:
            content = json.loads(read_input(path, "the state of a run").text())
            if content["version"] != _VERSION:
                self.problem = f"{_NAME} is of version {content['version']!r:.20}"
                return
            for key, entry in content["stages"].items():
                try:
                    self._entries[key] = _Entry.of(entry, self.folder)
                except _DAMAGE as error:
                    self._faults[key] = f"{_NAME} is damaged ({error})"
            self.programs = list(content.get("programs", ()))
        except _DAMAGE as error:
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

    def notes(self, key: str) -> Mapping[str, Any] | None:
        """What was recorded with a stage's result; None if there is none."""
        entry = self._entries.get(key)
        return None if entry is None else entry.notes

    def fault(self, key: str, stage: str) -> str | None:
        """None if this key's result lies there unchanged; else why ``stage`` has to run."""
        entry = self._entries.get(key)
        if entry is None:
            earlier = any(old.stage == stage for old in self._entries.values())
            reason = self.problem or self._faults.get(key)
            return reason or ("its inputs changed" if earlier else "not made yet")
        if not entry.files:
            return f"{_NAME} names no files of it"
        for name, facts in entry.files.items():
            path = inside(self.folder, name)
            if not path.is_file():
                return f"{name} is gone"
            if not _is(path, facts):
                return f"{name} was changed"
        return None

    def read(self, path: Path) -> InputFile:
        """A recorded file, as it was when it was recorded.

        Raises InputError if no stage has recorded it, or if it isn't the same any more.
        """
        return read_input(path, "a result of an earlier run", self._facts_of(path)["sha256"])

    def open(self, path: Path) -> BinaryIO:
        """As `read`, a stream of a file that may be too large to be read whole."""
        facts = self._facts_of(path)
        stream = open_input(path, "a result of an earlier run")
        if hashlib.file_digest(stream, "sha256").hexdigest() != facts["sha256"]:
            stream.close()
            raise InputError(f"{path}: was changed; expected the result of an earlier run")
        stream.seek(0)
        return stream

    def drop(self, key: str, reason: str) -> None:
        """Forget a result that turned out to be damaged; ``fault`` then says why. Its files stay
        until they are written anew."""
        self._entries.pop(key, None)
        self._faults[key] = reason

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
            for name in self._delete(old, needed):
                kept.append(f"{name} is of an earlier scene ({old.stage}) and was changed since")
        self._save()
        return kept

    def record(
        self,
        stage: str,
        key: str,
        files: Iterable[str | os.PathLike[str]],
        notes: Mapping[str, Any] | None = None,
    ) -> None:
        """Enter the files of a finished stage (inside the folder) and what is said of it; save.

        Older entries that wrote one of the same files, or belong to the same stage, are dropped:
        their result is no longer there. What else they wrote (a step that the scene no longer has)
        is deleted, unless somebody has changed it. Raises InputError for a file outside the folder
        or absent.
        """
        entry: dict[str, Facts] = {}
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
            self._delete(self._entries[other], needed)
        # one step: a thread may be reading
        self._entries = kept | {key: _Entry(stage, entry, json.loads(json.dumps(notes or {})))}
        self._faults.pop(key, None)
        self._save()

    def add_programs(self, programs: Iterable[Any]) -> None:
        """Keep with the next stage's result what the device was asked for, so that the next run can
        have it ready."""
        plain = json.loads(json.dumps(list(programs), default=float))
        # threads ask in any order, which is no part of the result
        self.programs = sorted(
            [*self.programs, *(one for one in plain if one not in self.programs)], key=json.dumps
        )

    def _facts_of(self, path: Path) -> Facts:
        name = path.relative_to(self.folder).as_posix()
        for entry in self._entries.values():
            if name in entry.files:
                return entry.files[name]
        raise InputError(f"{path}: not recorded; expected the result of an earlier run")

    def _delete(self, old: _Entry, needed: Iterable[str]) -> list[str]:
        """Delete the files of a result that aren't needed; returns those that were changed."""
        changed = []
        for name, facts in old.files.items():
            path = inside(self.folder, name)
            if name in needed or not path.is_file():
                continue
            if _is(path, facts):
                delete(self.folder, name)
            else:
                changed.append(name)
        return changed

    def _save(self) -> None:
        from gpusim.files.atomic_files import write_text  # the planner reads only and stays quick

        # in an order of their own: a run that was killed and taken up again says the same
        by_stage = sorted(self._entries.items(), key=lambda item: (item[1].stage, item[0]))
        stages = {key: entry.content() for key, entry in by_stage}
        content = {"version": _VERSION, "stages": stages, "programs": self.programs}
        write_text(inside(self.folder, _NAME), json.dumps(content, indent=1))


def variant_folder(out: Path, name: str) -> Path:
    """Where the results of a variant lie."""
    return inside(out, "variants", name)


def earlier_programs(out: Path) -> list[Any]:
    """What the last run into ``out`` asked the device for, or one of its variants; [] for none."""
    for folder in (out, *sorted((out / "variants").glob("*"))):
        programs = StateFile(folder).programs
        if programs:
            return programs
    return []


def _facts(path: Path) -> Facts:
    with open_input(path) as stream:
        digest = hashlib.file_digest(stream, "sha256").hexdigest()
        return {"bytes": stream.tell(), "sha256": digest}


def _is(path: Path, facts: Facts) -> bool:
    """Whether a file is the one that was recorded; its size tells most others at once."""
    try:
        return path.stat().st_size == facts["bytes"] and _facts(path) == facts
    except (OSError, InputError):  # it can't be read
        return False
