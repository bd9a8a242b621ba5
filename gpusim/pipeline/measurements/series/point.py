"""The kind "point": displacements of named points."""

from __future__ import annotations

from gpusim.arrays.array_types import Float
from gpusim.pipeline.measurements.series.measuring import SeriesKind, register_series
from gpusim.pipeline.measurements.series.placing import ReferencePicture
from gpusim.scene.description import model as m


def _points(spec: m.PointMeasureTable, picture: ReferencePicture) -> dict[str, Float]:
    points = picture.pixels("points")
    names = spec.names or [f"p{number}" for number in range(1, len(points) + 1)]
    return dict(zip(names, points[:, None], strict=True))


register_series(m.PointMeasureTable, SeriesKind("point", _points, moves=True))
