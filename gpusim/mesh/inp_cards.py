"""Abaqus and CalculiX input files as a list of cards: a keyword line and its data lines.

Lines that start with ``**`` are comments, as is text before the first keyword; blanks before a
star count for nothing. A keyword line that ends in a comma goes on in the next line, if that
begins with a letter. Keywords and parameters are read without regard to case and blanks
(``*SOLID SECTION`` is ``SOLIDSECTION``); ``*INCLUDE, INPUT=file`` is replaced by that file,
relative to the file that names it.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from itertools import pairwise

from gpusim.errors import InputError
from gpusim.input_file import InputFile, read_input
from gpusim.mesh.text import text_lines

__all__ = ["Card", "Source", "nearest", "read_cards"]

Source = str | os.PathLike[str] | InputFile

_EXPECTED = "an Abaqus or CalculiX input file"
_MOST_INCLUDED, _DEEPEST_INCLUDED = 1000, 50


@dataclass(frozen=True, eq=False)
class Card:
    """One keyword with its parameters and data lines.

    ``keyword`` is upper case without blanks and without the star, ``shown`` as it was written.
    ``parameters`` maps an upper-case name to its value as written ("" for a flag). ``lines`` holds
    the data lines without comments, ``numbers`` their line numbers, ``line`` the keyword's own.
    """

    keyword: str
    shown: str
    parameters: Mapping[str, str]
    lines: Sequence[str]
    numbers: Sequence[int]
    file: str
    line: int

    def where(self, number: int | None = None) -> str:
        """``file:line: *KEYWORD``, the line being the data line ``number`` (default: the card)."""
        return f"{self.file}:{self.line if number is None else number}: {self.shown}"

    def rows(self) -> Iterator[tuple[int, list[str]]]:
        """Line number and fields of each data line, without the blanks and quotes around them;
        empty ones at its end are left out."""
        for number, line in zip(self.numbers, self.lines, strict=True):
            fields = [_plain(field) for field in _fields(line)]
            while fields and not fields[-1]:
                fields.pop()
            if fields:
                yield number, fields


def read_cards(source: Source) -> list[Card]:
    """The cards of an input file in their order, included files in place.

    Raises InputError: a file can't be read or isn't text, has no keyword, has data before its
    first keyword, or includes itself.
    """
    file = read_input(source, _EXPECTED)
    cards = list(_cards(file, _Reading([os.path.realpath(file.path)])))
    if not cards:
        raise InputError(
            f"{file.path}: no keyword found; got a file without a line that starts with *; "
            f"expected {_EXPECTED}"
        )
    return cards


def nearest(name: str, known: Sequence[str]) -> str:
    """`` (did you mean 'X'?)``, or nothing where no known name is close."""
    by_fold = {one.upper(): one for one in known}
    close = get_close_matches(name.upper(), list(by_fold), n=1)
    return f" (did you mean {by_fold[close[0]]!r}?)" if close else ""


@dataclass
class _Reading:
    """The files that are being read, outermost first, and how many were included so far."""

    open: list[str]
    included: int = 0


def _cards(file: InputFile, reading: _Reading) -> Iterator[Card]:
    lines = text_lines(file, _EXPECTED)
    starts = [k for k, line in enumerate(lines) if _is_keyword(line)]
    _refuse_early_data(file, lines[: starts[0]] if starts else lines)
    for start, end in pairwise([*starts, len(lines)]):
        head = lines[start].strip()
        body = start + 1
        # a parameter begins with a letter, and what doesn't is data after a comma too many
        while head.endswith(",") and body < end and re.match(r"\s*([a-zA-Z]|\*\*)", lines[body]):
            if not _is_comment(lines[body]):
                head += lines[body].strip()
            body += 1
        kept = [k for k in range(body, end) if lines[k].strip() and not _is_comment(lines[k])]
        data, numbers = [lines[k] for k in kept], [k + 1 for k in kept]
        card = _card(head, data, numbers, str(file.path), start + 1)
        if card.keyword == "INCLUDE":
            yield from _included(card, file, reading)
        else:
            yield card


def _is_keyword(line: str) -> bool:
    start = line.lstrip()
    return start.startswith("*") and not start.startswith("**")


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith("**")


def _refuse_early_data(file: InputFile, lines: Sequence[str]) -> None:
    """A title may stand before the first keyword; numbers there belong to a keyword that's lost."""
    for number, line in enumerate(lines, start=1):
        if re.match(r"\s*[-+.]?\d[^a-zA-Z]*(,|$)", line):
            raise InputError(
                f"{file.path}:{number}: data before the first keyword; got {line.strip()[:40]!r}; "
                "expected a line that starts with *"
            )


def _included(card: Card, parent: InputFile, reading: _Reading) -> Iterator[Card]:
    target = card.parameters.get("INPUT", "")
    if not target:
        raise InputError(f"{card.where()}: no file; expected INPUT=file")
    child = parent.path.parent / target
    name = os.path.realpath(child) if "\0" not in target else target
    reading.included += 1
    if name in reading.open or len(reading.open) > _DEEPEST_INCLUDED:
        raise InputError(
            f"{card.where()}: the file includes itself; got {target!r}; expected a chain that ends"
        )
    if reading.included > _MOST_INCLUDED:
        raise InputError(f"{card.where()}: more than {_MOST_INCLUDED} files; expected fewer")
    try:
        file = parent.beside(target, _EXPECTED)
    except InputError as error:
        raise InputError(f"{card.where()}: got {target!r}: {error}") from None
    reading.open.append(name)
    yield from _cards(file, reading)
    reading.open.pop()


def _card(head: str, lines: list[str], numbers: list[int], file: str, line: int) -> Card:
    first, *rest = _fields(head)
    keyword = "".join(first[1:].split()).upper()
    shown = "*" + " ".join(first[1:].split()).upper()
    parameters: dict[str, str] = {}
    for field in rest:
        name, equals, value = field.partition("=")
        key = "".join(name.split()).upper()
        if key in parameters:
            raise InputError(f"{file}:{line}: {shown}: {key} is given twice; expected it once")
        if key:
            parameters[key] = _plain(value) if equals else ""
    return Card(keyword, shown, parameters, lines, numbers, file, line)


def _plain(field: str) -> str:
    return field.strip().strip("\"'").strip()


def _fields(line: str) -> list[str]:
    """Fields of a line; a comma inside quotes doesn't part them."""
    if '"' not in line:
        return line.split(",")
    fields, inside = [""], False
    for letter in line:
        inside ^= letter == '"'
        if letter == "," and not inside:
            fields.append("")
        else:
            fields[-1] += letter
    return fields
