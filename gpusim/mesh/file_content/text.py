"""The lines of a text file from anywhere (line ends of every system, comments in Latin-1), and of
those that it includes."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NoReturn

from gpusim.errors import InputError
from gpusim.files.input_file import InputFile
from gpusim.validation import require

_MAX_INCLUDED, _DEEPEST_INCLUDED = 1000, 50


def text_lines(file: InputFile, expected: str) -> list[str]:
    """Lines without their ends; the last one is empty where the file ends with a line's end.

    Text is UTF-8, else Latin-1, in which older programs write comments and names. Only line feeds
    and carriage returns part lines: `str.splitlines` would also part them at letters that Latin-1
    has, and take the rest of a comment for data. Raises InputError for binary data.
    """
    require(b"\0" not in file.data, f"{file.path}: not a text file", "binary data", expected)
    try:
        text = file.data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = file.data.decode("latin-1")
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")


def statements(file: InputFile, expected: str) -> Iterator[tuple[int, str, str]]:
    """Number, first word and the rest of every line that has some. A backslash at its end continues
    it. Comments begin with a # at its beginning or between blanks; others may be part of a name."""
    before = ""
    for number, line in enumerate(text_lines(file, expected), start=1):
        text = before + re.sub(r"(?:^|\s)#(?:\s.*)?$|^\s*#.*", "", line).strip()
        before = f"{text[:-1]} " if text.endswith("\\") else ""
        if text and not before:
            keyword, *rest = text.split(None, 1)
            yield number, keyword, "".join(rest)


def padded_text(value: Any) -> str:
    """A text in bytes, up to the first that is zero, or any value's; signs instead of letters that
    a terminal would obey."""
    letters = value if isinstance(value, bytes) else str(value).encode()
    text = letters.split(b"\0")[0].decode("utf-8", "replace").strip()
    return "".join(c if c.isprintable() else "?" for c in text)


def fail(file: InputFile, problem: str, line: int | None = None) -> NoReturn:
    """Raises InputError with the file's name, and the line's number where there is one."""
    where = f":{line}" if line else ""
    raise InputError(f"{file.path}{where}: {problem}")


def numbers(file: InputFile, words: Sequence[str], count: int, line: int) -> list[float]:
    """``count`` numbers. Raises InputError for other words, and for more or fewer of them."""
    try:
        values = [float(word) for word in words]
    except ValueError as error:
        fail(file, f"{error}; expected {count} numbers", line)
    if len(values) != count:
        fail(file, f"got {len(values)} numbers; expected {count}", line)
    return values


def whole_numbers(file: InputFile, words: Sequence[str], count: int, line: int) -> list[int]:
    """The same, of whole numbers."""
    values = numbers(file, words, count, line)
    if not all(abs(value) < 2**53 and value == int(value) for value in values):
        fail(file, f"got {' '.join(words)[:60]}; expected whole numbers", line)
    return [int(value) for value in values]


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
        fits = name not in self._open and len(self._open) <= _DEEPEST_INCLUDED
        require(fits, f"{where}: the file includes itself", repr(target), "a chain that ends")
        if self._count > _MAX_INCLUDED:
            raise InputError(f"{where}: more than {_MAX_INCLUDED} files; expected fewer")
        try:
            file = parent.beside(target, self.expected)
        except InputError as error:
            raise InputError(f"{where}: got {target!r}: {error}") from None
        self._open.append(name)
        yield file
        self._open.pop()
