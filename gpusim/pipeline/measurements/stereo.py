"""Markers in space: a rig calibrated from the run's own chessboard images, then triangulation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim import measure
from gpusim.errors import GpusimError, InputError
from gpusim.measure.stereo.triangulation import Triangulated
from gpusim.optics.camera.pinhole import Camera
from gpusim.pipeline.build.cameras import build_camera
from gpusim.pipeline.build.photo import build_sensor
from gpusim.pipeline.build.scene_objects import SceneObjects
from gpusim.pipeline.measurements.board_corners import Board, board_of
from gpusim.pipeline.measurements.marker_cache import MarkerCache
from gpusim.pipeline.measurements.marker_tracking import MarkerSet, MarkerTracks, collect_markers
from gpusim.pipeline.measurements.sources import Sources
from gpusim.pipeline.measurements.stereo_result import CalibratedCamera, StereoResult
from gpusim.scene import Scene
from gpusim.scene.description import model as m

__all__ = ["measure_stereo", "track_in_cameras"]

Array = npt.NDArray[np.float64]
Image = Callable[[str, int], npt.NDArray[Any]]
MM = 1e3
LEAST_SPREAD = 0.05  # of static markers, width over length


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
    shifts = [np.where(_ok(s)[:, None], s.displacement, np.nan) for s in seen]
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
        true_mm=_truth(marks, objects, last),
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


def _ok(seen: MarkerTracks) -> npt.NDArray[np.bool_]:
    return np.array([status == "OK" for status in seen.status])


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


def _truth(marks: MarkerSet, objects: SceneObjects, last: int) -> Array:
    """True displacement (M, 3) in mm of the markers on bodies."""
    parts, first = [], 0
    for body, paint in marks.groups:
        own = marks.position[first : first + len(paint.markers)]
        first += len(paint.markers)
        u = objects.displacement(body, last) - objects.displacement(body, 0)
        nodes, weights = objects.bodies[body].skin.locate(own)
        parts.append(MM * np.einsum("mk,mka->ma", weights, u[nodes]))
    return np.concatenate(parts)


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
