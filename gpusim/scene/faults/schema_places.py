"""What the schema says: of a place in the file, and of the file as a whole, for editors."""

from __future__ import annotations

import json
import typing
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from textwrap import shorten
from types import UnionType
from typing import Annotated, Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from gpusim.scene.description.scene_table import SceneTable
from gpusim.scene.description.table import descriptions

__all__ = ["Place", "expected", "json_schema", "locate"]

_MANY = 2**31  # a count above it is no limit that anybody asks about
_KINDS = {
    "number": "number",
    "integer": "whole number",
    "string": "text",
    "boolean": "true or false",
}


def json_schema() -> dict[str, Any]:
    """The JSON schema of a scene file, for editors.

    Examples
    --------
    >>> from gpusim.scene import json_schema
    >>> json_schema()["type"]
    'object'
    """
    schema = SceneTable.model_json_schema(by_alias=True)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}


@dataclass(frozen=True)
class Place:
    """A key path, the table class that its last key belongs to, and that key's type.

    ``choice``: which of the types that the value may have is meant, where it may have several.
    """

    keys: tuple[str | int, ...]
    table: type[BaseModel]
    annotation: Any
    choice: str = ""

    @property
    def valid_keys(self) -> list[str]:
        """Every key of the table."""
        return [info.alias or name for name, info in self.table.model_fields.items()]

    @property
    def description(self) -> str:
        """First clause of what the schema says about the last key, else ""."""
        name = _name(self.table, self.keys[-1]) if self.keys else None
        text = descriptions(self.table).get(name, "") if name else ""
        return shorten(text.split(";")[0].rstrip("."), 100, placeholder=" ...")

    @property
    def tags(self) -> list[str]:
        """Values of the key that chooses the variant, if there are variants here."""
        return [str(tag) for tag in _variants(self.annotation)]


def locate(root: type[BaseModel], location: Sequence[str | int]) -> Place:
    """The place of a pydantic location; union tags, which are no keys of the file, are left out."""
    keys: list[str | int] = []
    table = root
    here: Any = root
    for step in location:
        variants = _variants(here)
        if step in variants:
            here = variants[str(step)]
            continue
        inner = _strip(here)
        if isinstance(step, str) and typing.get_origin(inner) in (typing.Union, UnionType):
            return Place(tuple(keys), table, here, step)
        if isinstance(step, int):
            here = (typing.get_args(inner) or (None,))[0]
        elif isinstance(inner, type) and issubclass(inner, BaseModel):
            table = inner
            info = _field(inner, step)
            here = None if info is None else info.annotation
        keys.append(step)
    return Place(tuple(keys), table, here)


def _name(table: type[BaseModel], key: str | int) -> str | None:
    for name, info in table.model_fields.items():
        if key == (info.alias or name):
            return name
    return None


def _field(table: type[BaseModel], key: str | int) -> FieldInfo | None:
    name = _name(table, key)
    return None if name is None else table.model_fields[name]


def _strip(annotation: Any) -> Any:
    """Without ``Annotated`` and ``| None``."""
    while True:
        origin = typing.get_origin(annotation)
        if origin is Annotated:
            annotation = typing.get_args(annotation)[0]
            continue
        if origin in (typing.Union, UnionType):
            rest = [arg for arg in typing.get_args(annotation) if arg is not type(None)]
            if len(rest) == 1:
                annotation = rest[0]
                continue
        return annotation


def _variants(annotation: Any) -> dict[str | int, type[BaseModel]]:
    """Tag -> table of a union of tables that ``type`` or ``builder`` tells apart; else empty."""
    inner = _strip(annotation)
    if typing.get_origin(inner) not in (typing.Union, UnionType):
        return {}
    found: dict[str | int, type[BaseModel]] = {}
    for variant in typing.get_args(inner):
        if not (isinstance(variant, type) and issubclass(variant, BaseModel)):
            return {}
        for name in ("type", "builder"):
            info = variant.model_fields.get(name)
            if info is not None:
                found.update(dict.fromkeys(typing.get_args(info.annotation), variant))
    return found


def expected(table: type[BaseModel], key: str) -> str:
    """Words for the value of a key (as it stands in the file) of a table; "" if there are none."""
    schema = _schema(table)
    return _words(schema.get("properties", {}).get(key, {}), schema.get("$defs", {}))


@cache
def _schema(table: type[BaseModel]) -> dict[str, Any]:
    return table.model_json_schema(by_alias=True)


def _words(schema: dict[str, Any], defs: dict[str, Any], many: bool = False) -> str:
    if "$ref" in schema:
        return _words(defs.get(schema["$ref"].rsplit("/", 1)[-1], {}), defs, many)
    if "const" in schema or "enum" in schema:
        values = schema.get("enum", [schema.get("const")])
        text = ", ".join(json.dumps(value) for value in values)
        return f"one of {text}" if len(values) > 1 else text
    options = [one for one in schema.get("anyOf", schema.get("oneOf", []))
               if one.get("type") != "null"]  # fmt: skip
    if options:
        return ", or ".join(dict.fromkeys(_words(one, defs, many) for one in options))
    kind = schema.get("type")
    if kind == "object":
        return "tables" if many else "a table"
    if kind == "array":
        text = _list(schema, defs)
        return text.replace("a list", "lists", 1) if many else text
    if "pattern" in schema:
        return "names" if many else "a name of letters, digits, _ and -, a letter first"
    if kind == "boolean":
        return _KINDS[kind]
    if kind not in _KINDS:
        return ""
    name = f"{_KINDS[kind]}s" if many else f"a {_KINDS[kind]}"
    return f"{name}{_range(schema)}"


def _list(schema: dict[str, Any], defs: dict[str, Any]) -> str:
    inner = _words(schema.get("items", {}), defs, many=True)
    least, most = schema.get("minItems", 0), schema.get("maxItems")
    if inner == "tables":
        return "one table or more" if least else "tables"
    count = f"{least} " if least == most else ""
    inner = inner.replace("one of", "some of", 1)
    return f"a list of {count}{inner}" if inner else "a list"


def _range(schema: dict[str, Any]) -> str:
    low, high = schema.get("minimum"), schema.get("maximum")
    above, below = schema.get("exclusiveMinimum"), schema.get("exclusiveMaximum")
    if low is not None and high is not None:
        return f" from {low:g} to {high:g}"
    parts = []
    for value, sign in ((low, ">="), (above, ">"), (high, "<="), (below, "<")):
        if value is not None and abs(value) < _MANY:
            parts.append(f"{sign} {value:g}")
    return " " + " and ".join(parts) if parts else ""
