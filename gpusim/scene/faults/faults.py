"""From pydantic's errors to faults: key path with index, what, got, expected, nearest key."""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from dataclasses import replace
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from gpusim.errors import Fault, InputError, similar_name
from gpusim.printable import printable
from gpusim.scene.tables.table import Words, name_and_unit

from .key_paths import Keys, Origins, dotted, origin_of
from .schema_places import Node, Place, expected, locate

MOST = 200  # faults that are looked into; to find the nearest word of each takes a while
_OF_BODIES = ("load", "mesh", "notch", "paint", "part", "support")
_OUT_OF_RANGE = {"greater_than", "greater_than_equal", "less_than", "less_than_equal"}
_OF_WRONG_TYPE = {
    "float_type", "int_type", "int_from_float", "int_parsing_size", "string_type", "bool_type",
    "list_type", "dict_type", "model_type", "model_attributes_type", "finite_number",
}  # fmt: skip


def with_origin(fault: Fault, keys: Sequence[str | int], origins: Origins) -> Fault:
    """The fault with the line of its key in the problem, if known."""
    origin = origin_of(origins, keys)
    if not origin:
        return fault
    return replace(fault, problem=f"{fault.problem} ({origin})")


def faults_of(
    error: ValidationError, origins: Origins, schema: Node | None = None
) -> tuple[list[Fault], int]:
    """The faults of a failed validation, in the order of the schema, and how many more there are
    where they are very many. ``schema``: as `locate` has it.

    A required key that is missing because it was misspelt is told once: by its wrong spelling.
    """
    found: list[tuple[Keys, Fault]] = []
    choices: dict[Keys, set[str]] = {}
    respelt: set[Keys] = set()
    missing: set[int] = set()
    entries = error.errors(include_url=False)
    places = [locate(entry["loc"], schema) for entry in entries[:MOST]]
    for entry, place in zip(entries, places, strict=False):
        if place.choice:
            choices.setdefault(place.keys, set()).add(entry["type"])
    for entry, place in zip(entries, places, strict=False):
        kind, context = entry["type"], entry.get("ctx", {})
        keys = place.keys
        if place.choice:  # told once, not for each of the types that it may have
            kinds = choices.pop(keys, None)
            if kinds:
                found.append((keys, _fault_of_value(entry["input"], kinds, dotted(keys), place)))
            continue
        if kind == "extra_forbidden":
            near = similar_name(str(keys[-1]), place.valid_keys)
            respelt.add((*keys[:-1], near))
        elif kind == "missing":
            missing.add(len(found))
        elif kind == "scene_fault" and context["key"]:
            parts = context["key"].split(".")
            keys = (*keys, *(int(part) if part.isdecimal() else part for part in parts))
        elif kind in ("union_tag_invalid", "union_tag_not_found"):
            keys = (*keys, str(context["discriminator"]).strip("'"))
        found.append((keys, _fault(entry, kind, dotted(keys), place, context)))
    faults = [
        with_origin(fault, keys, origins)
        for index, (keys, fault) in enumerate(found)
        if not (index in missing and keys in respelt)
    ]
    return faults, max(len(entries) - MOST, 0)


def _fault(
    entry: Mapping[str, Any], kind: str, key: str, place: Place, context: Mapping[str, Any]
) -> Fault:
    value: Any = entry.get("input")
    got = value_text(value)
    if kind == "scene_fault":
        return Fault(key, context["problem"], value_text(context["got"]), context["expected"])
    if kind == "extra_forbidden":
        near = similar_name(str(place.keys[-1]), place.valid_keys)
        if others := place.kinds_with_key:
            near = ""
        keys = "" if near else "one of " + ", ".join(place.valid_keys)
        if key in _OF_BODIES:
            return Fault(key, "unknown key", hint=f"did you mean body.{key}?")
        named = " or ".join(f'"{one}"' for one in others)
        hint = f"a key of {named}" if others else _did_you_mean(near)
        return Fault(key, "unknown key", "", keys, hint)
    if kind == "missing":
        return Fault(key, "missing", "", _wanted(place))
    if kind == "union_tag_not_found":
        return Fault(key, "missing", "", _one_of(place.tags))
    if kind == "union_tag_invalid":
        tag = str(context["tag"])
        hint = _did_you_mean(similar_name(tag, place.tags))
        return Fault(key, "unknown value", value_text(tag), _one_of(place.tags), hint)
    if kind == "literal_error":
        words = str(context["expected"]).replace(" or ", ", ").split(", ")
        hint = (
            similar_name(value, [word.strip("'") for word in words])
            if isinstance(value, str)
            else ""
        )
        one_of = "one of " + ", ".join(words) if len(words) > 1 else words[0]
        return Fault(key, "unknown value", got, one_of.replace("'", '"'), _did_you_mean(hint))
    if kind in ("too_short", "too_long"):
        bound = context["min_length" if kind == "too_short" else "max_length"]
        got = f"{context['actual_length'] or 'no'} items"
        return Fault(key, "wrong length", got, _length(bound, kind))
    if kind == "string_pattern_mismatch":
        return Fault(key, "not a usable name", got, "a letter, then letters, digits, _ or -")
    if kind in ("string_too_short", "string_too_long"):
        most = context.get("max_length", 0)
        if kind == "string_too_short":
            return Fault(key, "empty", "", "a text")
        return Fault(key, "too long", f"{len(value):,} letters", f"at most {most}")
    if kind in _OUT_OF_RANGE | _OF_WRONG_TYPE:
        return _fault_of_value(value, {kind}, key, place)
    return Fault(key, entry["msg"], got)


def _fault_of_value(value: Any, kinds: Set[str], key: str, place: Place) -> Fault:
    """Of a value that isn't what the schema wants, for ``kinds`` of reasons: of each of the types
    that it may have."""
    got, wanted = value_text(value), expected(place.value)
    if isinstance(value, str) and kinds & {"literal_error", "string_pattern_mismatch"}:
        return Fault(key, "unknown value", got, wanted)
    if isinstance(value, list) and kinds & {"too_short", "too_long"}:
        return Fault(key, "wrong length", f"{len(value)} items", wanted)
    if kinds & _OUT_OF_RANGE:
        return Fault(key, "out of range", got, wanted)
    if "finite_number" in kinds:
        wanted = wanted.replace("number", "finite number", 1)
    if "number" in wanted and isinstance(value, str):
        wanted += " without quotes" + ("; its unit is in the key" if _has_unit(key) else "")
    return Fault(key, "wrong type", got, wanted)


def _wanted(place: Place) -> str:
    """What the schema wants of a key, and what it says about it."""
    last = place.keys[-1] if place.keys else 0
    if isinstance(last, int):
        return ""
    text = expected(place.value)
    about = place.description.replace("`", "")
    if not (text and about):
        return text
    first = about.split()[0]
    if first == "A" or first[1:].islower():
        about = about[0].lower() + about[1:]
    return f"{text} ({about})"


def value_text(value: Any) -> str:
    """A value as it would stand in the file, cut to one short line."""
    if isinstance(value, bool):
        text = "true" if value else "false"
    elif isinstance(value, Words):
        text = str(value)
    elif isinstance(value, str):
        text = f'"{value[:100]}"'
    elif value is None:
        text = ""
    elif isinstance(value, Mapping):
        text = "a table" if value else "{}"
    elif isinstance(value, int) and abs(value) >= 10**40:
        text = f"a number of about {value.bit_length() * 0.30103:,.0f} digits"
    elif isinstance(value, list | tuple):
        text = f"[{', '.join(map(value_text, value[:20]))}{', ...' if len(value) > 20 else ''}]"
    else:
        text = str(value)
    text = printable(text)
    return text if len(text) <= 60 else text[:57] + "..."


def unread(error: InputError, key: str, path: Path) -> Fault:
    """The fault of a key whose file `read_input`, or a reader, refused with ``error``."""
    problem, *rest = str(error).removeprefix(printable(f"{path}: ")).split("; ")
    words = dict.fromkeys(("got", "expected"), "")
    for part in rest:
        name, _, text = part.partition(" ")
        if name in words:
            words[name] = text
    return Fault(key, problem, words["got"] or value_text(str(path)), words["expected"])


def _has_unit(key: str) -> bool:
    names = [part for part in key.split(".") if not part.isdecimal()]
    return name_and_unit(names[-1])[1] != ""


def _did_you_mean(name: str) -> str:
    return f"did you mean {name}?" if name else ""


def _one_of(names: Sequence[str]) -> str:
    return "one of " + ", ".join(f'"{name}"' for name in names)


def _length(bound: int, kind: str) -> str:
    if bound in (2, 3):
        return f"{bound} items"
    least = "one item or more" if bound == 1 else f"at least {bound} items"
    return least if kind == "too_short" else f"at most {bound} item{'s' if bound > 1 else ''}"
