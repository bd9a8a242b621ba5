"""Files that name one mesh file per time: ParaView's .pvd and .series. Read without numerics."""

from __future__ import annotations

import json
from itertools import pairwise
from os import PathLike
from pathlib import Path
from xml.etree import ElementTree

from gpusim.errors import InputError
from gpusim.files.input_file import InputFile, read_input

__all__ = ["SERIES_SUFFIXES", "read_series"]

SERIES_SUFFIXES = (".pvd", ".series")


def read_series(path: str | PathLike[str] | InputFile) -> list[tuple[float, Path]]:
    """(time, file) of each step, in growing time; relative files lie beside ``path``.

    Raises InputError, naming the file: unreadable, empty, times that don't grow (of parallel
    pieces, for example, which share theirs).
    """
    source = read_input(path, "a list of files")
    file, text = source.path, source.text("a list of files")
    try:
        rows = _pvd(text) if source.suffix == ".pvd" else _json(text)
    except (
        ElementTree.ParseError,
        ValueError,
        ArithmeticError,
        LookupError,
        TypeError,
        RecursionError,
    ) as error:
        raise InputError(
            f"{file}: not a list of files with their times; got {type(error).__name__}: {error}; "
            "expected ParaView's .pvd or .series"
        ) from None
    steps = sorted((time, file.parent / name) for time, name in rows)
    if not steps:
        raise InputError(f"{file}: names no files; expected one per time")
    for (a, first), (b, second) in pairwise(steps):
        if not a < b:
            raise InputError(
                f"{file}: two files of time {b:g}; got {first.name} and {second.name}; expected "
                "one file per time, not pieces of a parallel run"
            )
    return steps


def _pvd(text: str) -> list[tuple[float, str]]:
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise ValueError("definitions of its own (DOCTYPE)")
    entries = ElementTree.fromstring(text).iter("DataSet")
    return [(float(entry.attrib["timestep"]), entry.attrib["file"]) for entry in entries]


def _json(text: str) -> list[tuple[float, str]]:
    return [(float(entry["time"]), str(entry["name"])) for entry in json.loads(text)["files"]]
