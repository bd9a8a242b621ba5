"""What a body's mesh is like: sizes and quality, for the report."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from gpusim.report.numbers import json_number

__all__ = ["MeshSummary"]


@dataclass(frozen=True)
class MeshSummary:
    """Counts and quality of a body's mesh.

    ``cells`` is cell type -> number. ``least_jacobian`` is the least scaled Jacobian (1 for a
    brick, <= 0 inverted), ``greatest_aspect`` the greatest ratio of a cell's edges. ``bad_cells``
    are the numbers of the worst cells outside the usual limits, ``bad_count`` how many there are,
    and ``remark`` says it all in one line.
    """

    body: str
    nodes: int
    cells: Mapping[str, int]
    least_jacobian: float
    greatest_aspect: float
    bad_count: int
    bad_cells: tuple[int, ...]
    remark: str
    extent: float = 0.0
    """Diagonal of the box around the nodes, m."""

    def content(self) -> dict[str, Any]:
        """For report.json."""
        return {
            "body": self.body,
            "nodes": self.nodes,
            "cells": dict(self.cells),
            "least_scaled_jacobian": json_number(self.least_jacobian),
            "greatest_aspect": json_number(self.greatest_aspect),
            "bad_cells": {"count": self.bad_count, "worst": list(self.bad_cells)},
            "remark": self.remark,
        }
