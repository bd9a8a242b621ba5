"""The kind "gauge": the mean strain of a rectangle, as a strain gauge there would read it."""

from __future__ import annotations

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import InputError
from gpusim.pipeline.measurements.results import Columns
from gpusim.pipeline.measurements.series.measuring import (
    Sample,
    SeriesKind,
    mean_strains,
    register_series,
)
from gpusim.pipeline.measurements.series.placing import ReferencePicture
from gpusim.scene.description import model as m


def _rectangle(spec: m.GaugeTable, picture: ReferencePicture) -> dict[str, Float]:
    """Its middle, and whole subsets within the rectangle around it."""
    center = picture.pixels("center")
    size = picture.size("size", center)
    if not (size >= spec.subset_px + spec.step_px).all():
        wide, high = size
        raise InputError(
            f"measure {spec.name!r}: size; got {wide:.0f} x {high:.0f} px; expected room for two "
            f"subsets of {spec.subset_px} px along each side, {spec.step_px} px apart"
        )
    steps = [np.arange(int((side - spec.subset_px) / spec.step_px) + 1) for side in size]
    across, down = np.meshgrid(*(spec.step_px * (one - 0.5 * one[-1]) for one in steps))
    grid = center + np.stack([across.ravel(), down.ravel()], axis=1)
    order = np.argsort(np.linalg.norm(grid - center, axis=1), kind="stable")
    return {"gauge": grid[order]}


def _strains(spec: m.GaugeTable, sample: Sample) -> Columns:
    """The principal ones, and those in the picture's axes."""
    strains = mean_strains(spec, sample)
    exx, eyy, exy = strains.values()
    mean, radius = 0.5 * (exx + eyy), np.hypot(0.5 * (exx - eyy), exy)
    return {"e1": mean + radius, "e2": mean - radius, **strains}


register_series(m.GaugeTable, SeriesKind("gauge", _rectangle, _strains))
