"""The kind "line": displacements and strains along a straight line."""

from __future__ import annotations

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.pipeline.measurements.results import Columns
from gpusim.pipeline.measurements.series.measuring import (
    Sample,
    SeriesKind,
    mean_strains,
    register_series,
)
from gpusim.pipeline.measurements.series.placing import ReferencePicture
from gpusim.scene.description import model as m


def _points(spec: m.LineMeasureTable, picture: ReferencePicture) -> dict[str, Float]:
    """Each point, and a square of subsets around it."""
    half = 0 if spec.strain == "none" else spec.strain_window // 2
    steps = np.array(sorted(range(-half, half + 1), key=abs))
    square = spec.step_px * np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    return {name: point + square for name, point in picture.line(spec.count).items()}


def _strains(spec: m.LineMeasureTable, sample: Sample) -> Columns:
    return {} if spec.strain == "none" else mean_strains(spec, sample)


register_series(m.LineMeasureTable, SeriesKind("place", _points, _strains, moves=True))
