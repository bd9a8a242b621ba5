"""A field measured by one camera, in px and in mm.

Lengths are along the world axes nearest to the picture's right and down, by a scale, or along the
axes of a calibration target that lies on the surface: then the lens is undone.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from gpusim import measure
from gpusim.arrays.array_types import Float
from gpusim.errors import GpusimError
from gpusim.measure.correlation.strain import strain_tensor
from gpusim.measure.targets.plumb_lines import field_slope
from gpusim.pipeline.measurements.dic.correlating import (
    correlate_pictures,
)
from gpusim.pipeline.measurements.dic.field_measurement import (
    MM,
    FieldMeasurement,
    GeometricErrors,
    Moved,
    columns_of_places,
    compared_columns,
    shape_columns,
    strain_columns,
    where_measured,
)
from gpusim.pipeline.measurements.dic.geometric_error import errors_of_one
from gpusim.pipeline.measurements.dic.result import FullFieldResult
from gpusim.pipeline.measurements.dic.true_field import inverse_slopes
from gpusim.pipeline.measurements.results import Columns
from gpusim.pipeline.measurements.sources import calibrated
from gpusim.pipeline.scene_objects.cameras import image_axes
from gpusim.scene.description import model as m

MOST_ALIGNED = 10_000
"""Pixels that tell how a target's plane lies on the structure."""


class OneCamera(FieldMeasurement):
    """The field that one camera sees."""

    def result(self) -> FullFieldResult:
        """All frames."""
        spec, field, points = self.spec, self.field, self.field.points
        found = correlate_pictures(spec, self.sources, points, field.roi.mask, self.frames)
        reference = self.sources.image(field.camera, 0)
        levelled = field.levelled(reference, self.frames, spec)
        scale = _scale_of(self, found[0])
        table, raw, rest = dict[int, Columns](), [], []
        for frame, one, smooth in zip(self.frames, found, levelled.displacement, strict=True):
            true = field.shift(frame)
            columns = columns_of_places([field], frame, one.status)
            columns |= compared_columns(("u_px", "v_px"), one.displacement, true, smooth)
            places, shifts = (points, points), (one.displacement, smooth)
            if scale is not None:
                motion = MM * field.motion.displacement(field.material, frame)
                moved = motion @ scale.axes.T
                columns["true_w_mm"] = motion @ np.cross(*scale.axes)
                slow = moved + np.einsum("mij,mj->mi", scale.slope, smooth - true)
                found_mm = measure.mapped(one, scale.mapping)
                columns |= compared_columns(("u_mm", "v_mm"), found_mm.displacement, moved, slow)
                columns["sigma_mm"] = found_mm.sigma
                true_places = MM * field.motion.position(field.material, 0) @ scale.axes.T
                columns |= shape_columns("xy", found_mm.points, true_places)
                places, shifts = (found_mm.points, true_places), (found_mm.displacement, slow)
            if spec.strain != "none":
                at = (
                    field.picture_strain(frame, spec.strain) if scale is None
                    else field.plane_strain(frame, spec.strain, scale.axes)
                )  # fmt: skip
                tensors = [
                    _gauge_strain(spec, one, place, shift)
                    for place, shift in zip(places, shifts, strict=True)
                ]
                columns |= strain_columns(tensors[0], at, tensors[1])
            table[frame] = columns | {"zncc": one.zncc, "sigma_px": one.sigma}
            raw.append([one.displacement - true])
            rest.append([one.displacement - smooth])
        axes = ("the picture's x", "the picture's y") if scale is None else scale.names
        calibration = np.nan if scale is None else scale.calibration_px
        known = GeometricErrors() if scale is None else self._known(found[-1], scale)
        return self.kept(table, axes, np.array([raw, rest]), levelled, calibration, known)

    def _known(self, found: measure.DicResult, scale: _Scale) -> GeometricErrors:
        """Errors of the last frame that aren't the matches'."""
        motion, material = self.field.motion, self.field.material
        strain = None if self.spec.strain == "none" else partial(_gauge_strain, self.spec, found)
        return errors_of_one(
            motion.camera(self.field.camera), motion.position(material, 0),
            motion.displacement(material, self.frames[-1]), scale.mapping, scale.axes,
            self.spec.plane_pose is not None, strain,
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Scale:
    """Pixels as mm: ``mapping`` of places in the picture; ``axes`` (2, 3) that these are along in
    the world, and their ``names``; ``slope`` (M, 2, 2) mm per px at the points."""

    mapping: Any
    axes: Float
    names: tuple[str, str]
    slope: Float
    calibration_px: float = float("nan")


def _scale_of(single: OneCamera, found: measure.DicResult) -> _Scale | None:
    """How the pictures of one camera are read in mm; None if they aren't."""
    spec, field, points = single.spec, single.field, single.field.points
    if spec.mm_per_px is not None:
        per_px = spec.mm_per_px
        names, axes = image_axes(field.motion.camera(field.camera))
        down = {"+": "-", "-": "+"}[names[1][0]] + names[1][1]
        slope = np.tile(per_px * np.eye(2), (len(points), 1, 1))
        turned = axes * [[1.0], [-1.0]]
        return _Scale(lambda pixels: per_px * pixels, turned, (names[0], down), slope)
    if spec.plane_pose is None:
        return None
    _, calibration = calibrated(spec, single.scene, single.sources.corners)
    pose = calibration.view_poses[spec.plane_pose]
    if not np.isfinite(pose).all():
        raise GpusimError(
            f"{single.what}: plane_pose; got {spec.plane_pose}, in whose picture camera "
            f"{field.camera!r} doesn't find the target; expected another pose"
        )
    mapping = measure.plane_mapping(calibration.cameras[0], pose)
    some = slice(None, None, -(-len(field.roi.points) // MOST_ALIGNED))
    place = mapping(np.argwhere(field.roi.mask)[some, ::-1].astype(np.float64))
    position = MM * field.motion.position(field.roi.points[some], 0)
    laid = measure.align(np.column_stack([place, np.zeros(len(place))]), position)
    slope = field_slope(mapping, points)
    names = ("the target's x", "the target's y")
    return _Scale(mapping, laid.rotation.T[:2], names, slope, calibration.rms)


def _gauge_strain(spec: m.DicTable, found: measure.DicResult, places: Float, moved: Float) -> Float:
    """Strain (M, 2, 2) of points that are at ``places`` (M, 2) and ``moved`` (M, 2), along the axes
    of these. Windows are those of the picture's grid, however a mapping bends it."""
    fields = (
        Moved(found.points, where_measured(found.ok, values), found.subset, places, found.ok)
        for values in (places, moved)
    )
    slopes = [
        measure.strain(one, window=spec.strain_window, kind="small").gradient for one in fields
    ]
    known = np.isfinite(slopes).all(axis=(0, 2, 3))
    gradient = np.full_like(slopes[0], np.nan)
    gradient[known] = slopes[1][known] @ inverse_slopes(slopes[0][known])
    kind: Any = spec.strain
    return strain_tensor(gradient, kind)
