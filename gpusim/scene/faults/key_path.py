"""Dotted key paths: ``camera.0.focal_mm``, or by the item's name ``camera.front.focal_mm``."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from difflib import get_close_matches
from itertools import islice
from typing import Any

from gpusim.errors import Fault

from .limits import DEEPEST

__all__ = ["dotted", "listed", "nearest", "pick", "put", "with_names"]


def dotted(keys: Sequence[str | int]) -> str:
    """``("camera", 0, "up")`` -> ``camera.0.up``."""
    return ".".join(str(key) for key in keys)


def nearest(word: str, valid: Sequence[str]) -> str:
    """The one of ``valid`` that ``word`` may be a misspelling of, else ""."""
    lower = {name.lower(): name for name in valid}
    found = get_close_matches(word.lower(), list(lower), n=1, cutoff=0.6)
    return lower[found[0]] if found else ""


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
    """Set ``path`` in ``document`` in place; missing tables are made, list items must exist.

    Returns the keys with names turned into indices, or a fault if the path leads nowhere. Whether
    the last key is a valid one is for the schema to say.
    """
    found: list[str | int] = []
    keys = path.split(".")
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
                near = nearest(key, names)
                hint = f"did you mean {near}?" if near else ""
                return Fault(where, "no such item", key, f"an index or one of {have}", hint)
            found.append(index)
            if last:
                here[index] = value
            here = here[index]
        elif isinstance(here, dict):
            found.append(key)
            if last:
                here[key] = value
            else:
                here = here.setdefault(key, {})
        else:
            return Fault(dotted(keys[:depth]), "has no keys inside", repr(here), "a table or list")
    return tuple(found)


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
