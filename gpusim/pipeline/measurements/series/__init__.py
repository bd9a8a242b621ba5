"""The kinds "extensometer", "gauge", "line" and "point": a few places over frames.

In the order in which data passes:

- `placing`: Where subsets lie in the reference picture, for places that a scene names.
- `measuring`: Subsets of a few places followed over frames, and what a kind makes of them.
- `extensometer`: The kind "extensometer": the length between two ends, and its engineering strain.
- `gauge`: The kind "gauge": the mean strain of a rectangle, as a strain gauge there would read it.
- `line`: The kind "line": displacements and strains along a straight line.
- `point`: The kind "point": displacements of named points.
- `result`: Quantities of a few places over frames, measured and true: table, series, what the
  report says.
"""

from gpusim.pipeline.measurements.series import extensometer, gauge, line, point
from gpusim.pipeline.measurements.series.result import SeriesResult

__all__ = ["SeriesResult", "extensometer", "gauge", "line", "point"]
