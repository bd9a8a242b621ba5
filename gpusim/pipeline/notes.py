"""What a report says of a stage, kept with the stage's result: a run that reuses it says the same.

Only how long a stage took, and whether it ran, belong to a run.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from gpusim.report import MeshSummary

__all__ = ["Notes", "StageResult"]


@dataclass(frozen=True)
class Notes:
    """Beside the files of a stage: ``warnings``, ``facts`` by name, the ``adapter`` that it was
    made on ("" for a stage that needs none), and what the ``meshes`` are like."""

    warnings: tuple[str, ...] = ()
    facts: Mapping[str, str] = field(default_factory=dict)
    adapter: str = ""
    meshes: tuple[MeshSummary, ...] = ()

    def content(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return asdict(self)

    @staticmethod
    def of(content: Mapping[str, Any]) -> Notes:
        """The inverse of `content`. Raises KeyError, TypeError or ValueError for other data."""
        meshes = [
            MeshSummary(**{**one, "bad_cells": tuple(one["bad_cells"])})
            for one in content["meshes"]
        ]
        return Notes(
            tuple(str(text) for text in content["warnings"]),
            {str(name): str(text) for name, text in content["facts"].items()},
            str(content["adapter"]),
            tuple(meshes),
        )


@dataclass(frozen=True)
class StageResult:
    """What a stage has made: its files, and what is said of them."""

    files: list[Path]
    notes: Notes = field(default_factory=Notes)
