"""Displacements and strains measured in pictures of one camera or of a pair, with their truth.

What is measured comes from pictures and calibrations alone (`correlating`). Results of a pair, and
of the plane of a target, are laid on the structure by a rigid motion between the places measured
and the true places of the same material points, as a tester aligns them by marks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim import measure
from gpusim.arrays.array_types import Bool, Float
from gpusim.errors import GpusimError, InputError
from gpusim.measure.correlation.strain import strain_tensor
from gpusim.measure.correlation.subset_filter import FilteredField
from gpusim.measure.targets.plumb_lines import field_slope
from gpusim.optics.camera.pinhole import Camera
from gpusim.pipeline.measurements.dic.correlating import (
    correlate_pairs,
    correlate_pictures,
    points_within,
)
from gpusim.pipeline.measurements.dic.geometric_error import (
    Gauge,
    known_errors,
    readings_of_one,
    readings_of_pair,
)
from gpusim.pipeline.measurements.dic.result import FullFieldResult
from gpusim.pipeline.measurements.dic.rig import calibrated_rig, rig_of, rig_of_file
from gpusim.pipeline.measurements.dic.true_field import TrueField, region_of_second_camera
from gpusim.pipeline.measurements.kinds import Kind, Unloaded, register
from gpusim.pipeline.measurements.material_points import TrueMotion
from gpusim.pipeline.measurements.region_of_interest import region_of_interest
from gpusim.pipeline.measurements.results import Columns, PointTable
from gpusim.pipeline.measurements.sources import Sources, calibrated
from gpusim.pipeline.scene_objects.cameras import image_axes
from gpusim.pipeline.scene_objects.moving_bodies import SceneObjects
from gpusim.scene import Scene
from gpusim.scene.description import model as m

MM = 1e3
STRAINS = {"exx": (0, 0), "eyy": (1, 1), "exy": (0, 1)}
LEAST_ALIGNED, MOST_ALIGNED = 3, 10_000
COARSE = 8
"""Pixels of which one is looked at before there are pictures."""
RIM = 3
"""Pixels at an edge that aren't used: what lies behind disturbs the interpolation there."""


@dataclass(frozen=True, eq=False)
class Moved:
    """Displacements at points of which strains are taken, as `gpusim.measure` has them."""

    points: Float
    displacement: Float
    subset: float
    shape: Float
    ok: Bool


def measure_dic(
    spec: m.DicTable, scene: Scene, objects: SceneObjects, sources: Sources
) -> FullFieldResult:
    """Displacements and strains of what ``spec`` asks for, in every frame against the first one.

    Raises
    ------
    InputError
        A region without pixels or without room for a subset, no usable calibration.
    GpusimError
        A camera can't be calibrated, or too few points are found to lay them on the structure.
    """
    what, motion = f"measure {spec.name!r}", TrueMotion(objects)
    camera = spec.views[0]
    roi = region_of_interest(what, spec.roi, motion, camera).shrunk(RIM)
    points = points_within(what, roi.mask, spec)
    field = TrueField.of(motion, camera, roi, points)
    frames = spec.measured(len(scene.analysis.load_factors))
    kind = _Pair if spec.cameras is not None else _Single
    return kind(what, spec, scene, sources, field, frames).result()


@dataclass
class _Single:
    """One camera. Lengths are along the world axes nearest to the picture's right and down, or the
    axes of a calibration target that lies on the surface."""

    what: str
    spec: m.DicTable
    scene: Scene
    sources: Sources
    field: TrueField
    frames: tuple[int, ...]

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
            columns = _places([field], frame, one.status)
            columns |= _compared(("u_px", "v_px"), one.displacement, true, smooth)
            places, shifts = (points, points), (one.displacement, smooth)
            if scale is not None:
                moved = MM * field.motion.displacement(field.material, frame) @ scale.axes.T
                slow = moved + np.einsum("mij,mj->mi", scale.slope, smooth - true)
                found_mm = measure.mapped(one, scale.mapping)
                columns |= _compared(("u_mm", "v_mm"), found_mm.displacement, moved, slow)
                columns["sigma_mm"] = found_mm.sigma
                true_places = MM * field.motion.position(field.material, 0) @ scale.axes.T
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
                columns |= _strain_columns(tensors[0], at, tensors[1])
            table[frame] = columns | {"zncc": one.zncc, "sigma_px": one.sigma}
            raw.append([one.displacement - true])
            rest.append([one.displacement - smooth])
        axes = ("the picture's x", "the picture's y") if scale is None else scale.names
        calibration = np.nan if scale is None else scale.calibration_px
        readings = {} if scale is None else readings_of_one(
            field.motion.camera(field.camera), field.motion.position(field.material, 0),
            field.motion.displacement(field.material, self.frames[-1]), scale.mapping, scale.axes,
            spec.plane_pose is not None,
        )  # fmt: skip
        known = known_errors(readings, _gauge(spec, found[-1], _gauge_strain))
        return self.kept(table, axes, np.array([raw, rest]), levelled, calibration, known)

    def kept(
        self,
        table: dict[int, Columns],
        axes: tuple[str, ...],
        errors: Float,
        level: FilteredField,
        calibration_px: float,
        known: dict[str, Float],
    ) -> FullFieldResult:
        """The result with the settings; ``errors`` (2, F, C, M, 2) px less the truth and less the
        levelled truth; ``known``: as `known_errors` has it."""
        spec, count = self.spec, len(self.field.points)
        names = [f"p{number:0{len(str(count))}d}" for number in range(1, count + 1)]
        keys = "subset_px step_px shape strain strain_window blur_px formats"
        settings: dict[str, Any] = {key: getattr(spec, key) for key in keys.split()}
        return FullFieldResult(
            spec.name, PointTable.of("point", names, table), spec.views, axes, **settings,
            pixel_mm=MM * self.field.resolution(), calibration_px=float(calibration_px),
            known_names=tuple(known), known_errors=np.array([*known.values()]),
            raw_px=errors[0], rest_px=errors[1],
            slope=level.slope, contrast=level.contrast, spread=level.spread,
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


def _scale_of(single: _Single, found: measure.DicResult) -> _Scale | None:
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
        Moved(found.points, _where(found.ok, values), found.subset, places, found.ok)
        for values in (places, moved)
    )
    slopes = [
        measure.strain(one, window=spec.strain_window, kind="small").gradient for one in fields
    ]
    known = np.isfinite(slopes).all(axis=(0, 2, 3))
    gradient = np.full_like(slopes[0], np.nan)
    gradient[known] = slopes[1][known] @ np.linalg.inv(slopes[0][known])
    kind: Any = spec.strain
    return strain_tensor(gradient, kind)


def _surface_gauge_strain(
    spec: m.DicTable, found: measure.StereoResult, places: Float, moved: Float
) -> Float:
    """The same in the surface of points in space, (M, 3)."""
    kind: Any = spec.strain
    one = Moved(found.points, _where(found.ok, moved), found.subset, places, found.ok)
    return measure.surface_strain(one, window=spec.strain_window, kind=kind).tensor


def _gauge(spec: m.DicTable, found: Any, strain: Callable[..., Float]) -> Gauge | None:
    """How strains are taken of what was ``found``."""
    if spec.strain == "none":
        return None
    return lambda places, moved: _components(strain(spec, found, places, moved))


class _Pair(_Single):
    """Two calibrated cameras. Lengths are along the world's axes, strains in the surface."""

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
        place = MM * motion.position(field.material, 0)
        laid = self._laid(found, place)
        before = np.array([view.points for view in views])
        table, raw, rest = dict[int, Columns](), [], []
        for k, frame in enumerate(self.frames):
            one = found[k]
            true = MM * motion.displacement(field.material, frame)
            smooth = _seen_by(cameras, before, np.array([one.displacement[k] for one in levels]))
            columns = _places(views, frame, one.status)
            for axis, now, real in zip("XYZ", laid.apply(one.shape).T, place.T, strict=True):
                columns |= {f"measured_{axis}_mm": now, f"true_{axis}_mm": real}
            moved = one.displacement @ laid.rotation.T
            columns |= _compared(("U_mm", "V_mm", "W_mm"), moved, true, smooth)
            if spec.strain != "none":
                columns |= _strain_columns(
                    _surface_gauge_strain(spec, one, one.shape, one.displacement),
                    field.surface_strain(frame, spec.strain),
                    _surface_gauge_strain(spec, one, place, smooth),
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
        ok, last = found[-1].ok, self.frames[-1]
        now = [motion.pixels(field.material, camera, last) for camera in (left, right)]
        pixels = [np.array([_where(ok, one) for one in each]) for each in (before, now)]
        enough = np.count_nonzero(ok) >= LEAST_ALIGNED
        readings = readings_of_pair(rig_of(cameras), rig, pixels, place) if enough else {}
        known = known_errors(readings, _gauge(spec, found[-1], _surface_gauge_strain))
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


def _places(
    views: Sequence[TrueField], frame: int, status: npt.NDArray[np.int8]
) -> dict[str, npt.NDArray[Any]]:
    """Columns that a table begins with: what became of the points, whether they are ``hidden`` from
    any of the cameras in a frame, and where they are in the reference picture."""
    seen = [one.motion.visible(one.material, one.camera, frame) for one in views]
    words = np.array([one.name for one in measure.Status])
    x, y = views[0].points.T
    return {"status": words[status], "hidden": ~np.all(seen, axis=0), "x_px": x, "y_px": y}


def _compared(names: tuple[str, ...], *values: Float) -> Columns:
    """Columns of quantities (M, K): measured, true, levelled."""
    return {
        f"{kind}_{name}": column
        for kind, each in zip(("measured", "true", "levelled"), values, strict=True)
        for name, column in zip(names, each.T, strict=True)
    }


def _strain_columns(*tensors: Float) -> Columns:
    """The same of strains (M, 2, 2)."""
    return _compared(tuple(STRAINS), *map(_components, tensors))


def _components(tensor: Float) -> Float:
    """(M, 3): those of `STRAINS`."""
    return np.stack([tensor[:, i, j] for i, j in STRAINS.values()], axis=1)


def _where(ok: Bool, values: Float) -> Float:
    """NaN where nothing was measured."""
    return np.where(ok[:, None], values, np.nan)


def _checks(spec: m.DicTable, scene: Scene, unloaded: Unloaded) -> list[str]:
    """There is something to measure, with a calibration that fits; raises InputError if not."""
    what, camera = f"measure {spec.name!r}", spec.views[0]
    if spec.calibration not in (None, "true"):
        rig_of_file(spec, scene)
    if not unloaded.strict:
        return []
    for name in spec.views:
        if name in unloaded.blind:
            raise InputError(f"{what}: {unloaded.blind[name]}")
    motion = TrueMotion(SceneObjects(scene, (), unloaded.bodies), unloaded.surfaces)
    try:
        region_of_interest(what, spec.roi, motion, camera, stride=COARSE)
    except InputError:  # it may be smaller than that
        region_of_interest(what, spec.roi, motion, camera)
    return []


register(Kind(m.DicTable, FullFieldResult, measure_dic, _checks))
