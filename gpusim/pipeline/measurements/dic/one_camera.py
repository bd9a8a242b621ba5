"""A field measured by one camera, in px and in mm.

Lengths are along the picture's right and down as they lie in the surface, by a scale, or along the
axes of a calibration target that lies on the surface: then the lens is undone.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from gpusim import measure
from gpusim.arrays.array_types import Float
from gpusim.errors import GpusimError
from gpusim.measure.correlation.strain import strain_tensor
from gpusim.measure.targets.plumb_lines import field_slope
from gpusim.pipeline.measurements.dic.correlating import correlate_pictures
from gpusim.pipeline.measurements.dic.field_columns import compared_columns, shape_columns
from gpusim.pipeline.measurements.dic.field_measurement import (
    FieldMeasurement,
    FrameReading,
    Moved,
    where_measured,
)
from gpusim.pipeline.measurements.dic.geometric_error import GeometricErrors, errors_of_one
from gpusim.pipeline.measurements.dic.result import FullFieldResult
from gpusim.pipeline.measurements.dic.true_field import inverse_slopes
from gpusim.pipeline.measurements.results import MM
from gpusim.pipeline.measurements.sources import calibrated

MOST_ALIGNED = 10_000
"""Pixels that tell how a target's plane lies on the structure."""


@dataclass(frozen=True, eq=False)
class _Scale:
    """Pixels as mm: ``mapping`` of places in the picture; ``axes`` (2, 3) that these are along in
    the world, and their ``names``; ``slope`` (M, 2, 2) mm per px at the points."""

    mapping: Any
    axes: Float
    names: tuple[str, str]
    slope: Float
    calibration_px: float = float("nan")


class OneCamera(FieldMeasurement):
    """The field that one camera sees."""

    def result(self) -> FullFieldResult:
        """All frames."""
        field, motion = self.field, self.field.motion
        found = correlate_pictures(
            self.spec, self.sources, field.points, field.roi.mask, self.frames
        )
        (level,) = self.levelled([field])
        readings = [
            self._reading(*each)
            for each in zip(self.frames, found, level.displacement, strict=True)
        ]
        scale, axes, calibration = self.scale, ("the picture's x", "the picture's y"), np.nan
        known = GeometricErrors()
        if scale is not None:
            axes, calibration = scale.names, scale.calibration_px
            known = errors_of_one(
                motion.camera(field.camera), motion.position(field.material, 0),
                motion.displacement(field.material, self.frames[-1]), scale.mapping, scale.axes,
                self.spec.plane_pose is not None, self.strain_through(found[-1]),
            )  # fmt: skip
        return self.kept([field], found, readings, axes, level, calibration, known)

    def _reading(self, frame: int, one: measure.DicResult, smooth: Float) -> FrameReading:
        field, scale, kind = self.field, self.scale, self.spec.strain
        true = field.shift(frame)
        columns = compared_columns(("u_px", "v_px"), one.displacement, true, smooth)
        measured, levelled = (field.points, one.displacement), (field.points, smooth)
        if scale is not None:
            motion = MM * field.motion.displacement(field.material, frame)
            moved = motion @ scale.axes.T
            slow = moved + np.einsum("mij,mj->mi", scale.slope, smooth - true)
            places = MM * field.motion.position(field.material, 0) @ scale.axes.T
            mapped = measure.mapped(one, scale.mapping)
            columns = {
                **columns,
                "true_w_mm": motion @ np.cross(*scale.axes),
                **compared_columns(("u_mm", "v_mm"), mapped.displacement, moved, slow),
                "sigma_mm": mapped.sigma,
                **shape_columns("xy", mapped.points, places),
            }
            measured, levelled = (mapped.points, mapped.displacement), (places, slow)
        strain = (
            None if kind == "none"
            else field.picture_strain(frame, kind) if scale is None
            else field.plane_strain(frame, kind, scale.axes)
        )  # fmt: skip
        return FrameReading(
            columns, measured, levelled, strain, {"zncc": one.zncc, "sigma_px": one.sigma},
            [one.displacement - true], [one.displacement - smooth],
        )  # fmt: skip

    def gauge_strain(self, found: measure.DicResult, places: Float, moved: Float) -> Float:
        """Along the axes of these. Windows are those of the picture's grid, however a mapping bends
        it."""
        fields = (
            Moved(found.points, where_measured(found.ok, values), found.subset, places, found.ok)
            for values in (places, moved)
        )
        slopes = [
            measure.strain(one, window=self.spec.strain_window, kind="small").gradient
            for one in fields
        ]
        known = np.isfinite(slopes).all(axis=(0, 2, 3))
        gradient = np.full_like(slopes[0], np.nan)
        gradient[known] = slopes[1][known] @ inverse_slopes(slopes[0][known])
        kind: Any = self.spec.strain
        return strain_tensor(gradient, kind)

    @cached_property
    def scale(self) -> _Scale | None:
        """How the picture is read in mm; None if it isn't."""
        per_px, pose = self.spec.mm_per_px, self.spec.plane_pose
        if per_px is not None:
            slope = np.tile(per_px * np.eye(2), (len(self.field.points), 1, 1))
            axes = self.field.picture_axes()
            return _Scale(lambda pixels: per_px * pixels, axes, _axis_names(axes), slope)
        return None if pose is None else self._on_plane(pose)

    def _on_plane(self, number: int) -> _Scale:
        """By the target in a pose of the calibration."""
        field = self.field
        _, calibration = calibrated(self.spec, self.scene, self.sources.corners)
        pose = calibration.view_poses[number]
        if not np.isfinite(pose).all():
            raise GpusimError(
                f"{self.what}: plane_pose; got {number}, in whose picture camera "
                f"{field.camera!r} doesn't find the target; expected another pose"
            )
        mapping = measure.plane_mapping(calibration.cameras[0], pose)
        some = slice(None, None, -(-len(field.roi.points) // MOST_ALIGNED))
        place = mapping(np.argwhere(field.roi.mask)[some, ::-1].astype(np.float64))
        position = MM * field.motion.position(field.roi.points[some], 0)
        laid = measure.align(np.column_stack([place, np.zeros(len(place))]), position)
        slope, names = field_slope(mapping, field.points), ("the target's x", "the target's y")
        return _Scale(mapping, laid.rotation.T[:2], names, slope, calibration.rms)


def _axis_names(axes: Float) -> tuple[str, str]:
    """What the picture's axes (2, 3) are called: world axes if they are some."""
    named = {
        tuple(sign * row): f"{word}{axis}"
        for sign, word in ((1.0, "+"), (-1.0, "-"))
        for axis, row in zip("xyz", np.eye(3), strict=True)
    }
    right, down = (named.get(tuple(row)) for row in axes)
    return right or "the picture's right", down or "the picture's down"
