"""Where a key path was written: the line of a TOML text."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

__all__ = ["Keys", "Origins", "key_lines", "origin_of", "overridden"]

Keys = tuple[str | int, ...]
Origins = Mapping[Keys, str]

# possessive: a line that doesn't match costs no second look
_HEADER = re.compile(r"^\s*+(\[\[?)([A-Za-z0-9_.\-\s]++)\]\]?\s*+(?:#.*)?$")
_KEY = re.compile(r"^\s*+([A-Za-z0-9_\-]++(?:\s*+\.\s*+[A-Za-z0-9_\-]++)*+)\s*+=")


def key_lines(text: str) -> dict[Keys, str]:
    """Key path -> "line 12" for headers and for keys at the start of a line.

    Keys inside inline tables have no entry of their own; bare keys only. A line inside a
    multi-line value that looks like a header or key can mislead it, so lines are for messages.
    """
    lines: dict[Keys, str] = {}
    counts: dict[Keys, int] = {}
    table: Keys = ()
    quote = ""
    for count, line in enumerate(text.split("\n"), start=1):
        number = f"line {count}"
        outside = not quote
        for mark in ('"""', "'''"):
            if quote in ("", mark) and line.count(mark) % 2 == 1:
                quote = "" if quote else mark
        if not outside:
            continue
        if header := _HEADER.match(line):
            names = [name.strip() for name in header[2].split(".")]
            array = header[1] == "[["
            table = ()
            for depth, name in enumerate(names):
                table = (*table, name)
                if array and depth == len(names) - 1:
                    counts[table] = counts.get(table, -1) + 1
                    lines.setdefault(table, number)
                if table in counts:
                    table = (*table, counts[table])
            lines.setdefault(table, number)
        elif key := _KEY.match(line):
            path = table
            for name in key[1].split("."):
                path = (*path, name.strip())
                lines.setdefault(path, number)
    return lines


def overridden(origins: Origins, changed: Sequence[Keys]) -> Origins:
    """The same after the values at these keys have been replaced from outside the file."""
    if not changed:
        return origins
    ends = set(changed)
    kept = {
        path: text
        for path, text in origins.items()
        if not any(path[:depth] in ends for depth in range(1, len(path) + 1))
    }
    return {**kept, **dict.fromkeys(changed, "overridden")}


def origin_of(origins: Origins, keys: Sequence[str | int]) -> str:
    """Where the key, or the nearest thing around it that is known, was written; else ""."""
    path = tuple(keys)
    while path:
        if path in origins:
            return origins[path]
        path = path[:-1]
    return ""
