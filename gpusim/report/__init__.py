"""What a run found: report.json, report.html and its figures."""

from __future__ import annotations

from gpusim.report.model import (
    Figure,
    FramePair,
    Link,
    Measurement,
    Overlay,
    Report,
    Series,
    SolutionSummary,
    Stage,
)
from gpusim.report.write import ReportPaths, write_report

__all__ = [
    "Figure",
    "FramePair",
    "Link",
    "Measurement",
    "Overlay",
    "Report",
    "ReportPaths",
    "Series",
    "SolutionSummary",
    "Stage",
    "write_report",
]
