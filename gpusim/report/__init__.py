"""What a run found: report.json, report.html and its figures.

In the order in which data passes:

- `model`: What a run found, as plain data.
- `findings`: Parts of that: mesh, forces and stress, errors.
- `text`: Numbers as a reader sees them, and as JSON has them.
- `stage_rows`: Stages as rows for readers: a camera's pictures that are alike are one row.
- `style`: One look for all figures.
- `figures`: Deflection line, convergence, tracked markers, errors.
- `measurement_figures`: A rig and its points in space, its calibration; states compared.
- `field_maps`: Measured fields beside true ones: maps, and their differences.
- `charts`: Curves of what was computed over one quantity.
- `figure_store`: Figures that are there from an earlier report.
- `html`: report.html: one self-contained page.
- `write`: report.json, figures and report.html in the output folder.
- `correlation`: The summary of a correlation: numbers, maps, what a page says.
- `advice`: Advice on settings: what it says in words and numbers, the curves it comes from, and a
  page.
"""

from __future__ import annotations

from gpusim.report.charts import Chart, draw_chart
from gpusim.report.findings import (
    BodyForce,
    Budget,
    BudgetRow,
    Explanation,
    FieldPicture,
    LoadPath,
    LoadStepRow,
    Mechanics,
    MeshSummary,
    PartSize,
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
    "Chart",
    "Drawing",
    "Explanation",
    "FieldPicture",
    "Figure",
    "FramePair",
    "Link",
    "LoadPath",
    "LoadStepRow",
    "Measurement",
    "Mechanics",
    "MeshSummary",
    "Overlay",
    "PartSize",
    "Published",
    "Report",
    "ReportPaths",
    "Series",
    "SolutionSummary",
    "Stage",
    "StressPeak",
    "Table",
    "draw_chart",
    "prepare_figures",
    "write_report",
]


def __dir__() -> list[str]:
    return sorted(__all__)
