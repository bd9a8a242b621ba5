"""What the JSON schema of a scene file says, for editors and of a place in the file."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from textwrap import shorten
from typing import Any

from gpusim.scene.description.scene_table import SceneTable

Node = Mapping[str, Any]
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


cached_schema = cache(json_schema)


@dataclass(frozen=True)
class Place:
    """A key path, and what the schema says of the table that its last key belongs to, and of the
    value there.

    ``choice``: which of the types that the value may have is meant, where it may have several.
    ``kinds``: the tables by their tag of which ``table`` is one.
    """

    keys: tuple[str | int, ...]
    table: Node
    value: Node
    choice: str = ""
    kinds: Mapping[str, Node] = field(default_factory=dict)

    @property
    def kinds_with_key(self) -> list[str]:
        """Tags of the tables beside it that have the last key."""
        return [tag for tag, one in self.kinds.items() if self.keys[-1] in one["properties"]]

    @property
    def valid_keys(self) -> list[str]:
        """Every key of the table."""
        return list(self.table["properties"])

    @property
    def description(self) -> str:
        """First clause of what the schema says about the last key, else ""."""
        text = str(self.value.get("description", ""))
        return shorten(text.split(";")[0].rstrip("."), 100, placeholder=" ...")

    @property
    def tags(self) -> list[str]:
        """Values of the key that chooses the variant, if there are variants here."""
        return list(table_kinds(plain_node(self.value)))


def locate(location: Sequence[str | int], schema: Node | None = None) -> Place:
    """The place of a pydantic location; union tags, which are no keys of the file, are left out.
    ``schema``: of another file than a scene's, without references."""
    keys: list[str | int] = []
    here: Node = schema or cached_schema()
    table = value = here
    kinds: Mapping[str, Node] = {}
    for step in location:
        here = plain_node(here)
        variants = table_kinds(here)
        if step in variants:
            here, kinds = variants[str(step)], variants
            continue
        if isinstance(step, str) and "anyOf" in here:
            return Place(tuple(keys), table, value, step)
        if isinstance(step, int):
            here = here.get("items", {})
        elif "properties" in here:
            kinds = kinds if here in kinds.values() else {}
            table, here = here, here["properties"].get(step, {})
        value = here
        keys.append(step)
    return Place(tuple(keys), table, value, kinds=kinds)


def _of_reference(reference: str) -> Node:
    found: Node = cached_schema()["$defs"][reference.rsplit("/", 1)[-1]]
    return found


def plain_node(node: Node) -> Node:
    """What a reference refers to; without the choice of having no value."""
    while True:
        options = [one for one in node.get("anyOf", ()) if one.get("type") != "null"]
        if "$ref" in node:
            node = _of_reference(node["$ref"])
        elif len(options) == 1:
            (node,) = options
        else:
            return node


def table_kinds(node: Node) -> dict[str, Node]:
    """Tag -> table of a choice of tables that ``type`` or ``builder`` tells apart; else empty."""
    if "discriminator" not in node:
        return {}
    key = node["discriminator"]["propertyName"]
    tables = [plain_node(one) for one in node["oneOf"]]
    return {table["properties"][key]["const"]: table for table in tables}


def expected(schema: Node, many: bool = False) -> str:
    """Words for a value, or for ``many`` of them; "" if there are none."""
    if "$ref" in schema:
        return expected(_of_reference(schema["$ref"]), many)
    if "const" in schema or "enum" in schema:
        values = schema.get("enum", [schema.get("const")])
        text = ", ".join(json.dumps(value) for value in values)
        return f"one of {text}" if len(values) > 1 else text
    options = [one for one in schema.get("anyOf", schema.get("oneOf", []))
               if one.get("type") != "null"]  # fmt: skip
    if options:
        *others, last = dict.fromkeys(_option(one, many) for one in options)
        return f"{', '.join(others)}, or {last}" if others else last
    kind = schema.get("type")
    if kind == "object":
        return "tables" if many else "a table"
    if kind == "array":
        text = _list(schema)
        return text.replace("a list", "lists", 1) if many else text
    if "pattern" in schema and "examples" in schema:
        return f"{'texts' if many else 'a text'} like {json.dumps(schema['examples'][0])}"
    if "pattern" in schema:
        return "names" if many else "a name of letters, digits, _ and -, a letter first"
    if kind == "boolean":
        return _KINDS[kind]
    if kind not in _KINDS:
        return ""
    name = f"{_KINDS[kind]}s" if many else f"a {_KINDS[kind]}"
    return f"{name}{_range(schema)}"


def _option(schema: Node, many: bool) -> str:
    text = expected(schema, many)
    return f"{text} ({schema['title']})" if "title" in schema else text


def _list(schema: Node) -> str:
    inner = expected(schema.get("items", {}), many=True)
    least, most = schema.get("minItems", 0), schema.get("maxItems")
    if inner == "tables":
        return "one table or more" if least else "tables"
    count = f"{least} " if least == most else ""
    inner = inner.replace("one of", "some of", 1)
    return f"a list of {count}{inner}" if inner else "a list"


def _range(schema: Node) -> str:
    low, high = schema.get("minimum"), schema.get("maximum")
    above, below = schema.get("exclusiveMinimum"), schema.get("exclusiveMaximum")
    if low is not None and high is not None:
        return f" from {low:g} to {high:g}"
    parts = []
    for value, sign in ((low, ">="), (above, ">"), (high, "<="), (below, "<")):
        if value is not None and abs(value) < _MANY:
            parts.append(f"{sign} {value:g}")
    return " " + " and ".join(parts) if parts else ""
