"""Markers in space: a rig calibrated from the run's own chessboard images, then triangulation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim import measure
from gpusim.errors import GpusimError, InputError
from gpusim.measure.stereo.triangulation import Triangulated
from gpusim.optics.camera.pinhole import Camera
from gpusim.pipeline.build.scene_objects import SceneObjects
from gpusim.pipeline.checks.marker_checks import marker_warnings
from gpusim.pipeline.measurements.kinds import Kind, Unloaded, register
from gpusim.pipeline.measurements.marker_detection import MarkerSet
from gpusim.pipeline.measurements.marker_measurement import track_markers_of
from gpusim.pipeline.measurements.marker_tracking import MarkerTracks
from gpusim.pipeline.measurements.results import PointTable, vector_columns
from gpusim.pipeline.measurements.sources import Board, Sources, board_of
from gpusim.pipeline.measurements.stereo.result import CalibratedCamera, StereoResult
from gpusim.scene import Scene
from gpusim.scene.description import model as m

__all__ = ["measure_stereo"]

Array = npt.NDArray[np.float64]
MM = 1e3
LEAST_SPREAD = 0.05  # of static markers, width over length


def measure_stereo(
    spec: m.Stereo, scene: Scene, objects: SceneObjects, sources: Sources
) -> StereoResult:
    """Displacement in space of the markers of ``spec`` from the first frame to every other one.

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
    tracked = track_markers_of(spec, scene, objects, sources)
    marks, count = tracked.marks, tracked.marks.count
    frames = [_frame(what, calibration, marks, seen) for seen in zip(*tracked.tracks, strict=True)]
    _, true = marks.true_motion(objects, tracked.frames)
    columns = {
        "status": np.array([[_status([s.status[i] for s in one.seen]) for i in range(count)]
                            for one in frames]),
        **vector_columns("{}_mm", "xyz", MM * marks.position[:count]),
        **vector_columns("found_{}_mm", "xyz", np.array([one.found for one in frames])),
        **vector_columns("measured_{}_mm", "xyz", np.array([one.measured for one in frames])),
        **vector_columns("true_{}_mm", "xyz", MM * true),
        **vector_columns("sigma_{}_mm", "xyz", np.array([one.sigma for one in frames])),
        "epipolar_px": np.array([one.epipolar for one in frames]),
        "residual_px": np.array([one.residual for one in frames]),
        **tracked.states(),
    }  # fmt: skip
    per_camera = [len(corners) for corners in calibration.points]
    return StereoResult(
        name=spec.name,
        table=PointTable("marker", tracked.frames, marks.names[:count], columns),
        lens=spec.lens,
        alignment_mm=np.array([one.alignment.rms for one in frames]),
        rig_motion_mm=np.array([one.rig_motion for one in frames]),
        calibration_px=calibration.rms,
        calibration_points=calibration.used,
        calibration_outliers=calibration.outliers,
        cameras=tuple(
            _camera(calibration, k, camera, tracked.cameras[0])
            for k, camera in enumerate(tracked.cameras)
        ),
        boards_mm=_boards(calibration, frames[-1].alignment, board),
        view_rms_px=calibration.view_rms,
        corner_camera=np.repeat(np.arange(len(per_camera)), per_camera),
        corners_px=np.concatenate(calibration.points),
        corner_errors_px=np.concatenate(calibration.residuals),
        points_px=np.array([one.points[:count] for one in frames[-1].seen]),
        moved_px=np.array([one.shifts[:, :count] for one in frames]),
    )


@dataclass(frozen=True, eq=False)
class _Frame:
    """A frame against the first: each camera's tracks, as ``seen``, and their ``shifts``
    (C, M, 2) px where they were followed; of the M markers on bodies where they were at first
    (``found``), ``measured`` displacement and ``sigma`` (M, 3) mm; how far the first picture's rays
    miss each other (``epipolar``, ``residual``, (M,) px)."""

    seen: tuple[MarkerTracks, ...]
    shifts: Array
    found: Array
    measured: Array
    sigma: Array
    epipolar: Array
    residual: Array
    alignment: measure.Alignment
    rig_motion: float


def _frame(
    what: str, calibration: measure.Calibration, marks: MarkerSet, seen: tuple[MarkerTracks, ...]
) -> _Frame:
    """Raises GpusimError if fewer than three markers are seen by two cameras."""
    count = marks.count
    followed = [np.array([status == "OK" for status in s.status])[:, None] for s in seen]
    shifts = [np.where(ok, s.displacement, np.nan) for ok, s in zip(followed, seen, strict=True)]
    before, after = _triangulated(calibration, seen, shifts)
    good = np.count_nonzero(np.isfinite(before.points).all(axis=1))
    if not good >= 3:
        raise GpusimError(f"{what}: {good} markers are seen by two cameras; expected three")
    frame = measure.align(before.points, MM * marks.position)
    moved = measure.displacement_3d(before, after, frame)
    displacement, motion = _steady(marks, before.points, after.points, frame, moved)
    pairs = measure.epipolar_distance(
        calibration.cameras[0], calibration.cameras[1], seen[0].points, seen[1].points
    )
    return _Frame(
        seen,
        np.array(shifts),
        frame.apply(before.points)[:count],
        displacement[:count],
        np.sqrt(np.einsum("mii->mi", moved.covariance[:count])),
        np.diag(pairs)[:count].copy(),
        before.residual[:count],
        frame,
        motion,
    )


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
        tuple(own.distortion.tolist()),
        own.rms,
        tuple((MM * place[:3, 3]).tolist()),
        tuple(place[:3, 2].tolist()),
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


def _checks(spec: m.Stereo, scene: Scene, unloaded: Unloaded) -> list[str]:
    """Three markers in sight make a plane."""
    return marker_warnings(spec, scene, unloaded, least=3)


register(Kind(m.Stereo, StereoResult, measure_stereo, _checks, prepare=track_markers_of))
