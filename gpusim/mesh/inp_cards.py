"""Abaqus and CalculiX input files as a list of cards: a keyword line and its data lines.

Lines that start with ``**`` are comments. A keyword line that ends in a comma goes on in the next
line. Keywords and parameters are read without regard to case and blanks (``*SOLID SECTION`` is
``SOLIDSECTION``); ``*INCLUDE, INPUT=file`` is replaced by that file, relative to its own folder.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from itertools import pairwise
from pathlib import Path

from gpusim.errors import InputError
from gpusim.input_file import InputFile, read_input

__all__ = ["Card", "PathLike", "nearest", "read_cards"]

PathLike = str | os.PathLike[str]

_DEEPEST_INCLUDE = 20


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
        """Line number and stripped fields of each data line; empty ones at its end are left out."""
        for number, line in zip(self.numbers, self.lines, strict=True):
            fields = [field.strip() for field in line.split(",")]
            while fields and not fields[-1]:
                fields.pop()
            if fields:
                yield number, fields


def read_cards(path: PathLike | InputFile) -> list[Card]:
    """The cards of an input file in their order, included files in place.

    Raises InputError: the file can't be read or isn't text, has no keyword, has data before its
    first keyword, or includes itself.
    """
    file = read_input(path, "an Abaqus or CalculiX input file")
    cards = list(_cards(file, ()))
    if not cards:
        raise InputError(
            f"{file.path}: no keyword found; got a file without a line that starts with *; "
            "expected an Abaqus or CalculiX input file"
        )
    return cards


def nearest(name: str, known: Sequence[str]) -> str:
    """`` (did you mean 'X'?)``, or nothing where no known name is close."""
    by_fold = {one.upper(): one for one in known}
    close = get_close_matches(name.upper(), list(by_fold), n=1)
    return f" (did you mean {by_fold[close[0]]!r}?)" if close else ""


def _cards(file: InputFile, parents: tuple[Path, ...]) -> Iterator[Card]:
    path = file.path
    resolved = path.resolve()
    if resolved in parents or len(parents) > _DEEPEST_INCLUDE:
        raise InputError(f"{path}: *INCLUDE: the file includes itself; expected a chain that ends")
    lines = _text(file).splitlines()
    starts = [k for k, line in enumerate(lines) if line.startswith("*") and line[1:2] != "*"]
    for k in range(starts[0] if starts else len(lines)):
        if lines[k].strip() and not lines[k].startswith("**"):
            raise InputError(
                f"{path}:{k + 1}: data before the first keyword; got {lines[k].strip()[:40]!r}; "
                "expected a line that starts with *"
            )
    for start, end in pairwise([*starts, len(lines)]):
        head = lines[start]
        body = start + 1
        while head.rstrip().endswith(",") and body < end:
            if not lines[body].startswith("**"):
                head += lines[body]
            body += 1
        kept = [k for k in range(body, end) if lines[k].strip() and not lines[k].startswith("**")]
        card = _card(head, [lines[k] for k in kept], [k + 1 for k in kept], str(path), start + 1)
        if card.keyword != "INCLUDE":
            yield card
            continue
        target = card.parameters.get("INPUT", "")
        if not target:
            raise InputError(f"{card.where()}: no file; got {head.strip()!r}; expected INPUT=file")
        if not (path.parent / target).is_file():
            raise InputError(f"{card.where()}: no such file; got {target!r}; expected a file")
        yield from _cards(file.beside(target), (*parents, resolved))


def _text(file: InputFile) -> str:
    if b"\0" in file.data:
        raise InputError(
            f"{file.path}: not a text file; got binary data; expected an Abaqus or CalculiX "
            "input file"
        )
    return file.data.decode("utf-8-sig", errors="replace")


def _card(head: str, lines: list[str], numbers: list[int], file: str, line: int) -> Card:
    first, *rest = _fields(head)
    parameters: dict[str, str] = {}
    for field in rest:
        name, equals, value = field.partition("=")
        key = "".join(name.split()).upper()
        if key:
            parameters[key] = value.strip().strip("\"'").strip() if equals else ""
    keyword = "".join(first[1:].split()).upper()
    shown = "*" + " ".join(first[1:].split()).upper()
    return Card(keyword, shown, parameters, lines, numbers, file, line)


def _fields(head: str) -> list[str]:
    """Fields of a keyword line; a comma inside quotes doesn't part them."""
    if '"' not in head:
        return head.split(",")
    fields, inside = [""], False
    for letter in head:
        inside ^= letter == '"'
        if letter == "," and not inside:
            fields.append("")
        else:
            fields[-1] += letter
    return fields
