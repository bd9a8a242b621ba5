"""Dotted key paths: ``camera.0.focal_mm``, or by the item's name ``camera.front.focal_mm``; and the
lines of a TOML text that they were written in."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from itertools import islice
from typing import Any

from gpusim.errors import Fault, similar_name
from gpusim.scene.tables.finishes import NamedFinish

DEEPEST = 16
"""Levels of tables and lists, and of a dotted key."""

Keys = tuple[str | int, ...]
Origins = Mapping[Keys, str]


def plain_value(value: Any) -> Any:
    """A copy of what Python gave for a key, as files have it: lists for tuples and arrays."""
    if callable(getattr(value, "tolist", None)):  # NumPy, which is heavy, isn't imported for it
        value = value.tolist()
    if isinstance(value, Mapping):
        return {key: plain_value(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [plain_value(one) for one in value]
    return value


# possessive: a line that doesn't match costs no second look
_HEADER = re.compile(r"^\s*+(\[\[?)([A-Za-z0-9_.\-\s]++)\]\]?\s*+(?:#.*)?$")
_KEY = re.compile(r"^\s*+([A-Za-z0-9_\-]++(?:\s*+\.\s*+[A-Za-z0-9_\-]++)*+)\s*+=")


def dotted(keys: Sequence[str | int]) -> str:
    """``("camera", 0, "up")`` -> ``camera.0.up``."""
    return ".".join(str(key) for key in keys)


def listed(names: Collection[str], most: int = 20) -> str:
    """Names for a message, the first ones where there are many."""
    more = f", … ({len(names):,} in all)" if len(names) > most else ""
    return ", ".join(islice(names, most)) + more


def _item(items: Sequence[Any], key: str) -> int | None:
    """Index of the list item that ``key`` means: a number, or the value of its ``name``."""
    if key.isdecimal():
        return int(key) if int(key) < len(items) else None
    for index, item in enumerate(items):
        if isinstance(item, Mapping) and item.get("name") == key:
            return index
    return None


def _names(items: Sequence[Any]) -> list[str]:
    return [str(item["name"]) for item in items if isinstance(item, Mapping) and "name" in item]


def put(document: dict[str, Any], path: str, value: Any) -> tuple[str | int, ...] | Fault:
    """Set ``path`` in ``document`` in place to a copy of ``value`` (`plain_value`); missing tables
    are made, list items must exist.

    Returns the keys with names turned into indices, or a fault if the path leads nowhere. Whether
    the last key is a valid one is for the schema to say.
    """
    found: list[str | int] = []
    keys, value = path.split("."), plain_value(value)
    if not all(keys):
        return Fault(path or '""', "not a key path", expected="keys joined by dots")
    if len(keys) > DEEPEST:
        return Fault(dotted(keys[:DEEPEST]), "too many keys in a path", f"{len(keys):,}",
                     f"at most {DEEPEST}")  # fmt: skip
    here: Any = document
    for depth, key in enumerate(keys):
        last = depth == len(keys) - 1
        where = dotted(keys[: depth + 1])
        if isinstance(here, list):
            index = _item(here, key)
            if index is None:
                names = _names(here)
                have = listed(names) if names else f"{len(here)} items"
                near = similar_name(key, names)
                hint = f"did you mean {near}?" if near else ""
                return Fault(where, "no such item", key, f"an index or one of {have}", hint)
            found.append(index)
            if last:
                here[index] = value
            here = here[index]
        elif isinstance(here, dict):
            found.append(key)
            if last:
                _make_way(here, key)
                here[key] = value
            else:
                here = here.setdefault(key, {})
        else:
            return Fault(dotted(keys[:depth]), "has no keys inside", repr(here), "a table or list")
    return tuple(found)


def _make_way(table: dict[str, Any], key: str) -> None:
    """Take out of a resolved paint what was filled in and would stand against the new value."""
    if key == "finish":
        kept = NamedFinish.unfilled(table)
        table.clear()
        table |= kept
    if key in ("albedo", "color"):
        table.pop("color" if key == "albedo" else "albedo", None)


def with_names(document: Any, path: str) -> str:
    """The path with the names of list items in place of their indices, where names are clear."""
    here, shown = document, []
    for key in path.split("."):
        if isinstance(here, list) and key.isdecimal() and int(key) < len(here):
            here, items = here[int(key)], here
            name = here.get("name") if isinstance(here, Mapping) else None
            if isinstance(name, str) and name.replace("-", "_").isidentifier():
                key = name if _names(items).count(name) == 1 else key
        else:
            here = here.get(key) if isinstance(here, Mapping) else None
        shown.append(key)
    return ".".join(shown)


def pick(document: Any, path: str) -> Any:
    """What ``path`` selects; in a list an index, an item's name, or ``*`` for every item.

    ``pick(doc, "body.*.mesh")`` is the list of every body's mesh. A key that isn't there is None.
    """
    here = document
    keys = path.split(".")
    for depth, key in enumerate(keys):
        if isinstance(here, list):
            if key == "*":
                rest = keys[depth + 1 :]
                return [pick(item, dotted(rest)) for item in here] if rest else here
            index = _item(here, key)
            here = None if index is None else here[index]
        elif isinstance(here, dict):
            here = here.get(key)
        else:
            return None
    return here


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
