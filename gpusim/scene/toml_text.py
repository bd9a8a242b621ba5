"""A plain document as a TOML text, and back; and how large and deeply nested it may be.

TOML can be written so that reading it takes minutes, or more of the stack than there is. The limits
lie far beyond what a scene needs, and low enough for a second or two.
"""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Iterator, Mapping
from datetime import date, time
from pathlib import Path
from typing import Any

from gpusim.errors import Fault
from gpusim.printable import printable
from gpusim.scene.faults.key_paths import DEEPEST

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
_BARE = re.compile(r"[A-Za-z0-9_-]+")


def parse_value(text: str) -> Any:
    """The value of a ``--set key=value``: TOML if it is one (3, 1e-9, [1, 2], true), else text.

    Examples
    --------
    >>> from gpusim.scene import parse_value
    >>> parse_value("[1, 2]"), parse_value("steel")
    ([1, 2], 'steel')
    """
    document = parse_toml(f"value = {text}")
    return text if isinstance(document, Fault) or len(document) > 1 else document["value"]


def parse_toml(text: str) -> dict[str, Any] | Fault:
    """The document of a TOML text, or why it is none."""
    if fault := _text_fault(text):
        return fault
    try:
        document = tomllib.loads(text)
    except RecursionError:
        return Fault("file", "nested too deeply")
    except tomllib.TOMLDecodeError as error:
        return Fault("file", "not TOML", str(error))
    except ValueError:  # what Python says of thousands of digits is about Python
        return Fault("file", "number of too many digits", "more than 4,300", "at most 300")
    return document_fault(document) or document


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


def _text_fault(text: str) -> Fault | None:
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


def toml_text(document: Mapping[str, Any]) -> str:
    """The text; keys whose value is None are left out.

    Raises TypeError for what TOML has no word for.

    Examples
    --------
    >>> print(toml_text({"a": [1, 2.5], "b": [{"c d": "x"}]}))
    a = [1, 2.5]
    <BLANKLINE>
    [[b]]
    "c d" = "x"
    <BLANKLINE>
    """
    return "\n".join(_table(document, "")).lstrip("\n") + "\n"


def _table(table: Mapping[str, Any], path: str) -> Iterator[str]:
    """Values first, as what follows a header belongs to it."""
    inner = []
    for key, value in table.items():
        if value is None:
            continue
        if isinstance(value, Mapping) or _is_tables(value):
            inner.append((f"{path}.{_key(key)}" if path else _key(key), value))
        else:
            yield f"{_key(key)} = {_value(value)}"
    for name, value in inner:
        header = f"[{name}]" if isinstance(value, Mapping) else f"[[{name}]]"
        for item in [value] if isinstance(value, Mapping) else value:
            yield f"\n{header}"
            yield from _table(item, name)


def _is_tables(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(v, Mapping) for v in value)


def _key(key: str) -> str:
    return key if _BARE.fullmatch(key) else _string(key)


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return repr(value)  # nan and inf are TOML's words too
    if isinstance(value, str):
        return _string(value)
    if isinstance(value, date | time):
        return value.isoformat()
    if isinstance(value, list | tuple):
        return f"[{', '.join(_value(item) for item in value)}]"
    if isinstance(value, Mapping):
        items = [f"{_key(k)} = {_value(v)}" for k, v in value.items() if v is not None]
        return f"{{{', '.join(items)}}}"
    raise TypeError(f"TOML has no word for {type(value).__name__}")


def _string(text: str) -> str:
    """Quoted; what a terminal would obey in it as its escape."""
    quoted = json.dumps(text, ensure_ascii=False)
    if printable(quoted) == quoted:
        return quoted
    return "".join(one if printable(one) == one else f"\\U{ord(one):08x}" for one in quoted)
