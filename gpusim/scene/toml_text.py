"""A plain document as a TOML text that `tomllib` reads back to the same."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from datetime import date, time
from typing import Any

from gpusim.printable import printable

__all__ = ["toml_text"]

_BARE = re.compile(r"[A-Za-z0-9_-]+")


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
