"""What a stereo measurement says in the report: numbers, figures, tracked markers."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from gpusim.files.atomic_files import safe_name
from gpusim.files.output_folder import inside
from gpusim.pipeline.measurements.stereo_result import CalibratedCamera, StereoResult
from gpusim.pipeline.stages.images import image_path
from gpusim.report import Drawing, Measurement, Overlay
from gpusim.report.stereo_figures import (
    RigCamera,
    draw_calibration,
    draw_reconstruction,
    draw_rig,
)
from gpusim.scene import Scene

__all__ = ["stereo_figures", "stereo_measurements", "stereo_overlays"]

GOAL = 1e-3
"""Relative error up to which a measured displacement counts as good."""
GOAL_FOCAL, GOAL_BASELINE = 2e-4, 2e-4
GOAL_CENTRE_PX, GOAL_ANGLE_DEG = 0.5, 0.005


def stereo_measurements(result: StereoResult) -> list[Measurement]:
    """The free end's displacement, the error of all markers, and the calibration."""
    tip = len(result.marker) - 1
    name, marker = result.name, result.marker[tip]
    rows = [
        Measurement.compare(
            f"{name}: {marker}, total", "mm", float(np.linalg.norm(result.measured_mm[tip])),
            float(np.linalg.norm(result.true_mm[tip])), tolerance_relative=GOAL,
        )
    ]  # fmt: skip
    for axis in range(3):
        rows.append(
            Measurement.compare(
                f"{name}: {marker}, +{'xyz'[axis]}", "mm", float(result.measured_mm[tip, axis]),
                float(result.true_mm[tip, axis]),
            )
        )  # fmt: skip
    error = np.linalg.norm(result.measured_mm - result.true_mm, axis=1)
    fine = error[np.isfinite(error)]
    if fine.size:
        rms = float(np.sqrt(np.mean(fine**2)))
        rows.append(Measurement(f"{name}: RMS error of all markers", "mm", rms, 0.0, rms, np.nan))
    if np.isfinite(result.rig_motion_mm):
        still = result.rig_motion_mm
        rows.append(
            Measurement(f"{name}: motion of static markers, RMS", "mm", still, 0.0, still, np.nan)
        )
    rms = result.calibration_px
    rows.append(
        Measurement(f"{name}: calibration, reprojection error", "px", rms, 0.0, rms, np.nan)
    )
    for camera in result.cameras:
        rows += _calibration(name, camera)
    return rows


def _calibration(name: str, camera: CalibratedCamera) -> list[Measurement]:
    rows = []
    for parameter, unit in (("fx", "px"), ("cx", "px"), ("cy", "px"), ("baseline_mm", "mm"),
                            ("angle_deg", "deg")):  # fmt: skip
        if parameter not in camera.found:
            continue
        truth = camera.true[parameter]
        goal = {
            "fx": GOAL_FOCAL, "baseline_mm": GOAL_BASELINE, "cx": GOAL_CENTRE_PX / abs(truth),
            "cy": GOAL_CENTRE_PX / abs(truth), "angle_deg": GOAL_ANGLE_DEG / max(truth, 1e-9),
        }[parameter]  # fmt: skip
        label = parameter.split("_")[0]
        rows.append(
            Measurement.compare(
                f"{name}: {camera.name}, {label}", unit, camera.found[parameter], truth,
                tolerance_relative=goal,
            )
        )  # fmt: skip
    return rows


def stereo_figures(result: StereoResult, folder: Path) -> list[Drawing]:
    """Rig, calibration and reconstruction, to be drawn into ``folder``."""
    stem = safe_name(result.name)
    cameras = [
        RigCamera(c.name, c.eye_mm, c.axis, corners, errors, c.resolution)
        for c, corners, errors in zip(
            result.cameras, result.corners_px, result.corner_errors_px, strict=True
        )
    ]
    calibration = partial(
        draw_calibration, cameras, result.view_rms_px, inside(folder, f"{stem}-calibration.png")
    )
    fine = np.isfinite(result.found_mm).all(axis=1)
    if not fine.any():
        return [calibration]
    rest = result.found_mm
    largest = float(np.nanmax(np.linalg.norm(result.true_mm, axis=1)))
    factor = _magnification(0.15 * float(np.ptp(rest[fine], axis=0).max()), largest)
    return [
        partial(draw_rig, cameras, rest[fine], result.boards_mm, inside(folder, f"{stem}-rig.png")),
        calibration,
        partial(
            draw_reconstruction,
            rest, result.measured_mm, result.true_mm, factor, inside(folder, f"{stem}-space.png"),
        ),
    ]  # fmt: skip


def _magnification(wanted: float, largest: float) -> float:
    """1, 2, 5, 10, …: so that the largest displacement is drawn about as long as wanted."""
    if not largest > 0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(max(wanted / largest, 1.0)))
    steps = [step * power for step in (1.0, 2.0, 5.0) if step * power * largest <= wanted]
    return float(max(steps, default=1.0))


def stereo_overlays(result: StereoResult, scene: Scene, out: Path) -> list[Overlay]:
    """Tracked markers on the first image of each camera."""
    return [
        Overlay(
            f"{result.name}: tracked markers, {camera.name}",
            image_path(scene, out, camera.name, 0),
            np.where(np.isfinite(points), points, 0.0),
            moved,
        )
        for camera, points, moved in zip(
            result.cameras, result.points_px, result.moved_px, strict=True
        )
    ]
