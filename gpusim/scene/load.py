"""Reading a scene file."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any

from gpusim.errors import Fault, InputError, SceneError
from gpusim.files.input_file import InputFile, read_input
from gpusim.scene.faults.faults import unread
from gpusim.scene.faults.key_paths import key_lines
from gpusim.scene.faults.limits import document_fault, size_fault, text_fault

from .scene import Scene

__all__ = ["load_scene", "parse_value"]


def load_scene(
    path: str | PathLike[str] | InputFile, overrides: Mapping[str, Any] | None = None
) -> Scene:
    """Read, validate and resolve a TOML scene file.

    ``overrides`` maps dotted key paths to values ("solver.tolerance": 1e-9) and wins over the
    file. Raises SceneError that lists every fault: unreadable file, TOML syntax (with line),
    unknown or missing keys, wrong types and ranges, names and references that don't fit; or that
    says that the file is too large or too deeply nested for a scene.

    Examples
    --------
    >>> scene = gs.load_scene("bar.toml", {"solver.tolerance": 1e-4})
    >>> scene.name, scene.solver.tolerance
    ('bar', 0.0001)
    """
    place = path.path if isinstance(path, InputFile) else Path(path)
    source = str(place)
    if fault := size_fault(place):
        raise SceneError(source, [fault])
    try:
        text = read_input(path, "a scene file").text("TOML in UTF-8")
    except InputError as error:
        raise SceneError(source, [unread(error, "file", place)]) from None
    document = _parsed(text)
    if isinstance(document, Fault):
        raise SceneError(source, [document])
    return Scene.from_document(
        document,
        source=source,
        origins=key_lines(text),
        overrides=overrides,
        folder=place.parent,
    )


def parse_value(text: str) -> Any:
    """The value of a ``--set key=value``: TOML if it is one (3, 1e-9, [1, 2], true), else text.

    Examples
    --------
    >>> from gpusim.scene import parse_value
    >>> parse_value("[1, 2]"), parse_value("steel")
    ([1, 2], 'steel')
    """
    document = _parsed(f"value = {text}")
    return text if isinstance(document, Fault) or len(document) > 1 else document["value"]


def _parsed(text: str) -> dict[str, Any] | Fault:
    """The document of a TOML text, or why it is none."""
    if fault := text_fault(text):
        return fault
    try:
        document = tomllib.loads(text)
    except RecursionError:
        return Fault("file", "nested too deeply")
    except tomllib.TOMLDecodeError as error:
        return Fault("file", "not TOML", str(error))
    except ValueError:  # what Python says of thousands of digits is about Python
        return Fault("file", "number of too many digits", "more than 4,300", "at most 300")
    return document_fault(document) or document
