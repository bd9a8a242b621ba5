"""Files that mesh files and decks include: part of what a result was computed from."""

from __future__ import annotations

import re
from pathlib import Path

from gpusim.errors import InputError
from gpusim.files.input_file import InputFile, read_input

__all__ = ["included_files"]

_ABAQUS = re.compile(rb"^[ \t]*\*\s*INCLUDE\s*,\s*INPUT\s*=\s*([^,\r\n]+)", re.I | re.M)
_NASTRAN = re.compile(rb"^[ \t]*INCLUDE\b[\s=]*('[^']*'|\"[^\"]*\"|[^\r\n$'\"]+)", re.I | re.M)
_STATEMENTS = {".inp": _ABAQUS} | dict.fromkeys((".bdf", ".nas", ".fem", ".dat"), _NASTRAN)
_MOST = 1000


def included_files(file: InputFile) -> tuple[InputFile, ...]:
    """All files that a mesh file names with *INCLUDE or INCLUDE, and those that they name.

    Raises InputError for one that can't be read; readers say in which line it is named. Files of
    other kinds include nothing.
    """
    statement = _STATEMENTS.get(file.suffix)
    if statement is None:
        return ()
    found = {str(file.path): file}
    waiting = [file]
    while waiting:
        parent = waiting.pop()
        for name in statement.findall(parent.data):
            child = parent.path.parent / _text(name)
            if str(child) not in found:
                if len(found) > _MOST:
                    raise InputError(
                        f"{file.path}: includes more than {_MOST} files; expected fewer"
                    )
                found[str(child)] = read_input(child, "an included file")
                waiting.append(found[str(child)])
    return tuple(found.values())[1:]


def _text(name: bytes) -> Path:
    """A name without its quotes, and without the line ends within them."""
    raw = re.sub(rb"[ \t]*\r?\n", b"", name.strip()).strip(b"'\" \t").replace(b"\0", b"")
    try:
        return Path(raw.decode("utf-8"))
    except UnicodeDecodeError:
        return Path(raw.decode("latin-1"))
