"""The lines of a text file from anywhere (line ends of every system, comments in Latin-1), and of
those that it includes."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

from gpusim.errors import InputError
from gpusim.files.input_file import InputFile

__all__ = ["Includes", "text_lines"]

_MAX_INCLUDED, _DEEPEST_INCLUDED = 1000, 50


def text_lines(file: InputFile, expected: str) -> list[str]:
    """Lines without their ends; the last one is empty where the file ends with a line's end.

    Text is UTF-8, else Latin-1, in which older programs write comments and names. Only line feeds
    and carriage returns part lines: `str.splitlines` would also part them at letters that Latin-1
    has, and take the rest of a comment for data. Raises InputError for binary data.
    """
    if b"\0" in file.data:
        raise InputError(f"{file.path}: not a text file; got binary data; expected {expected}")
    try:
        text = file.data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = file.data.decode("latin-1")
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")


class Includes:
    """The files that are being read, outermost first, and how many were included so far."""

    def __init__(self, file: InputFile, expected: str) -> None:
        self.expected = expected
        self._open = [os.path.realpath(file.path)]
        self._count = 0

    @contextmanager
    def included(self, target: str, parent: InputFile, where: str) -> Iterator[InputFile]:
        """The file ``target`` that a line of ``parent`` names, while it is being read.

        Raises InputError with that line: it includes itself, there are too many, or it can't be
        read.
        """
        child = parent.path.parent / target
        name = os.path.realpath(child) if "\0" not in target else target
        self._count += 1
        if name in self._open or len(self._open) > _DEEPEST_INCLUDED:
            raise InputError(
                f"{where}: the file includes itself; got {target!r}; expected a chain that ends"
            )
        if self._count > _MAX_INCLUDED:
            raise InputError(f"{where}: more than {_MAX_INCLUDED} files; expected fewer")
        try:
            file = parent.beside(target, self.expected)
        except InputError as error:
            raise InputError(f"{where}: got {target!r}: {error}") from None
        self._open.append(name)
        yield file
        self._open.pop()
