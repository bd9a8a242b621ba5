"""A field measured by two calibrated cameras: shape and displacement in space, strain in the
surface.

Lengths are along the world's axes: the rig's results are laid on the structure by the rigid motion
that brings the places measured in the first pictures nearest to the true ones.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from typing import Any

import numpy as np

from gpusim import measure
from gpusim.arrays.array_types import Float
from gpusim.errors import GpusimError
from gpusim.optics.camera.pinhole import Camera
from gpusim.pipeline.measurements.dic.correlating import (
    correlate_pairs,
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
from gpusim.pipeline.measurements.dic.geometric_error import errors_of_pair
from gpusim.pipeline.measurements.dic.result import FullFieldResult
from gpusim.pipeline.measurements.dic.rig import calibrated_rig, rig_of
from gpusim.pipeline.measurements.dic.true_field import TrueField, region_of_second_camera
from gpusim.pipeline.measurements.results import Columns
from gpusim.scene.description import model as m

LEAST_ALIGNED = 3


class CameraPair(FieldMeasurement):
    """The field that both cameras of a pair see."""

    def result(self) -> FullFieldResult:
        """All frames."""
        spec, field, points = self.spec, self.field, self.field.points
        motion, (left, right) = field.motion, spec.views
        cameras = motion.camera(left), motion.camera(right)
        rig, calibration_px = calibrated_rig(spec, self.scene, self.sources, cameras)
        region = region_of_second_camera(motion, field.roi, left, right)
        masks = field.roi.mask, region.mask
        found = correlate_pairs(spec, self.sources, points, masks, rig, self.frames)
        # where the second camera sees the points is known to the truth
        seen = motion.pixels(field.material, right, 0)
        views = field, TrueField(motion, right, region, seen, field.material)
        images = self.sources.image(left, 0), self.sources.image(right, 0)
        levels = [
            view.levelled(image, self.frames, spec)
            for view, image in zip(views, images, strict=True)
        ]
        before = np.array([view.points for view in views])
        place = MM * motion.position(field.material, 0)
        laid = self._laid(found, place)
        table, raw, rest = dict[int, Columns](), [], []
        for k, frame in enumerate(self.frames):
            one = found[k]
            true = MM * motion.displacement(field.material, frame)
            smooth = _seen_by(cameras, before, np.array([one.displacement[k] for one in levels]))
            columns = columns_of_places(views, frame, one.status)
            columns |= shape_columns("XYZ", laid.apply(one.shape), place)
            moved = one.displacement @ laid.rotation.T
            columns |= compared_columns(("U_mm", "V_mm", "W_mm"), moved, true, smooth)
            if spec.strain != "none":
                columns |= strain_columns(
                    _gauge_strain(spec, one, one.shape, one.displacement),
                    field.surface_strain(frame, spec.strain),
                    _gauge_strain(spec, one, place, smooth),
                )
            sigma, in_picture = _uncertainty(one, rig, laid.rotation)
            columns |= {f"sigma_{q}_mm": s for q, s in zip("UVW", sigma.T, strict=True)}
            table[frame] = columns | {
                "sigma_each_camera_px": in_picture,
                "residual_px": one.residual,
            }
            now = place + true
            raw.append([_in_picture(camera, now, moved - true) for camera in cameras])
            rest.append([_in_picture(camera, now, moved - smooth) for camera in cameras])
        axes = ("+x", "+y", "+z")
        after = [motion.pixels(field.material, one, self.frames[-1]) for one in (left, right)]
        pixels = [
            np.array([where_measured(found[-1].ok, one) for one in each])
            for each in (before, after)
        ]
        strain = None if spec.strain == "none" else partial(_gauge_strain, spec, found[-1])
        known = GeometricErrors()
        if np.count_nonzero(found[-1].ok) >= LEAST_ALIGNED:
            known = errors_of_pair(rig_of(cameras), rig, pixels, place, strain)
        errors = np.array([raw, rest])
        return self.kept(table, axes, errors, levels[0], calibration_px, known)

    def _laid(self, found: Iterable[measure.StereoResult], place: Float) -> measure.Alignment:
        """The rigid motion from the rig's axes to the structure's, from the points' places in the
        first pictures."""
        for one in found:
            if np.count_nonzero(one.ok) >= LEAST_ALIGNED:
                return measure.align(one.shape, place)
        raise GpusimError(
            f"{self.what}: got less than {LEAST_ALIGNED} points that both cameras see in any "
            "frame; expected a textured surface that both see"
        )


def _seen_by(cameras: tuple[Camera, Camera], before: Float, moved: Float) -> Float:
    """Displacements (M, 3) mm, in the world, of points that two true cameras see at places
    ``before`` (2, M, 2) px and then ``moved`` (2, M, 2) px."""
    rig = rig_of(cameras)
    start, end = (measure.triangulate(rig, one).points for one in (before, before + moved))
    return np.asarray((end - start) @ cameras[0].camera_from_world[:3, :3])


def _gauge_strain(
    spec: m.DicTable, found: measure.StereoResult, places: Float, moved: Float
) -> Float:
    """Strain (M, 2, 2) in the surface of points at ``places`` (M, 3) that ``moved`` (M, 3)."""
    kind: Any = spec.strain
    one = Moved(found.points, where_measured(found.ok, moved), found.subset, places, found.ok)
    return measure.surface_strain(one, window=spec.strain_window, kind=kind).tensor


def _in_picture(camera: Camera, place: Float, error: Float) -> Float:
    """What an ``error`` (M, 3) mm at a ``place`` (M, 3) mm is in a camera's picture, (M, 2) px."""
    return camera.project((place + error) / MM) - camera.project(place / MM)


def _uncertainty(
    found: measure.StereoResult, rig: tuple[measure.CalibratedCamera, ...], turn: Float
) -> tuple[Float, Float]:
    """Standard uncertainties (M, 3) mm along axes to which ``turn`` leads from the rig's, and
    (M,) px in either picture."""
    seen = np.stack([found.left, found.right])
    # those of the rig's axes belong together: so do their covariances
    unit = measure.triangulate(rig, seen).covariance
    in_picture = found.sigma[:, 0] / np.sqrt(unit[:, 0, 0])
    along = np.sqrt(np.einsum("ai,mij,aj->ma", turn, unit, turn))
    return along * in_picture[:, None], in_picture
