"""What both ways of measuring a field share: columns of its table, and the result they end in."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim import measure
from gpusim.arrays.array_types import Bool, Float
from gpusim.measure.correlation.subset_filter import FilteredField
from gpusim.pipeline.measurements.dic.result import FullFieldResult
from gpusim.pipeline.measurements.dic.true_field import TrueField
from gpusim.pipeline.measurements.results import Columns, PointTable
from gpusim.pipeline.measurements.sources import Sources
from gpusim.scene import Scene
from gpusim.scene.description import model as m

MM = 1e3
STRAINS = {"exx": (0, 0), "eyy": (1, 1), "exy": (0, 1)}


@dataclass(frozen=True, eq=False)
class Moved:
    """Displacements at points of which strains are taken, as `gpusim.measure` has them."""

    points: Float
    displacement: Float
    subset: float
    shape: Float
    ok: Bool


@dataclass(frozen=True)
class GeometricErrors:
    """Errors (M, Q) of displacements and strains that no match has made: ``parts``, which add up,
    and what each of the ``causes`` of the part "calibration" does alone."""

    parts: Mapping[str, Float] = field(default_factory=dict)
    causes: Mapping[str, Float] = field(default_factory=dict)


@dataclass
class FieldMeasurement:
    """``what`` measures ``spec`` of a ``scene`` in pictures of ``sources``; ``field``: the truth at
    its points; ``frames``: which are measured."""

    what: str
    spec: m.DicTable
    scene: Scene
    sources: Sources
    field: TrueField
    frames: tuple[int, ...]

    def kept(
        self,
        table: dict[int, Columns],
        axes: tuple[str, ...],
        errors: Float,
        level: FilteredField,
        calibration_px: float,
        known: GeometricErrors,
    ) -> FullFieldResult:
        """The result with the settings; ``errors`` (2, F, C, M, 2) px less the truth and less the
        levelled truth; ``known``: by `geometric_error`."""
        spec, count = self.spec, len(self.field.points)
        names = [f"p{number:0{len(str(count))}d}" for number in range(1, count + 1)]
        keys = "subset_px step_px shape strain strain_window blur_px formats"
        settings: dict[str, Any] = {key: getattr(spec, key) for key in keys.split()}
        return FullFieldResult(
            spec.name, PointTable.of("point", names, table), spec.views, axes, **settings,
            pixel_mm=MM * self.field.resolution(), calibration_px=float(calibration_px),
            geometric_errors=known.parts, causes=known.causes,
            raw_px=errors[0], rest_px=errors[1],
            slope=level.slope, contrast=level.contrast, spread=level.spread,
        )  # fmt: skip


def columns_of_places(
    views: Sequence[TrueField], frame: int, status: npt.NDArray[np.int8]
) -> dict[str, npt.NDArray[Any]]:
    """Columns that a table begins with: what became of the points, whether they are ``hidden`` from
    any of the cameras in a frame, and where they are in the reference picture."""
    seen = [one.motion.visible(one.material, one.camera, frame) for one in views]
    words = np.array([one.name for one in measure.Status])
    x, y = views[0].points.T
    return {"status": words[status], "hidden": ~np.all(seen, axis=0), "x_px": x, "y_px": y}


def compared_columns(names: tuple[str, ...], *values: Float) -> Columns:
    """Columns of quantities (M, K): measured, true, levelled."""
    return {
        f"{kind}_{name}": column
        for kind, each in zip(("measured", "true", "levelled"), values, strict=True)
        for name, column in zip(names, each.T, strict=True)
    }


def shape_columns(axes: str, found: Float, true: Float) -> Columns:
    """Columns of places (M, K) mm in the first pictures: measured and true."""
    return {
        f"{kind}_{axis}_mm": column
        for kind, each in (("measured", found), ("true", true))
        for axis, column in zip(axes, each.T, strict=True)
    }


def strain_columns(*tensors: Float) -> Columns:
    """The same of strains (M, 2, 2)."""
    return compared_columns(tuple(STRAINS), *map(strain_components, tensors))


def strain_components(tensor: Float) -> Float:
    """(M, 3): those of `STRAINS`."""
    return np.stack([tensor[:, i, j] for i, j in STRAINS.values()], axis=1)


def where_measured(ok: Bool, values: Float) -> Float:
    """NaN where nothing was measured."""
    return np.where(ok[:, None], values, np.nan)
