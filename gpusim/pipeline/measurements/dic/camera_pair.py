"""A field measured by two calibrated cameras: shape and displacement in space, strain in the
surface.

Lengths are along the world's axes: the rig's results are laid on the structure by the rigid motion
that brings the places measured in the first pictures nearest to the true ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from gpusim import measure
from gpusim.arrays.array_types import Float
from gpusim.errors import GpusimError
from gpusim.optics.camera.pinhole import Camera
from gpusim.pipeline.measurements.dic.correlating import correlate_pairs
from gpusim.pipeline.measurements.dic.field_columns import compared_columns, shape_columns
from gpusim.pipeline.measurements.dic.field_measurement import (
    FieldMeasurement,
    FrameReading,
    Moved,
    span_a_surface,
    where_measured,
)
from gpusim.pipeline.measurements.dic.geometric_error import GeometricErrors, errors_of_pair
from gpusim.pipeline.measurements.dic.result import FullFieldResult
from gpusim.pipeline.measurements.dic.rig import Rig, calibrated_rig, rig_of
from gpusim.pipeline.measurements.dic.true_field import TrueField, region_of_second_camera
from gpusim.pipeline.measurements.results import MM


class CameraPair(FieldMeasurement):
    """The field that both cameras of a pair see."""

    def result(self) -> FullFieldResult:
        """All frames."""
        spec, field, (left, right) = self.spec, self.field, self.spec.views
        motion, material = field.motion, field.material
        cameras = motion.camera(left), motion.camera(right)
        rig, calibration_px = calibrated_rig(spec, self.scene, self.sources, cameras)
        region = region_of_second_camera(motion, field.roi, left, right)
        masks = field.roi.mask, region.mask
        found = correlate_pairs(spec, self.sources, field.points, masks, rig, self.frames)
        # where the second camera sees the points is known to the truth
        seen = motion.pixels(material, right, 0)
        views = field, TrueField(motion, right, region, seen, material)
        levels = self.levelled(views)
        place = MM * motion.position(material, 0)
        laid = self._laid(found, place)
        moved = np.stack([level.displacement for level in levels], axis=1)
        readings = []
        for frame, one, shift in zip(self.frames, found, moved, strict=True):
            true = MM * motion.displacement(material, frame)
            smooth = _seen_by(cameras, np.array([view.points for view in views]), shift)
            turned = one.displacement @ laid.rotation.T
            strain = None if spec.strain == "none" else field.surface_strain(frame, spec.strain)
            sigma, in_picture = _uncertainty(one, rig, laid.rotation)
            raw, rest = (
                [_in_picture(camera, place + true, turned - other) for camera in cameras]
                for other in (true, smooth)
            )
            readings.append(FrameReading(
                {
                    **shape_columns("XYZ", laid.apply(one.shape), place),
                    **compared_columns(("U_mm", "V_mm", "W_mm"), turned, true, smooth),
                },
                (one.shape, one.displacement), (place, smooth), strain,
                {
                    **{f"sigma_{q}_mm": s for q, s in zip("UVW", sigma.T, strict=True)},
                    "sigma_each_camera_px": in_picture,
                    "residual_px": one.residual,
                },
                raw, rest,
            ))  # fmt: skip
        last, known = found[-1], GeometricErrors()
        if span_a_surface(last.points[last.ok]):
            after = [motion.pixels(material, name, self.frames[-1]) for name in spec.views]
            pixels = [
                np.array([where_measured(last.ok, one) for one in each])
                for each in ([view.points for view in views], after)
            ]
            known = errors_of_pair(rig_of(cameras), rig, pixels, place, self.strain_through(last))
        axes = "+x", "+y", "+z"
        return self.kept(views, found, readings, axes, levels[0], calibration_px, known)

    def gauge_strain(self, found: measure.StereoResult, places: Float, moved: Float) -> Float:
        """In the surface."""
        kind: Any = self.spec.strain
        one = Moved(found.points, where_measured(found.ok, moved), found.subset, places, found.ok)
        return measure.surface_strain(one, window=self.spec.strain_window, kind=kind).tensor

    def _laid(self, found: Sequence[measure.StereoResult], place: Float) -> measure.Alignment:
        """The rigid motion from the rig's axes to the structure's, from the points' places in the
        first pictures."""
        for one in found:
            if span_a_surface(one.points[one.ok]):
                return measure.align(one.shape, place)
        raise GpusimError(
            f"{self.what}: got no three points, not on one line, that both cameras see in any "
            "frame; expected a textured surface that both see"
        )


def _seen_by(cameras: tuple[Camera, Camera], before: Float, moved: Float) -> Float:
    """Displacements (M, 3) mm, in the world, of points that two true cameras see at places
    ``before`` (2, M, 2) px and then ``moved`` (2, M, 2) px."""
    rig = rig_of(cameras)
    start, end = (measure.triangulate(rig, one).points for one in (before, before + moved))
    return np.asarray((end - start) @ cameras[0].camera_from_world[:3, :3])


def _in_picture(camera: Camera, place: Float, error: Float) -> Float:
    """What an ``error`` (M, 3) mm at a ``place`` (M, 3) mm is in a camera's picture, (M, 2) px."""
    return camera.project((place + error) / MM) - camera.project(place / MM)


def _uncertainty(found: measure.StereoResult, rig: Rig, turn: Float) -> tuple[Float, Float]:
    """Standard uncertainties (M, 3) mm along axes to which ``turn`` leads from the rig's, and
    (M,) px in either picture."""
    seen = np.stack([found.left, found.right])
    # those of the rig's axes belong together: so do their covariances
    unit = measure.triangulate(rig, seen).covariance
    in_picture = found.sigma[:, 0] / np.sqrt(unit[:, 0, 0])
    along = np.sqrt(np.einsum("ai,mij,aj->ma", turn, unit, turn))
    return along * in_picture[:, None], in_picture
