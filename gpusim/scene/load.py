"""Reading a scene file."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any

from gpusim.errors import Fault, InputError, SceneError
from gpusim.input_file import read_input

from .files import file_fault
from .lines import key_lines
from .scene import Scene

__all__ = ["load_scene", "parse_value"]


def load_scene(path: str | PathLike[str], overrides: Mapping[str, Any] | None = None) -> Scene:
    """Read, validate and resolve a TOML scene file.

    ``overrides`` maps dotted key paths to values ("solver.tolerance": 1e-9) and wins over the
    file. Raises SceneError that lists every fault: unreadable file, TOML syntax (with line),
    unknown or missing keys, wrong types and ranges, names and references that don't fit.
    """
    source = str(path)
    try:
        text = read_input(path, "a scene file").text("TOML in UTF-8")
    except InputError as error:
        raise SceneError(source, [file_fault("file", error, source)]) from None
    try:
        document = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise SceneError(source, [Fault("file", "not TOML", str(error))]) from None
    return Scene.from_document(
        document,
        source=source,
        origins=key_lines(text),
        overrides=overrides,
        folder=Path(path).parent,
    )


def parse_value(text: str) -> Any:
    """The value of a ``--set key=value``: TOML if it is one (3, 1e-9, [1, 2], true), else text."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text
