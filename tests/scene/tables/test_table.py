"""Texts of the schema's keys, and a start of commands without garbage collection."""

from __future__ import annotations

import gc

import pytest

from gpusim.cli.console import importing
from gpusim.scene import json_schema
from gpusim.scene.description.ground import PaintedTable
from gpusim.scene.description.model import SceneTable
from gpusim.scene.description.paint import SpeckleTable
from gpusim.scene.tables.table import Table, descriptions


class _Base(Table):
    """Not a key's text."""

    first: float = 1.0
    """Of the base."""
    bare: int = 2


class _Derived(_Base):
    second_mm: tuple[float, ...] = (1.0,)
    """Two lines,
    put together as they are."""
    first: float = 3.0
    """Said again."""


def test_texts_are_those_below_the_keys() -> None:
    assert descriptions(_Base) == {"first": "Of the base."}
    assert descriptions(_Derived) == {
        "first": "Said again.",
        "second_mm": "Two lines,\nput together as they are.",
    }
    assert descriptions(SpeckleTable)["roughness"] == descriptions(PaintedTable)["roughness"]


def test_schema_for_editors_holds_them_all() -> None:
    schema = json_schema()

    held = [field.get("description") for field in schema["properties"].values()]
    assert set(descriptions(SceneTable).values()) <= set(held)
    # keys with another name in the file; classes are found by their names, which are unique
    assert "description" in schema["properties"]["schema"]
    assert "amplitude" in schema["$defs"]["SupportTable"]["properties"]
    assert not [name for name in schema["$defs"] if "__" in name]


@pytest.mark.parametrize("enabled", [True, False])
def test_collection_is_as_it_was_after_importing(enabled: bool) -> None:
    before = gc.isenabled()
    try:
        (gc.enable if enabled else gc.disable)()
        with pytest.raises(KeyError), importing():
            assert not gc.isenabled()
            raise KeyError
        assert gc.isenabled() == enabled
    finally:
        (gc.enable if before else gc.disable)()
        gc.unfreeze()


def test_tables_are_named_so() -> None:
    """A class that is a table of the file isn't mistaken for what is built of it."""

    def below(table: type[Table]) -> set[type[Table]]:
        return {table}.union(*map(below, table.__subclasses__()))

    named = {table.__name__ for table in below(Table) if table.__module__.startswith("gpusim")}
    wrong = [name for name in named if not name.endswith("Table") and not name.startswith("_")]
    assert len(named) > 60 and wrong == []
