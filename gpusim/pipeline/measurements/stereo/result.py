"""Markers in space over frames, and the calibration that they rest on: tables, figures, what the
report says."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.files.atomic_files import safe_name
from gpusim.files.output_folder import inside
from gpusim.pipeline.measurements.marker_measurement import GOAL, MarkerResult, crops
from gpusim.pipeline.measurements.results import Reported, csv_text
from gpusim.pipeline.stages.images import image_path
from gpusim.report import Drawing, Measurement, Overlay
from gpusim.report.measurement_figures import (
    RigCamera,
    draw_calibration,
    draw_reconstruction,
    draw_rig,
)
from gpusim.scene import Scene

__all__ = ["CalibratedCamera", "StereoResult"]

Array = npt.NDArray[np.float64]
Point = tuple[float, float, float]
GOAL_FOCAL, GOAL_BASELINE = 2e-4, 2e-4
GOAL_CENTRE_PX, GOAL_ANGLE_DEG = 0.5, 0.005


@dataclass(frozen=True)
class CalibratedCamera:
    """A calibrated camera beside the true one.

    ``found``, ``true``, ``sigma`` by parameter: fx fy cx cy in px and, beside the first camera,
    baseline_mm and angle_deg to it. ``distortion``: 14 numbers, OpenCV's. ``eye_mm`` and ``axis``:
    where the true camera is and looks.
    """

    name: str
    found: dict[str, float]
    true: dict[str, float]
    sigma: dict[str, float]
    distortion: tuple[float, ...]
    rms_px: float
    eye_mm: Point
    axis: Point
    resolution: tuple[int, int]


@dataclass(frozen=True, eq=False)
class StereoResult(MarkerResult):
    """Displacements of M markers from C cameras in F frames, and the calibration behind them.

    Per marker: its place as designed, as triangulated in the first images and aligned with the
    design (``found``; ``alignment_mm`` (F,) RMS of what is left), its displacement measured, true
    and uncertain (``sigma``) along the world's axes, ``epipolar_px`` and ``residual_px``.
    ``rig_motion_mm`` (F,): what static markers seemed to do, NaN without. Of the calibration:
    ``boards_mm`` (V, 4, 3) outlines, ``view_rms_px`` (C, V), corners (N, 2) with their errors and
    the number of their camera. ``points_px`` (C, M, 2), ``moved_px`` (F, C, M, 2).
    """

    lens: str
    alignment_mm: Array
    rig_motion_mm: Array
    calibration_px: float
    calibration_points: int
    calibration_outliers: int
    cameras: tuple[CalibratedCamera, ...]
    boards_mm: Array
    view_rms_px: Array
    corner_camera: npt.NDArray[np.int64]
    corners_px: Array
    corner_errors_px: Array
    points_px: Array
    moved_px: Array

    def __post_init__(self) -> None:
        frames, count, cameras = len(self.table.frames), len(self.marker), len(self.cameras)
        wanted = {
            "points_px": (cameras, count, 2), "moved_px": (frames, cameras, count, 2),
            "rig_motion_mm": (frames,), "corners_px": (len(self.corner_camera), 2),
            "corner_errors_px": self.corners_px.shape,
            "view_rms_px": (cameras, len(self.boards_mm)),
        }  # fmt: skip
        wrong = [name for name, shape in wanted.items() if getattr(self, name).shape != shape]
        if wrong:
            raise ValueError(f"of another shape than its {count} markers: {', '.join(wrong)}")

    @classmethod
    def restored(cls, key: str, value: Any) -> Any:
        """As `Result.restored`; cameras are that again."""
        if key != "cameras":
            return super().restored(key, value)
        return tuple(
            CalibratedCamera(**{name: super(cls, cls).restored(name, v) for name, v in one.items()})
            for one in value
        )

    @property
    def found_mm(self) -> Array:
        """Where the markers (M, 3) were at first."""
        found: Array = self.table.vectors("found")[-1]
        return found

    @property
    def note(self) -> str:
        """What became of it, in a few words."""
        return (
            f"{self.measured_count} in space; calibration {self.calibration_px:.4f}"
            f" px over {self.calibration_points} corners"
        )

    def tables(self) -> dict[str, str]:
        """``.csv``: one row for each marker; ``-cameras.csv``: parameters of the calibration."""
        names = list(self.table.columns)
        parameters = []
        for camera in self.cameras:
            for name, value in camera.found.items():
                numbers = (value, camera.true[name], camera.sigma[name])
                unit = next((u for u in ("mm", "deg") if name.endswith(f"_{u}")), "px")
                parameters.append([camera.name, name, unit, *(f"{v:.10g}" for v in numbers)])
        return {
            "": self.table.csv(names[: names.index("epipolar_px") + 1]),
            "-cameras": csv_text(
                ["camera", "parameter", "unit", "found", "true", "sigma"], parameters
            ),
        }

    def report(self, scene: Scene, out: Path) -> Reported:
        """The last frame's numbers, tracked markers, the rig and its calibration, and how far each
        marker moved over several frames."""
        moved = self.moved_px[-1]
        names = [camera.name for camera in self.cameras]
        overlays = [
            Overlay(
                f"{self.name}: tracked markers, {name}", image_path(scene, out, name, 0),
                np.where(np.isfinite(points), points, 0.0), shift,
            )
            for name, points, shift in zip(names, self.points_px, moved, strict=True)
        ]  # fmt: skip
        measured, true = (
            np.linalg.norm(self.table.vectors(what), axis=-1) for what in ("measured", "true")
        )
        return Reported(
            self._measurements(),
            self.histories(scene, "total displacement", measured, true),
            overlays,
            self._figures(inside(out, "figures")),
            {
                name: crops(self.marker, points, shift)
                for name, points, shift in zip(names, self.points_px, moved, strict=True)
            },
        )

    def _measurements(self) -> list[Measurement]:
        """The free end's displacement, the error of all markers, and the calibration."""
        tip = len(self.marker) - 1
        name, marker = self.name, self.marker[tip]
        rows = [
            Measurement.compare(
                f"{name}: {marker}, total", "mm", float(np.linalg.norm(self.measured_mm[tip])),
                float(np.linalg.norm(self.true_mm[tip])), tolerance_relative=GOAL,
            )
        ]  # fmt: skip
        for axis in range(3):
            rows.append(
                Measurement.compare(
                    f"{name}: {marker}, +{'xyz'[axis]}", "mm", float(self.measured_mm[tip, axis]),
                    float(self.true_mm[tip, axis]),
                )
            )  # fmt: skip
        error = np.linalg.norm(self.measured_mm - self.true_mm, axis=1)
        fine = error[np.isfinite(error)]
        if fine.size:
            rms = float(np.sqrt(np.mean(fine**2)))
            rows.append(Measurement.noise(f"{name}: RMS error of all markers", "mm", rms))
        if np.isfinite(self.rig_motion_mm[-1]):
            still = f"{name}: motion of static markers, RMS"
            rows.append(Measurement.noise(still, "mm", float(self.rig_motion_mm[-1])))
        error_name = f"{name}: calibration, reprojection error"
        rows.append(Measurement.noise(error_name, "px", self.calibration_px))
        for camera in self.cameras:
            rows += _calibration(name, camera)
        return rows

    def _figures(self, folder: Path) -> list[Drawing]:
        """Rig, calibration and reconstruction, to be drawn into ``folder``."""
        stem = safe_name(self.name)
        of_camera = [self.corner_camera == k for k in range(len(self.cameras))]
        cameras = [
            RigCamera(
                c.name, np.array(c.eye_mm), np.array(c.axis),
                self.corners_px[rows], self.corner_errors_px[rows], c.resolution,
            )
            for c, rows in zip(self.cameras, of_camera, strict=True)
        ]  # fmt: skip
        calibration = partial(
            draw_calibration, cameras, self.view_rms_px, inside(folder, f"{stem}-calibration.png")
        )
        fine = np.isfinite(self.found_mm).all(axis=1)
        if not fine.any():
            return [calibration]
        rest = self.found_mm
        largest = float(np.nanmax(np.linalg.norm(self.true_mm, axis=1)))
        factor = _magnification(0.15 * float(np.ptp(rest[fine], axis=0).max()), largest)
        return [
            partial(
                draw_rig, cameras, rest[fine], self.boards_mm, inside(folder, f"{stem}-rig.png")
            ),
            calibration,
            partial(
                draw_reconstruction,
                rest, self.measured_mm, self.true_mm, factor, inside(folder, f"{stem}-space.png"),
            ),
        ]  # fmt: skip


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


def _magnification(wanted: float, largest: float) -> float:
    """1, 2, 5, 10, …: so that the largest displacement is drawn about as long as wanted."""
    if not largest > 0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(max(wanted / largest, 1.0)))
    steps = [step * power for step in (1.0, 2.0, 5.0) if step * power * largest <= wanted]
    return float(max(steps, default=1.0))
