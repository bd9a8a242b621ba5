"""What the schema says about each key: the text below it in the source.

Read when somebody asks for it. pydantic would read it whenever the classes are made
(``use_attribute_docstrings``): a third of the time that a scene's classes take, in every
command.
"""

from __future__ import annotations

import ast
import inspect
from functools import cache
from textwrap import dedent
from typing import Any

from pydantic import BaseModel

from .base import Table

__all__ = ["add_descriptions", "descriptions"]


@cache
def descriptions(table: type[BaseModel]) -> dict[str, str]:
    """Text by the name of the field, those of the classes that ``table`` derives from included."""
    found: dict[str, str] = {}
    for owner in reversed(table.__mro__):
        if issubclass(owner, BaseModel) and owner is not BaseModel:
            found |= _own(owner)
    return found


def _own(table: type[BaseModel]) -> dict[str, str]:
    (body,) = ast.parse(dedent(inspect.getsource(table))).body
    assert isinstance(body, ast.ClassDef)
    found = {}
    for field, text in zip(body.body, body.body[1:], strict=False):
        if (
            isinstance(field, ast.AnnAssign)
            and isinstance(field.target, ast.Name)
            and isinstance(text, ast.Expr)
            and isinstance(text.value, ast.Constant)
            and isinstance(text.value.value, str)
        ):
            found[field.target.id] = inspect.cleandoc(text.value.value)
    return found


def add_descriptions(schema: dict[str, Any], root: type[BaseModel]) -> None:
    """Put the texts into a JSON schema of ``root``, in place."""
    tables = _tables()
    for name, definition in (*schema.get("$defs", {}).items(), (root.__name__, schema)):
        if name not in tables:
            continue
        texts, fields = descriptions(tables[name]), tables[name].model_fields
        for key, field in definition.get("properties", {}).items():
            own = next(own for own, info in fields.items() if key == (info.alias or own))
            if own in texts:
                field["description"] = texts[own]


def _tables() -> dict[str, type[BaseModel]]:
    """Every table class, by the names that pydantic gives them: two may share one."""
    found: dict[str, type[BaseModel]] = {}
    queue: list[type[BaseModel]] = [Table]
    while queue:
        table = queue.pop()
        found[table.__name__] = table
        found[f"{table.__module__}.{table.__name__}".replace(".", "__")] = table
        queue += table.__subclasses__()
    return found
