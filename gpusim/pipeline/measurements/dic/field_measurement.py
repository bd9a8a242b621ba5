"""What both ways of measuring a field share: from readings of frames to the result they end in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from gpusim import measure
from gpusim.arrays.array_types import Bool, Float
from gpusim.measure.correlation.subset_filter import FilteredField
from gpusim.pipeline.measurements.dic.field_columns import strain_columns
from gpusim.pipeline.measurements.dic.geometric_error import GeometricErrors, Reading, Strain
from gpusim.pipeline.measurements.dic.result import FullFieldResult
from gpusim.pipeline.measurements.dic.true_field import TrueField
from gpusim.pipeline.measurements.results import MM, Columns, PointTable
from gpusim.pipeline.measurements.sources import Sources
from gpusim.scene import Scene
from gpusim.scene.description import model as m


@dataclass(frozen=True, eq=False)
class Moved:
    """Displacements at points of which strains are taken, as `gpusim.measure` has them."""

    points: Float
    displacement: Float
    subset: float
    shape: Float
    ok: Bool


@dataclass(frozen=True, eq=False)
class FrameReading:
    """A frame at M points: ``columns`` of places and displacements; what was ``measured`` and
    ``levelled``, of which strains are taken, and the ``true`` strain, if any is asked for; columns
    of ``uncertainty``; ``raw_px`` and ``rest_px`` (C, M, 2): what is left of displacements in each
    camera's picture less the truth, and less the levelled truth."""

    columns: Columns
    measured: Reading
    levelled: Reading
    true: Float | None
    uncertainty: Columns
    raw_px: Sequence[Float]
    rest_px: Sequence[Float]


@dataclass
class FieldMeasurement:
    """``what`` measures ``spec`` of a ``scene`` in pictures of ``sources``; ``field``: the truth at
    its points, as the first camera sees it; ``frames``: which are measured."""

    what: str
    spec: m.DicTable
    scene: Scene
    sources: Sources
    field: TrueField
    frames: tuple[int, ...]

    def gauge_strain(self, found: Any, places: Float, moved: Float) -> Float:
        """Strain (M, 2, 2) of points that were at ``places`` (M, D) and ``moved`` (M, D), through
        the windows of what was ``found``."""
        raise NotImplementedError

    def strain_through(self, found: Any) -> Strain | None:
        """`gauge_strain` of what was ``found``, if strains are measured."""
        return None if self.spec.strain == "none" else partial(self.gauge_strain, found)

    def levelled(self, views: Sequence[TrueField]) -> list[FilteredField]:
        """The truth that each camera sees, as its subsets do."""
        return [
            view.levelled(self.sources.image(view.camera, 0), self.frames, self.spec)
            for view in views
        ]

    def kept(
        self, views: Sequence[TrueField], found: Sequence[Any], readings: Sequence[FrameReading],
        axes: tuple[str, ...], level: FilteredField, calibration_px: float,
        known: GeometricErrors,
    ) -> FullFieldResult:  # fmt: skip
        """The result with the settings; ``known``: in the last frame."""
        spec, count, table = self.spec, len(self.field.points), dict[int, Columns]()
        for frame, one, reading in zip(self.frames, found, readings, strict=True):
            columns = {**_places(views, frame, one.status), **reading.columns}
            if reading.true is not None:
                measured, levelled = (
                    self.gauge_strain(one, *each) for each in (reading.measured, reading.levelled)
                )
                columns |= strain_columns(measured, reading.true, levelled)
            table[frame] = columns | dict(reading.uncertainty)
        names = [f"p{number:0{len(str(count))}d}" for number in range(1, count + 1)]
        keys = "subset_px step_px shape strain strain_window blur_px formats"
        settings: dict[str, Any] = {key: getattr(spec, key) for key in keys.split()}
        return FullFieldResult(
            spec.name, PointTable.of("point", names, table), spec.views, axes, **settings,
            pixel_mm=MM * self.field.resolution(), calibration_px=float(calibration_px),
            geometric_errors=known.parts, causes=known.causes,
            raw_px=np.array([one.raw_px for one in readings]),
            rest_px=np.array([one.rest_px for one in readings]),
            slope=level.slope, contrast=level.contrast, spread=level.spread,
        )  # fmt: skip


def _places(views: Sequence[TrueField], frame: int, status: Any) -> Columns:
    """Columns that a table begins with: what became of the points, whether they are hidden from any
    of the cameras, and where they are in the reference picture."""
    seen = [one.motion.visible(one.material, one.camera, frame) for one in views]
    words = np.array([one.name for one in measure.Status])
    x, y = views[0].points.T
    return {"status": words[status], "hidden": ~np.all(seen, axis=0), "x_px": x, "y_px": y}


def where_measured(ok: Bool, values: Float) -> Float:
    """NaN where nothing was measured."""
    return np.where(ok[:, None], values, np.nan)


def span_a_surface(points: Float) -> bool:
    """Whether points (M, 2) px aren't all on one line."""
    return len(points) > 2 and int(np.linalg.matrix_rank(points - points.mean(axis=0))) == 2
