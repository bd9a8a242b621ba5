"""Markers in space: a rig calibrated from the run's own chessboard images, then triangulation."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from gpusim import measure
from gpusim.arrays.array_types import Float
from gpusim.errors import GpusimError
from gpusim.measure.stereo.triangulation import Triangulated
from gpusim.measure.targets.boards import Board
from gpusim.optics.camera.pinhole import Camera
from gpusim.pipeline.measurements.kinds import Kind, register
from gpusim.pipeline.measurements.marker_checks import marker_warnings
from gpusim.pipeline.measurements.marker_measurement import track_markers
from gpusim.pipeline.measurements.marker_set import MarkerSet
from gpusim.pipeline.measurements.marker_tracking import MarkerTracks
from gpusim.pipeline.measurements.results import MM, PointTable, vector_columns
from gpusim.pipeline.measurements.sources import Sources, calibrated
from gpusim.pipeline.measurements.stereo.result import PARAMETERS, StereoResult
from gpusim.pipeline.scene_objects.moving_bodies import SceneObjects
from gpusim.scene import Scene
from gpusim.scene.description import model as m

LEAST_SPREAD = 0.05  # of static markers, width over length


def measure_stereo(
    spec: m.StereoTable, scene: Scene, objects: SceneObjects, sources: Sources
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
    board, calibration = calibrated(spec, scene, sources.corners)
    tracked = track_markers(spec, scene, objects, sources)
    marks, count = tracked.marks, tracked.marks.count
    _, true = marks.true_motion(objects, [*tracked.frames])
    frames, shifts, motions = {}, [], []
    for (frame, seen), moved in zip(tracked.frames.items(), true, strict=True):
        shift = [np.where(s.status[:, None] == "OK", s.displacement, np.nan) for s in seen]
        before, after = _triangulated(spec.name, calibration, seen, shift)
        structure = measure.align(before.points, MM * marks.position)
        difference = measure.displacement_3d(before, after, structure)
        displacement, motion = _steady(marks, before.points, after.points, structure, difference)
        pairs = measure.epipolar_distance(
            calibration.cameras[0], calibration.cameras[1], seen[0].points, seen[1].points
        )
        sigma = np.sqrt(np.einsum("mii->mi", difference.covariance[:count]))
        columns = {
            **tracked.places(seen, least=2),
            **vector_columns("found_{}_mm", "xyz", structure.apply(before.points)[:count]),
            **vector_columns("measured_{}_mm", "xyz", displacement[:count]),
            **vector_columns("true_{}_mm", "xyz", MM * moved),
            **vector_columns("sigma_{}_mm", "xyz", sigma),
            "epipolar_px": np.diag(pairs)[:count],
            "residual_px": before.residual[:count],
        }
        frames[frame] = {**columns, **tracked.flags(seen)}
        shifts.append(np.array(shift)[:, :count])
        motions.append((structure.rms, motion))
    alignment, rig_motion = np.array(motions).T
    world = np.array([np.linalg.inv(one.camera_from_world) for one in tracked.cameras])
    per_camera = [len(corners) for corners in calibration.points]
    return StereoResult(
        name=spec.name,
        table=PointTable.of("marker", marks.names[:count], frames),
        lens=spec.lens,
        alignment_mm=alignment,
        rig_motion_mm=rig_motion,
        calibration_px=calibration.rms,
        calibration_points=calibration.used,
        calibration_outliers=calibration.outliers,
        cameras=spec.cameras,
        parameters=_parameters(calibration, tracked.cameras),
        distortion=np.array([one.distortion for one in calibration.cameras]),
        camera_rms_px=np.array([one.rms for one in calibration.cameras]),
        eye_mm=MM * world[:, :3, 3],
        axis=world[:, :3, 2],
        resolution=np.array([one.resolution for one in calibration.cameras]),
        boards_mm=_boards(calibration, structure, board),
        view_rms_px=calibration.view_rms,
        corner_camera=np.repeat(np.arange(len(per_camera)), per_camera),
        corners_px=np.concatenate(calibration.points),
        corner_errors_px=np.concatenate(calibration.residuals),
        points_px=np.array([one.points[:count] for one in seen]),
        moved_px=np.array(shifts),
    )


def _triangulated(
    name: str,
    calibration: measure.Calibration,
    seen: Sequence[MarkerTracks],
    shifts: Sequence[Float],
) -> tuple[Triangulated, Triangulated]:
    """The markers in space, three at least, before and after their ``shifts`` (M, 2) px in each
    camera."""
    noise = np.stack([np.where(s.sigma > 0, s.sigma, np.nan) / np.sqrt(2.0) for s in seen])
    known = noise[np.isfinite(noise)]
    noise = np.where(np.isfinite(noise), noise, np.median(known) if known.size else 1.0)
    before = np.stack([s.points for s in seen])
    first, last = (
        measure.triangulate(calibration.cameras, pixels, sigma_px=noise)
        for pixels in (before, before + np.stack(shifts))
    )
    good = np.count_nonzero(np.isfinite(first.points).all(axis=1))
    if not good >= 3:
        found = f"{good} markers are seen by two cameras"
        raise GpusimError(f"measure {name!r}: {found}; expected three")
    return first, last


def _steady(
    marks: MarkerSet,
    before: Float,
    after: Float,
    frame: measure.Alignment,
    moved: measure.Displacement3D,
) -> tuple[Float, float]:
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


def _parameters(calibration: measure.Calibration, cameras: Sequence[Camera]) -> Float:
    """(3, C, 6): `PARAMETERS` as they were found, as they are, and their standard uncertainty."""
    result = np.full((3, len(cameras), len(PARAMETERS)), np.nan)
    for k, (found, true) in enumerate(zip(calibration.cameras, cameras, strict=True)):
        lens = [*PARAMETERS][:4]
        result[:2, k, :4] = [one.K[[0, 1, 0, 1], [0, 1, 2, 2]] for one in (found, true)]
        result[2, k, :4] = [found.sigma.get(one, found.sigma.get("f", np.nan)) for one in lens]
        if k:
            relative = true.camera_from_world @ np.linalg.inv(cameras[0].camera_from_world)
            angle = np.arccos(np.clip((np.trace(relative[:3, :3]) - 1) / 2, -1, 1))
            result[::2, k, 4] = calibration.baseline(k)
            result[::2, k, 5] = np.degrees(calibration.angle(k))
            result[1, k, 4:] = MM * np.linalg.norm(relative[:3, 3]), np.degrees(angle)
    return result


def _boards(calibration: measure.Calibration, frame: measure.Alignment, board: Board) -> Float:
    """Outlines (V, 4, 3) of the board in each view, in the axes of the structure, mm."""
    a, (across, down) = board.square, board.corners
    corners = np.array(
        [[-a, -a, 0], [across * a, -a, 0], [across * a, down * a, 0], [-a, down * a, 0.0]]
    )
    in_rig = np.einsum("vij,kj->vki", calibration.view_poses[:, :3, :3], corners)
    result: Float = frame.apply(in_rig + calibration.view_poses[:, None, :3, 3])
    return result


# three markers make a plane
_checks = partial(marker_warnings, least=3)
register(Kind(m.StereoTable, StereoResult, measure_stereo, _checks))
