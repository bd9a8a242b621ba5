"""Abaqus and CalculiX input files as a list of cards: a keyword line and its data lines.

Lines that start with ``**`` are comments, as is text before the first keyword; blanks before a
star count for nothing. A keyword line that ends in a comma goes on in the next line, if that
begins with a letter. Keywords and parameters are read without regard to case and blanks
(``*SOLID SECTION`` is ``SOLIDSECTION``); ``*INCLUDE, INPUT=file`` is replaced by the text of
that file, relative to the file that names it.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from itertools import pairwise

from gpusim.errors import InputError
from gpusim.files.input_file import InputFile, read_input
from gpusim.mesh.formats.abaqus.lines import (
    Lines,
    fields,
    is_comment,
    join_lines,
    keyword_line,
    plain,
    read_head,
)

__all__ = ["Card", "Source", "nearest", "read_cards"]

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

    def rows(self) -> Iterator[tuple[int, list[str]]]:
        """Line number and fields of each data line, without the blanks and quotes around them;
        empty ones at its end are left out."""
        for number, line in zip(self.numbers, self.lines, strict=True):
            row = [plain(field) for field in fields(line)]
            while row and not row[-1]:
                row.pop()
            if row:
                yield number, row


def read_cards(source: Source) -> list[Card]:
    """The cards of an input file in their order, included files in place.

    Raises InputError: a file can't be read or isn't text, has no keyword, has data before its
    first keyword, or includes itself.
    """
    file = read_input(source, _EXPECTED)
    text = join_lines(file, _EXPECTED)
    _refuse_early_data(text)
    if not text.keywords:
        raise InputError(
            f"{file.path}: no keyword found; got a file without a line that starts with *; "
            f"expected {_EXPECTED}"
        )
    return list(_cards(text))


def nearest(name: str, known: Sequence[str]) -> str:
    """`` (did you mean 'X'?)``, or nothing where no known name is close."""
    by_fold = {one.upper(): one for one in known}
    close = get_close_matches(name.upper(), list(by_fold), n=1)
    return f" (did you mean {by_fold[close[0]]!r}?)" if close else ""


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
