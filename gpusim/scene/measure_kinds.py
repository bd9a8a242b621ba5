"""Kinds of measurement that are added to gpusim's own: from then on scenes may have them.

`gpusim.pipeline.measurements.kinds.register` adds a kind with what measures by it. A package may
name the module that does so as an entry point: it is imported when a scene has that type.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import entry_points
from typing import Any

from gpusim.errors import InputError
from gpusim.scene.description.measure_table import TABLES, MeasureTable
from gpusim.scene.description.scene_table import SceneTable
from gpusim.scene.faults import schema_places
from gpusim.scene.tables.table import tables_of

GROUP = "gpusim.measurements"
"""Of entry points: the name is a ``type``, the value the module that registers it."""


def add_kind(table: type[MeasureTable]) -> None:
    """Let scenes have ``[[measure]]`` tables of another kind. Raises InputError for a ``type`` that
    another table has."""
    kind = table.kind()
    if TABLES.get(kind) is table:
        return
    if kind in TABLES:
        raise InputError(f"kind of measurement: type; got {kind!r} twice; expected a new one")
    TABLES[kind] = table
    SceneTable.model_rebuild(force=True)
    schema_places.cached_schema.cache_clear()


def load_kinds(document: Mapping[str, Any]) -> None:
    """Import what registers the types of a scene's measures that aren't known yet."""
    for _, entry in tables_of(document, "measure"):
        kind = entry.get("type")
        if isinstance(kind, str) and kind not in TABLES:
            for point in entry_points(group=GROUP, name=kind):
                point.load()
