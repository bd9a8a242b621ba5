"""What the schema wants at a place, in words: "a number > 0", "a list of 3 numbers"."""

from __future__ import annotations

import json
from functools import cache
from typing import Any

from pydantic import BaseModel

__all__ = ["expected"]

_MANY = 2**31  # a count above it is no limit that anybody asks about
_KINDS = {
    "number": "number",
    "integer": "whole number",
    "string": "text",
    "boolean": "true or false",
}


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
