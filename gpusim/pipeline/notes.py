"""What a report says of a stage, kept with the stage's result: a run that reuses it says the same.

Only how long a stage took, and whether it ran, belong to a run.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from gpusim.report import MeshSummary


@dataclass(frozen=True)
class Notes:
    """``warnings``, ``facts`` by name, the ``adapter`` that a stage was made on ("" for one that
    needs none), and what the ``meshes`` are like. ``first_warnings``: by what they are about; of
    those about the same thing the report has the first one alone."""

    warnings: tuple[str, ...] = ()
    facts: Mapping[str, str] = field(default_factory=dict)
    adapter: str = ""
    meshes: tuple[MeshSummary, ...] = ()
    first_warnings: Mapping[str, str] = field(default_factory=dict)

    @staticmethod
    def of(content: Mapping[str, Any]) -> Notes:
        """From plain data, of which other things may be said as well."""
        meshes = [
            MeshSummary(**{**one, "bad_cells": tuple(one["bad_cells"])})
            for one in content.get("meshes", ())
        ]
        return Notes(
            tuple(content.get("warnings", ())),
            content.get("facts", {}),
            content.get("adapter", ""),
            tuple(meshes),
            content.get("first_warnings", {}),
        )


def notes_of(
    warnings: Sequence[str] = (), facts: Mapping[str, str] | None = None, adapter: str = ""
) -> dict[str, Any]:
    """Notes as plain data."""
    return asdict(Notes(tuple(warnings), facts or {}, adapter))
