"""Nastran's bulk data as a list of cards: a name and its fields, continuations joined."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NoReturn

from gpusim.errors import InputError
from gpusim.files.input_file import InputFile
from gpusim.mesh.formats.text import Includes, text_lines

__all__ = ["BdfCard", "read_bdf_cards"]

_EXPECTED = "Nastran bulk data"
# a line of text: file, number, text without its comment
_Line = tuple[str, int, str]


@dataclass(eq=False, slots=True)
class BdfCard:
    """``name`` in upper case, ``fields`` after it as written; ``mark`` is that of its last line,
    by which a continuation may be known."""

    name: str
    fields: list[str]
    file: str
    line: int
    mark: str = ""

    def fail(self, problem: str) -> NoReturn:
        raise InputError(f"{self.where}: {problem}")

    @property
    def where(self) -> str:
        return f"{self.file}: line {self.line}: {self.name}"

    def field(self, number: int) -> str:
        """Field after the name, counted from 0; "" where there is none."""
        return self.fields[number] if number < len(self.fields) else ""


def read_bdf_cards(file: InputFile) -> list[BdfCard]:
    """The cards of the bulk data, included files in place, up to ENDDATA.

    ENDDATA may be absent where the last line is whole. A file without BEGIN BULK and CEND is bulk
    data from its first line. Raises InputError with file and line.
    """
    lines = list(_lines(file, Includes(file, _EXPECTED)))
    cards: list[BdfCard] = []
    for path, number, text in lines[_start(file, lines) :]:
        name, fields, mark = _fields(text)
        if name[:1] in ("", "+", "*"):
            if not cards:
                raise InputError(f"{path}: line {number}: continues nothing; expected a card")
            _continue(cards[-1], name, fields, mark, f"{path}: line {number}")
            continue
        name = name.rstrip("*").strip().upper()
        if name == "ENDDATA":
            return cards
        cards.append(BdfCard(name, fields, path, number, mark))
    if not file.data.endswith((b"\n", b"\r")):
        raise InputError(f"{file.path}: no ENDDATA; expected one at the end: cut off?")
    return cards


def _continue(card: BdfCard, name: str, fields: list[str], mark: str, where: str) -> None:
    own, wanted = name.lstrip("+*").strip(), card.mark.lstrip("+*").strip()
    if own and wanted and own != wanted:
        raise InputError(
            f"{where}: continuation {name} after a line marked {card.mark}; expected lines in "
            "their order"
        )
    card.fields.extend(fields)
    card.mark = mark


def _start(file: InputFile, lines: list[_Line]) -> int:
    """Where the bulk data begins: executive and case control come before it."""
    start, control = -1, ""
    for place, (path, number, text) in enumerate(lines):
        word = text.lstrip()[:5].upper()
        if word not in ("BEGIN", "CEND"):
            continue
        word = text.strip().upper()
        if re.match(r"BEGIN\b", word):
            if word.replace("=", " ").split()[1:] not in ([], ["BULK"]):
                raise InputError(
                    f"{path}: line {number}: got {word[:40]!r}: one of several models in a file; "
                    "expected a single BEGIN BULK"
                )
            start = place + 1
        elif word == "CEND" and not control:
            control = f"{path}: line {number}"
    if start < 0 and control:
        raise InputError(f"{control}: CEND without BEGIN BULK after it; is {file.path} cut off?")
    return max(start, 0)


def _lines(file: InputFile, includes: Includes) -> Iterator[_Line]:
    path, kept = str(file.path), ""
    for number, whole in enumerate(text_lines(file, _EXPECTED), start=1):
        text = kept + whole.split("$", 1)[0].rstrip()
        if not text.strip():
            continue
        start = text.lstrip()[:7].upper()
        found = start == "INCLUDE" and re.match(r"\s*INCLUDE\b[\s=]*(.*)", text, re.IGNORECASE)
        if not found:
            yield path, number, text
            continue
        target = found[1].strip()
        # a name in quotes may go on in further lines
        kept = text if target[:1] in ("'", '"') and target.count(target[0]) < 2 else ""
        if not kept:
            where = f"{path}: line {number}: INCLUDE"
            with includes.included(target.strip("'\" "), file, where) as child:
                yield from _lines(child, includes)
    if kept:
        raise InputError(f"{path}: INCLUDE: the file's name doesn't end; expected a quote after it")


def _fields(text: str) -> tuple[str, list[str], str]:
    """Name, data fields and mark of a line, in free, small or large fields."""
    if "\t" in text:
        text = text.expandtabs(8)
    if "," in text:
        words = [word.strip() for word in text.split(",")]
        return words[0], *_free(words[1:], 4 if "*" in words[0] else 8)
    name = text[:8].strip()
    size = 16 if "*" in name else 8
    return name, [text[at : at + size].strip() for at in range(8, 72, size)], text[72:80].strip()


def _free(words: list[str], width: int) -> tuple[list[str], str]:
    """Fields of a free line. One that is longer than a line has fields goes on by itself, with or
    without the marks that would end and begin lines."""
    fields: list[str] = []
    while True:
        fields += words[:width]
        words = words[width:]
        if len(words) <= 1:
            return fields + [""] * (-len(fields) % width), words[0] if words else ""
        if words[0][:1] in ("", "+", "*"):
            words = words[1:]
