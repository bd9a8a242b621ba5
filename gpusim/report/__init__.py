"""What a run found: report.json, report.html and its figures."""

from __future__ import annotations

from gpusim.report.findings import (
    BodyForce,
    Budget,
    BudgetRow,
    Mechanics,
    MeshSummary,
    Published,
    StressPeak,
)
from gpusim.report.model import (
    Drawing,
    Figure,
    FramePair,
    Link,
    Measurement,
    Overlay,
    Report,
    Series,
    SolutionSummary,
    Stage,
    Table,
)
from gpusim.report.write import ReportPaths, prepare_figures, write_report

__all__ = [
    "BodyForce",
    "Budget",
    "BudgetRow",
    "Drawing",
    "Figure",
    "FramePair",
    "Link",
    "Measurement",
    "Mechanics",
    "MeshSummary",
    "Overlay",
    "Published",
    "Report",
    "ReportPaths",
    "Series",
    "SolutionSummary",
    "Stage",
    "StressPeak",
    "Table",
    "prepare_figures",
    "write_report",
]


def __dir__() -> list[str]:
    return sorted(__all__)
