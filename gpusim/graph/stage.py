"""A stage: a function of what its key names, and the records that it makes.

A stage is worked off record by record (frames, poses, measures; most stages have one). A record is
either a value in memory, made when somebody needs it, or files and notes, which are kept.
"""

from __future__ import annotations

import hashlib
import importlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

Which = Callable[[int], Sequence[int]]
"""The records of a need that a record needs."""
Output = bytes | Path | Callable[[Path], object]
"""A file's content, a file that `Inputs.new_file` has named, or what writes one at a path (whose
ending is that of the result's name)."""


def same(record: int) -> Sequence[int]:
    """The record of the same number."""
    return (record,)


def first(record: int) -> Sequence[int]:
    """Record 0 alone, as of stages that have no other."""
    return (0,)


every: Which | None = None
"""All records, however many."""


@dataclass(frozen=True, eq=False)
class Stage:
    """What is made of what.

    name : "radiance/front"; part of every key.
    work : "module:function", called with (``argument``, inputs, session); imported when it is run.
    argument : all that the function gets beside its inputs.
    parts : digests of what ``argument`` holds, by the name that people know it under.
    needs : names of stages, and which of their records (None: all).
    rows : of each record, plain data that it depends on, and no other record need.
    keeps : whether a record is files and notes; else it is a value in memory.
    public : the stage as people know it that a record belongs to ("render/front/0001").
    on_device : whether it works on the device; the others are worked off beside it.
    early : whether it is made before anything is written: its faults leave no trace.
    """

    name: str
    work: str
    argument: Any = None
    parts: Mapping[str, str] = field(default_factory=dict)
    needs: Mapping[str, Which | None] = field(default_factory=dict)
    rows: Sequence[Any] = (None,)
    keeps: bool = False
    public: Callable[[int], str] = lambda record: ""
    on_device: bool = False
    early: bool = False

    def function(self) -> Callable[..., Any]:
        """What is called, imported now."""
        module, name = self.work.split(":")
        work: Callable[..., Any] = getattr(importlib.import_module(module), name)
        return work


@dataclass(frozen=True)
class StageResult:
    """A record of a stage that keeps: its ``files`` by their names in the output folder, ``notes``
    as plain data, and a few words for who waits.

    What nobody is to see has a dot before its name. ``holds``: needs whose files needn't be kept
    twice, because one of these files (its name) has all that is in theirs, under the same paths.
    """

    files: Mapping[str, Output] = field(default_factory=dict)
    notes: Mapping[str, Any] = field(default_factory=dict)
    words: str = ""
    holds: Mapping[str, str] = field(default_factory=dict)


plain_text: Callable[[Any], str] = json.JSONEncoder(sort_keys=True, separators=(",", ":")).encode
"""Plain data as a text that is the same for what is the same."""


def digest(value: Any) -> str:
    """SHA-256 of plain data."""
    return hashlib.sha256(plain_text(value).encode()).hexdigest()
