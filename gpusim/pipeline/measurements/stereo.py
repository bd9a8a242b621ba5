"""Markers in space: a rig calibrated from the run's own chessboard images, then triangulation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import Field, dataclass
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from gpusim import measure
from gpusim.errors import GpusimError, InputError
from gpusim.measure.stereo.triangulation import Triangulated
from gpusim.optics.camera.pinhole import Camera
from gpusim.pipeline.build.cameras import build_camera, build_sensor
from gpusim.pipeline.build.scene_objects import SceneObjects
from gpusim.pipeline.measurements.marker_detection import MarkerSet, collect_markers
from gpusim.pipeline.measurements.marker_tracking import MarkerCache, MarkerTracks
from gpusim.pipeline.measurements.result_files import MarkerResult, csv_text
from gpusim.pipeline.measurements.sources import Board, Sources, board_of
from gpusim.scene import Scene
from gpusim.scene.description import model as m

__all__ = ["CalibratedCamera", "StereoResult", "measure_stereo", "track_in_cameras"]

Array = npt.NDArray[np.float64]
Pixels = tuple[Array, ...]
Image = Callable[[str, int], npt.NDArray[Any]]
MM = 1e3
LEAST_SPREAD = 0.05  # of static markers, width over length


@dataclass(frozen=True, eq=False)
class CalibratedCamera:
    """A calibrated camera beside the true one.

    ``found``, ``true``, ``sigma`` by parameter: fx fy cx cy in px and, beside the first camera,
    baseline_mm and angle_deg to it. ``distortion`` (14,), OpenCV's. ``eye_mm`` and ``axis`` (3,):
    where the true camera is and looks.
    """

    name: str
    found: dict[str, float]
    true: dict[str, float]
    sigma: dict[str, float]
    distortion: Array
    rms_px: float
    eye_mm: Array
    axis: Array
    resolution: tuple[int, int]

    @staticmethod
    def of(values: dict[str, Any]) -> CalibratedCamera:
        """From what JSON made of one."""
        arrays = {key: np.array(values[key], dtype=np.float64)
                  for key in ("distortion", "eye_mm", "axis")}  # fmt: skip
        numbers = {
            key: {n: float("nan") if v is None else v for n, v in values[key].items()}
            for key in ("found", "true", "sigma")
        }
        width, height = values["resolution"]
        return CalibratedCamera(**values | arrays | numbers | {"resolution": (width, height)})


@dataclass(frozen=True, eq=False)
class StereoResult(MarkerResult):
    """Displacements of M markers from C cameras, and the calibration that they rest on.

    Per marker: ``position_mm`` (M, 3) as designed, ``found_mm`` (M, 3) as triangulated in the
    unloaded images and aligned with the design (``alignment_mm`` RMS of what is left),
    ``measured_mm``, ``true_mm``, ``sigma_mm`` (M, 3) along the world's axes, ``epipolar_px`` and
    ``residual_px`` (M,). ``rig_motion_mm``: what static markers seemed to do, NaN without. Of the
    calibration: ``boards_mm`` (V, 4, 3) outlines, ``view_rms_px`` (C, V), corners and their errors
    (N, 2) per camera. ``points_px``, ``moved_px`` (M, 2) per camera. ``unrefined``: markers
    that correlation alone has measured in one of the images.
    """

    name: str
    lens: str
    marker: tuple[str, ...]
    group: tuple[str, ...]
    status: tuple[str, ...]
    position_mm: Array
    found_mm: Array
    measured_mm: Array
    true_mm: Array
    sigma_mm: Array
    epipolar_px: Array
    residual_px: Array
    alignment_mm: float
    rig_motion_mm: float
    calibration_px: float
    calibration_points: int
    calibration_outliers: int
    cameras: tuple[CalibratedCamera, ...]
    boards_mm: Array
    view_rms_px: Array
    corners_px: Pixels
    corner_errors_px: Pixels
    points_px: Pixels
    moved_px: Pixels
    saturated: tuple[str, ...]
    unrefined: tuple[str, ...]

    empty: ClassVar = {"boards_mm": (0, 4, 3)}

    @property
    def note(self) -> str:
        """What became of it, in a few words."""
        return (
            f"{self.measured_count} in space; calibration {self.calibration_px:.4f}"
            f" px over {self.calibration_points} corners"
        )

    @property
    def warnings(self) -> list[str]:
        """Markers that were not well measured."""
        return self.marker_warnings()

    def tables(self) -> dict[str, str]:
        """``.csv``: one row for each marker; ``-cameras.csv``: parameters of the calibration."""
        head = [f"{what}_{axis}_mm" for what in ("found", "measured", "true", "sigma")
                for axis in "xyz"]  # fmt: skip
        columns = np.concatenate(
            [self.position_mm, self.found_mm, self.measured_mm, self.true_mm, self.sigma_mm,
             self.epipolar_px[:, None]], axis=1,
        )  # fmt: skip
        names = zip(self.marker, self.status, strict=True)
        rows = [[*name, *row] for name, row in zip(names, columns, strict=True)]
        parameters = []
        for camera in self.cameras:
            for name, value in camera.found.items():
                numbers = (value, camera.true[name], camera.sigma[name])
                unit = next((u for u in ("mm", "deg") if name.endswith(f"_{u}")), "px")
                parameters.append([camera.name, name, unit, *(f"{v:.10g}" for v in numbers)])
        return {
            "": csv_text(["marker", "status", "x_mm", "y_mm", "z_mm", *head, "epipolar_px"], rows),
            "-cameras": csv_text(
                ["camera", "parameter", "unit", "found", "true", "sigma"], parameters
            ),
        }

    @classmethod
    def field_of(cls, item: Field[Any], value: Any) -> Any:
        """As `MarkerResult.field_of`; cameras, and arrays by camera."""
        if item.type == "Pixels":
            return tuple(np.array(one, dtype=np.float64).reshape(-1, 2) for one in value)
        if item.name == "cameras":
            return tuple(CalibratedCamera.of(one) for one in value)
        return super().field_of(item, value)

    def shapes(self) -> dict[str, tuple[int, ...]]:
        """What shapes arrays have to have."""
        count = len(self.marker)
        vectors = ("position_mm", "found_mm", "measured_mm", "true_mm", "sigma_mm")
        return dict.fromkeys(vectors, (count, 3)) | {
            "epipolar_px": (count,),
            "residual_px": (count,),
        }

    def misfits(self) -> list[str]:
        """What isn't there for every camera."""
        count, cameras = len(self.marker), len(self.cameras)
        wrong = [
            name
            for name in ("points_px", "moved_px")
            if [own.shape for own in getattr(self, name)] != [(count, 2)] * cameras
        ]
        if len(self.view_rms_px) != cameras or len(self.corners_px) != cameras:
            wrong.append("calibration")
        return wrong


def measure_stereo(
    spec: m.Stereo, scene: Scene, objects: SceneObjects, sources: Sources
) -> StereoResult:
    """Displacement in space of the markers of ``spec`` between the first frame and the last.

    What the scene knows of its cameras is used to tell markers apart and afterwards as the truth,
    never for a number: the calibration is that of the chessboard images alone.

    Raises
    ------
    InputError
        The scene has no calibration images of a checker for these cameras, or a marker is too
        small.
    GpusimError
        A camera can't be calibrated, or no marker is seen by two cameras.
    """
    what = f"measure {spec.name!r}"
    board = _board(what, spec, scene)
    calibration = measure.calibrate(_sightings(spec, scene, sources.corners), lens=spec.lens)
    marks, seen = track_in_cameras(spec, scene, objects, sources.image, sources.markers)
    cameras = {c.name: build_camera(c, scene.input) for c in scene.cameras}
    last = len(scene.analysis.load_factors) - 1
    followed = [np.array([status == "OK" for status in s.status])[:, None] for s in seen]
    shifts = [np.where(ok, s.displacement, np.nan) for ok, s in zip(followed, seen, strict=True)]
    before, after = _triangulated(calibration, seen, shifts)
    good = np.isfinite(before.points).all(axis=1)
    if not np.count_nonzero(good) >= 3:
        raise GpusimError(
            f"{what}: {np.count_nonzero(good)} markers are seen by two cameras; expected three"
        )
    frame = measure.align(before.points, MM * marks.position)
    moved = measure.displacement_3d(before, after, frame)
    displacement, motion = _steady(marks, before.points, after.points, frame, moved)
    pairs = measure.epipolar_distance(
        calibration.cameras[0], calibration.cameras[1], seen[0].points, seen[1].points
    )
    count = marks.count
    return StereoResult(
        name=spec.name,
        lens=spec.lens,
        marker=marks.names[:count],
        group=marks.group_names[:count],
        status=tuple(_status([s.status[i] for s in seen]) for i in range(count)),
        position_mm=MM * marks.position[:count],
        found_mm=frame.apply(before.points)[:count],
        measured_mm=displacement[:count],
        true_mm=MM * marks.true_motion(objects, last)[1],
        sigma_mm=np.sqrt(np.einsum("mii->mi", moved.covariance[:count])),
        epipolar_px=np.diag(pairs)[:count].copy(),
        residual_px=before.residual[:count],
        alignment_mm=frame.rms,
        rig_motion_mm=motion,
        calibration_px=calibration.rms,
        calibration_points=calibration.used,
        calibration_outliers=calibration.outliers,
        cameras=tuple(
            _camera(calibration, k, cameras[name], cameras[spec.cameras[0]])
            for k, name in enumerate(spec.cameras)
        ),
        boards_mm=_boards(calibration, frame, board),
        view_rms_px=calibration.view_rms,
        corners_px=tuple(calibration.points),
        corner_errors_px=tuple(calibration.residuals),
        points_px=tuple(s.points[:count] for s in seen),
        moved_px=tuple(shift[:count] for shift in shifts),
        saturated=tuple(dict.fromkeys(name for s in seen for name in s.saturated(count))),
        unrefined=tuple(dict.fromkeys(name for s in seen for name in s.by_correlation(count))),
    )


def track_in_cameras(
    spec: m.Stereo, scene: Scene, objects: SceneObjects, image: Image, markers: MarkerCache
) -> tuple[MarkerSet, list[MarkerTracks]]:
    """The markers of ``spec``, and where they are in each camera's first and last picture.

    This needs no calibration. Raises as `track_markers`.
    """
    marks = collect_markers(
        f"measure {spec.name!r}", spec.groups, spec.static, scene, objects.bodies
    )
    last = len(scene.analysis.load_factors) - 1
    cameras = {c.name: build_camera(c, scene.input) for c in scene.cameras}
    sensors = {c.name: build_sensor(scene.sensor_of(c.name), c, 1.0) for c in scene.cameras}
    seen = [
        markers.track(
            spec.name, marks, cameras[name], image(name, 0), image(name, last),
            subset=spec.subset, sensor=sensors[name],
        )
        for name in spec.cameras
    ]  # fmt: skip
    return marks, seen


def _board(what: str, spec: m.Stereo, scene: Scene) -> Board:
    calibration = scene.calibration
    if calibration is None or not set(spec.cameras) <= set(calibration.cameras):
        raise InputError(
            f"{what}: no images of a target for {', '.join(spec.cameras)}; expected [calibration]"
        )
    board = board_of(scene)
    if board is None:
        raise InputError(
            f"{what}: calibration board {calibration.board!r}; got another paint; expected a "
            "checker or charuco"
        )
    return board


def _sightings(
    spec: m.Stereo, scene: Scene, corners: Callable[[str, int], measure.Sighting]
) -> dict[str, list[measure.Sighting]]:
    assert scene.calibration is not None
    poses = range(len(scene.calibration.poses))
    return {name: [corners(name, pose) for pose in poses] for name in spec.cameras}


def _triangulated(
    calibration: measure.Calibration, seen: Sequence[MarkerTracks], shifts: Sequence[Array]
) -> tuple[Triangulated, Triangulated]:
    """The markers in space, before and after their ``shifts`` (M, 2) px in each camera."""
    noise = np.stack([np.where(s.sigma > 0, s.sigma, np.nan) / np.sqrt(2.0) for s in seen])
    noise = np.where(np.isfinite(noise), noise, np.nanmedian(noise))
    before = np.stack([s.points for s in seen])
    first, last = (
        measure.triangulate(calibration.cameras, pixels, sigma_px=noise)
        for pixels in (before, before + np.stack(shifts))
    )
    return first, last


def _status(states: Sequence[str]) -> str:
    """OK if two cameras at least followed a marker, else the first camera's reason."""
    fine = sum(state == "OK" for state in states)
    return "OK" if fine >= 2 else next(state for state in states if state != "OK")


def _steady(
    marks: MarkerSet,
    before: Array,
    after: Array,
    frame: measure.Alignment,
    moved: measure.Displacement3D,
) -> tuple[Array, float]:
    """Displacements less what the static markers seem to do, and how far they moved (mm, RMS)."""
    still = np.arange(len(before)) >= marks.count
    fine = still & np.isfinite(before).all(axis=1) & np.isfinite(after).all(axis=1)
    if np.count_nonzero(fine) < 3:
        return moved.displacement, float("nan")
    start, end = frame.apply(before), frame.apply(after)
    rms = float(np.sqrt(np.mean(np.sum((end - start)[fine] ** 2, axis=1))))
    middle = start[fine].mean(axis=0)
    spread = np.linalg.svd(start[fine] - middle, compute_uv=False)
    if not spread[1] > LEAST_SPREAD * spread[0]:  # a line of markers leaves a turn open
        return end - start - (end[fine].mean(axis=0) - middle), rms
    motion = measure.align(end[fine], start[fine])
    return motion.apply(end) - start, rms


def _camera(
    calibration: measure.Calibration, k: int, true: Camera, first: Camera
) -> CalibratedCamera:
    own = calibration.cameras[k]
    relative = true.camera_from_world @ np.linalg.inv(first.camera_from_world)
    found = dict(fx=own.K[0, 0], fy=own.K[1, 1], cx=own.K[0, 2], cy=own.K[1, 2])
    truth = dict(fx=true.K[0, 0], fy=true.K[1, 1], cx=true.K[0, 2], cy=true.K[1, 2])
    sigma = {name: own.sigma.get(name, own.sigma.get("f", np.nan)) for name in found}
    if k:
        angle = float(np.arccos(np.clip((np.trace(relative[:3, :3]) - 1) / 2, -1, 1)))
        length, length_sigma = calibration.baseline(k)
        turn, turn_sigma = calibration.angle(k)
        found |= dict(baseline_mm=length, angle_deg=np.degrees(turn))
        truth |= dict(
            baseline_mm=MM * float(np.linalg.norm(relative[:3, 3])), angle_deg=np.degrees(angle)
        )
        sigma |= dict(baseline_mm=length_sigma, angle_deg=np.degrees(turn_sigma))
    place = np.asarray(np.linalg.inv(true.camera_from_world), dtype=np.float64)
    return CalibratedCamera(
        own.name,
        {name: float(value) for name, value in found.items()},
        {name: float(value) for name, value in truth.items()},
        {name: float(value) for name, value in sigma.items()},
        own.distortion,
        own.rms,
        MM * place[:3, 3],
        place[:3, 2].copy(),
        own.resolution,
    )


def _boards(calibration: measure.Calibration, frame: measure.Alignment, board: Board) -> Array:
    """Outlines (V, 4, 3) of the board in each view, in the axes of the structure, mm."""
    a, (across, down) = board.square, board.corners
    corners = np.array(
        [[-a, -a, 0], [across * a, -a, 0], [across * a, down * a, 0], [-a, down * a, 0.0]]
    )
    in_rig = np.einsum("vij,kj->vki", calibration.view_poses[:, :3, :3], corners)
    result: Array = frame.apply(in_rig + calibration.view_poses[:, None, :3, 3])
    return result
