"""Abaqus and CalculiX input files as a list of cards: a keyword line and its data lines.

Lines that start with ``**`` are comments, as is text before the first keyword; blanks before a
star count for nothing. A keyword line that ends in a comma goes on in the next line, if that
begins with a letter. Keywords and parameters are read without regard to case and blanks
(``*SOLID SECTION`` is ``SOLIDSECTION``). ``*INCLUDE, INPUT=file`` is replaced by the text of that
file, relative to the file that names it, whatever it holds: data before its first keyword belongs
to the card above, and what follows it goes on with its last card.
"""

from __future__ import annotations

import os
import re
from bisect import bisect_right
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Generic, NoReturn, TypeVar

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError, similar_name
from gpusim.files.input_file import InputFile, read_input
from gpusim.mesh.file_content.text import Includes, text_lines
from gpusim.validation import require


@dataclass(eq=False)
class Lines:
    """Text of a file and of those that it includes, and where each line comes from.

    ``texts`` are all lines, numbered from 1; ``keywords`` the positions of those that begin with a
    keyword; piece k of the text begins at position ``starts[k]``, with a line of a file (from 0).
    """

    texts: list[str] = field(default_factory=list)
    keywords: list[int] = field(default_factory=list)
    starts: list[int] = field(default_factory=list)
    origins: list[tuple[str, int]] = field(default_factory=list)

    def add(self, file: str, lines: Sequence[str], first: int, end: int) -> None:
        """Lines first … end - 1 of a file; its keywords are added beforehand."""
        self.starts.append(len(self.texts))
        self.origins.append((file, first))
        self.texts.extend(lines[first:end])

    def place(self, number: int) -> tuple[str, int]:
        """File, and line in it, of a line of the text (both count from 1)."""
        piece = bisect_right(self.starts, number - 1) - 1
        file, first = self.origins[piece]
        return file, first + number - self.starts[piece]


def join_lines(file: InputFile) -> Lines:
    """Raises InputError: a file can't be read or isn't text, or includes itself."""
    joined = Lines()
    _join(file, joined, Includes(file, _EXPECTED))
    return joined


def _join(file: InputFile, joined: Lines, includes: Includes) -> None:
    path, lines = str(file.path), text_lines(file, includes.expected)
    starts = [k for k, line in enumerate(lines) if _is_keyword(line)]
    done = 0  # lines before it are in the text, but for the *INCLUDE ones
    for start, end in pairwise([*starts, len(lines)]):
        if not _INCLUDE.match(lines[start]):
            joined.keywords.append(len(joined.texts) + start - done)
            continue
        head, body = keyword_line(lines, start, end)
        joined.add(path, lines, done, start)
        where = f"{path}:{start + 1}"
        _, shown, parameters = read_head(head, where)
        target = parameters.get("INPUT", "")
        if not target:
            raise InputError(f"{where}: {shown}: no file; expected INPUT=file")
        with includes.included(target, file, f"{where}: {shown}") as child:
            _join(child, joined, includes)
        done = body
    joined.add(path, lines, done, len(lines))


_INCLUDE = re.compile(r"\s*\*\s*I\s*N\s*C\s*L\s*U\s*D\s*E\s*(,|$)", re.IGNORECASE)


def keyword_line(lines: Sequence[str], start: int, end: int) -> tuple[str, int]:
    """The keyword line at ``start`` with those that it goes on in, and the line after them."""
    head, body = lines[start].strip(), start + 1
    # a parameter begins with a letter, and what doesn't is data after a comma too many
    while head.endswith(",") and body < end and re.match(r"\s*([a-zA-Z]|\*\*)", lines[body]):
        if not is_comment(lines[body]):
            head += lines[body].strip()
        body += 1
    return head, body


def read_head(head: str, where: str) -> tuple[str, str, dict[str, str]]:
    """Keyword, the keyword as it is shown, and parameters of a keyword line."""
    first, *rest = fields(head)
    keyword = "".join(first[1:].split()).upper()
    shown = "*" + " ".join(first[1:].split()).upper()
    parameters: dict[str, str] = {}
    for text in rest:
        name, equals, value = text.partition("=")
        key = "".join(name.split()).upper()
        if key in parameters:
            raise InputError(f"{where}: {shown}: {key} is given twice; expected it once")
        if key:
            parameters[key] = plain(value) if equals else ""
    return keyword, shown, parameters


def _is_keyword(line: str) -> bool:
    start = line.lstrip()
    return start.startswith("*") and not start.startswith("**")


def is_comment(line: str) -> bool:
    return line.lstrip().startswith("**")


def plain(text: str) -> str:
    """A field without the blanks and quotes around it."""
    return text.strip().strip("\"'").strip()


def fields(line: str) -> list[str]:
    """Fields of a line; a comma inside quotes doesn't part them."""
    if '"' not in line:
        return line.split(",")
    parts, inside = [""], False
    for letter in line:
        inside ^= letter == '"'
        if letter == "," and not inside:
            parts.append("")
        else:
            parts[-1] += letter
    return parts


Source = str | os.PathLike[str] | InputFile

_EXPECTED = "an Abaqus or CalculiX input file"


@dataclass(frozen=True, eq=False)
class Card:
    """One keyword with its parameters and data lines.

    ``keyword`` is upper case without blanks and without the star, ``shown`` as it was written.
    ``parameters`` maps an upper-case name to its value as written ("" for a flag). ``lines`` holds
    the data lines without comments, ``numbers`` their line numbers in ``text``, the whole of the
    input with included files in place; ``file`` and ``line`` are where the keyword stands.
    """

    keyword: str
    shown: str
    parameters: Mapping[str, str]
    lines: Sequence[str]
    numbers: Sequence[int]
    file: str
    line: int
    text: Lines

    def where(self, number: int | None = None) -> str:
        """``file:line: *KEYWORD``, the line being the data line ``number`` (default: the card)."""
        file, line = (self.file, self.line) if number is None else self.text.place(number)
        return f"{file}:{line}: {self.shown}"

    def fail(self, problem: str, number: int | None = None) -> NoReturn:
        raise InputError(f"{self.where(number)}: {problem}")

    def rows(self) -> Iterator[tuple[int, list[str]]]:
        """Line number and fields of each data line, without the blanks and quotes around them;
        empty ones at its end are left out."""
        for number, line in zip(self.numbers, self.lines, strict=True):
            row = [plain(field) for field in fields(line)]
            while row and not row[-1]:
                row.pop()
            if row:
                yield number, row

    def records(
        self, least: int = 1, most: int | None = None, expected: str = "", counted: bool = False
    ) -> Iterator[tuple[str, list[str]]]:
        """Place (see `where`) and fields of each data line.

        Raises InputError for less than ``least`` or more than ``most`` fields, which shows the
        line, or if ``counted`` their number.
        """
        for number, row in self.rows():
            where = self.where(number)
            if len(row) < least or (most is not None and len(row) > most):
                got = f"{len(row)} fields" if counted else repr(", ".join(row))
                raise InputError(f"{where}: got {got}; expected {expected}")
            yield where, row


def read_cards(source: Source) -> list[Card]:
    """The cards of an input file in their order, included files in place.

    Raises InputError: a file can't be read or isn't text, has no keyword, has data before its
    first keyword, or includes itself.
    """
    file = read_input(source, _EXPECTED)
    text = join_lines(file)
    _refuse_early_data(text)
    got = "a file without a line that starts with *"
    require(bool(text.keywords), f"{file.path}: no keyword found", got, _EXPECTED)
    return list(_cards(text))


def nearest(name: str, known: Sequence[str]) -> str:
    """`` (did you mean 'X'?)``, or nothing where no known name is close."""
    near = similar_name(name, known)
    return f" (did you mean {near!r}?)" if near else ""


def _cards(text: Lines) -> Iterator[Card]:
    lines = text.texts
    for start, end in pairwise([*text.keywords, len(lines)]):
        head, body = keyword_line(lines, start, end)
        kept = [k for k in range(body, end) if lines[k].strip() and not is_comment(lines[k])]
        data, numbers = [lines[k] for k in kept], [k + 1 for k in kept]
        file, line = text.place(start + 1)
        yield Card(*read_head(head, f"{file}:{line}"), data, numbers, file, line, text)


def _refuse_early_data(text: Lines) -> None:
    """A title may stand before the first keyword; numbers there belong to a keyword that's lost."""
    first = text.keywords[0] if text.keywords else len(text.texts)
    for position, line in enumerate(text.texts[:first]):
        if re.match(r"\s*[-+.]?\d[^a-zA-Z]*(,|$)", line):
            file, number = text.place(position + 1)
            raise InputError(
                f"{file}:{number}: data before the first keyword; got {line.strip()[:40]!r}; "
                "expected a line that starts with *"
            )


T = TypeVar("T")
Number = TypeVar("Number", bound=np.generic)

LARGEST = 1e60
"""Beyond it products of numbers (volumes, stresses) would leave the range of float64."""


class Names(Generic[T]):
    """Named things, found without regard to case; the spelling of the first definition is kept.

    In a file with instances of parts, what a part names is ``INSTANCE.NAME``. Where there is one
    instance only (``single``), ``NAME`` finds it too, unless the assembly has a thing of that name;
    the assembly's own name (``assembly``) may stand before any.
    """

    def __init__(self, what: str, single: str = "", assembly: str = "") -> None:
        self.what = what
        self.single = single.upper()
        self.assembly = assembly.upper()
        self.shown: dict[str, str] = {}
        self.values: dict[str, T] = {}
        self.places: dict[str, str] = {}

    def __contains__(self, name: str) -> bool:
        return self._key(name) in self.values

    def set(self, name: str, value: T) -> None:
        self.shown.setdefault(name.upper(), name)
        self.values[name.upper()] = value

    def define(self, name: str, value: T, where: str) -> None:
        """A thing that is defined once. Raises InputError where its name is taken."""
        first = self.places.setdefault(name.upper(), where)
        fits = name.upper() not in self.values
        got = f"{name!r}, which {first} defines"
        require(fits, f"{where}: a second {self.what} of one name", got, "names of their own")
        self.set(name, value)

    def get(self, name: str, where: str) -> T:
        """Raises InputError with the nearest name."""
        key = self._key(name)
        if key in self.values:
            return self.values[key]
        known = list(self.shown.values())
        listed = ", ".join(known[:8]) + (", …" if len(known) > 8 else "")
        raise InputError(
            f"{where}: unknown {self.what}; got {name!r}; "
            f"expected one of {listed or 'none, none is defined'}{nearest(name, known)}"
        )

    def items(self) -> list[tuple[str, T]]:
        """Names as they are shown: those of a single instance without it, where that is enough."""
        found = []
        for key, value in self.values.items():
            short = key.removeprefix(f"{self.single}.") if self.single else key
            plain = short == key or short in self.values
            shown = self.shown[key]
            found.append((shown if plain else shown[len(self.single) + 1 :], value))
        return found

    def _key(self, name: str) -> str:
        key = name.upper()
        if key not in self.values and self.assembly:
            key = key.removeprefix(f"{self.assembly}.")
        if key not in self.values and self.single:
            key = f"{self.single}.{key}"
        return key


def is_plain(text: str) -> bool:
    """Whether Python takes nothing in it for a digit that other programs don't: 1_000, \u0663."""
    return "_" not in text and text.isascii()


def numbers_at_once(texts: Sequence[str], kind: type[Number]) -> npt.NDArray[Number] | None:
    """All texts as numbers; None where one has to be looked at by itself."""
    if not is_plain("".join(texts)):
        return None
    try:
        return np.array(texts, dtype=kind)
    except (ValueError, OverflowError):
        return None


def number(text: str, where: str) -> float:
    """A finite float64; Fortran's ``1.D3`` is one. Raises InputError."""
    try:
        value = float(text.replace("D", "E").replace("d", "e")) if is_plain(text) else np.nan
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise InputError(f"{where}: not a number; got {text!r}; expected a finite number")
    if abs(value) > LARGEST:
        raise InputError(f"{where}: number too large; got {text}; expected at most {LARGEST:g}")
    return value


def whole(text: str, where: str) -> int:
    """A whole number below 2^53 in size. Raises InputError."""
    try:
        value = int(text if is_plain(text) and len(text) < 40 else "?")
    except ValueError:
        raise InputError(f"{where}: not a whole number; got {text!r}; expected one") from None
    if abs(value) >= 2**53:
        raise InputError(f"{where}: number too large; got {text}; expected less than 2^53")
    return value
