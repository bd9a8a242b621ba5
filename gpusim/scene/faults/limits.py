"""How large and how deeply nested a scene may be; asked before anything else is done with it.

TOML can be written so that reading it takes minutes, or more of the stack than there is. The limits
lie far beyond what a scene needs, and low enough for a second or two.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gpusim.errors import Fault

__all__ = ["DEEPEST", "document_fault", "size_fault", "text_fault"]

DEEPEST = 16  # levels of tables and lists, and of a dotted key
_BYTES = 4_000_000
_MARKS = 500_000  # what the time to read a text goes with
_ITEMS = 10_000  # tables in one list, or keys in one table
_TABLES = 50_000

# Comments and strings as wholes, closed or not, so that what is in them isn't counted
_TOKEN = re.compile(
    r'"""(?:[^"\\]|\\.|"(?!""))*+(?:"""|\Z)'
    r"|'''(?:[^']|'(?!''))*+(?:'''|\Z)"
    r'|"(?:[^"\\\n]|\\.)*+"?'
    r"|'[^'\n]*+'?"
    r"|\#[^\n]*+"
    r"|[\[\]{}.,=\n]",
    re.DOTALL,
)


def size_fault(path: Path) -> Fault | None:
    """What of a file is too large to be read at all; None too if it can't be read."""
    try:
        size = path.stat().st_size
    except (OSError, ValueError):
        return None
    if size <= _BYTES:
        return None
    expected = f"at most {_BYTES / 1e6:g} MB"
    return Fault("file", "too large for a scene", f"{size / 1e6:,.1f} MB", expected)


def text_fault(text: str) -> Fault | None:
    """What of a TOML text is too large or too deep to be read, if anything is."""
    marks = sum(text.count(mark) for mark in ",=.\n[{\\")
    if marks > _MARKS:
        got = f"about {marks:,} keys, values and lines"
        return Fault("file", "too large for a scene", got, f"at most {_MARKS:,}")
    inside = dots = 0
    line = 1
    for match in _TOKEN.finditer(text):
        token = match[0]
        if token in "[{":
            inside += 1
        elif token in "]}":
            inside = max(inside - 1, 0)
        dots = dots + 1 if token == "." else dots if token[0] in "\"'" else 0
        if max(inside, dots + 1) > DEEPEST:
            expected = f"at most {DEEPEST} levels of tables, lists and dots"
            return Fault(
                "file", f"nested too deeply (line {line})", f"more than {DEEPEST}", expected
            )
        line += token.count("\n")
    return None


def _broken(text: str) -> bool:
    """Whether a text has halves of surrogate pairs, which no file can hold."""
    if text.isascii():
        return False
    return any("\ud800" <= one <= "\udfff" for one in text)


def _too_deep(key: str, line: str = "") -> Fault:
    expected = f"at most {DEEPEST} levels of tables, lists and dots"
    return Fault(key, f"nested too deeply{line}", f"more than {DEEPEST}", expected)


def document_fault(document: Mapping[str, Any]) -> Fault | None:
    """The same for a document that was read, or came from Python."""
    tables = 0
    queue: list[tuple[str, Any, int]] = [("", document, 0)]
    while queue:
        key, value, depth = queue.pop()
        if isinstance(value, str):
            if _broken(value):
                return Fault(key, "half a character", repr(value)[:60], "a text in Unicode")
            continue
        if not isinstance(value, Mapping | list | tuple):
            continue
        if depth > DEEPEST:
            return Fault(
                key, "nested too deeply", f"more than {DEEPEST}", f"at most {DEEPEST} levels"
            )
        if isinstance(value, Mapping):
            tables += 1
            inner = [(f"{key}.{name}".lstrip("."), value[name]) for name in value]
            count, what = len(value), "keys"
            for name in value:
                if not isinstance(name, str) or _broken(name):
                    return Fault(key or "file", "no name of a key", repr(name)[:60], "a text")
        else:
            inner = [
                (key, item) for item in value if isinstance(item, str | Mapping | list | tuple)
            ]
            count = sum(isinstance(item, Mapping) for item in value)
            what = "tables"
        if count > _ITEMS or tables > _TABLES:
            got = f"{count:,}" if count > _ITEMS else f"more than {_TABLES:,} in all"
            return Fault(key or "file", f"too many {what}", got, f"at most {_ITEMS:,}")
        queue += [(name, item, depth + 1) for name, item in inner]
    return None
