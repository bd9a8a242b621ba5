"""Lines of Abaqus and CalculiX input files, with the text of included files in place.

An ``*INCLUDE`` is text put in its place, whatever it holds: data before its first keyword belongs
to the card above, and what follows it goes on with its last card.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

from gpusim.errors import InputError
from gpusim.files.input_file import InputFile
from gpusim.mesh.formats.text import Includes, text_lines

__all__ = ["Lines", "fields", "is_comment", "join_lines", "keyword_line", "plain", "read_head"]


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


def join_lines(file: InputFile, expected: str) -> Lines:
    """Raises InputError: a file can't be read or isn't text, or includes itself."""
    joined = Lines()
    _join(file, joined, Includes(file, expected))
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
