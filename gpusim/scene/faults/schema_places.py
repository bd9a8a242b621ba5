"""Where in the file a pydantic location is, and what the schema says about that place."""

from __future__ import annotations

import typing
from collections.abc import Sequence
from dataclasses import dataclass
from textwrap import shorten
from types import UnionType
from typing import Annotated, Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from gpusim.scene.schema.described import descriptions

__all__ = ["Place", "locate"]

Keys = tuple[str | int, ...]


@dataclass(frozen=True)
class Place:
    """A key path, the table class that its last key belongs to, and that key's type.

    ``choice``: which of the types that the value may have is meant, where it may have several.
    """

    keys: Keys
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
