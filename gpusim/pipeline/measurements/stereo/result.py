"""Markers in space over frames, and the calibration that they rest on: tables, figures, what the
report says."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from gpusim.arrays.array_types import Float, Long
from gpusim.arrays.round_numbers import round_down
from gpusim.files.atomic_files import safe_name
from gpusim.files.output_folder import inside
from gpusim.pipeline.measurements.marker_measurement import GOAL, MarkerResult
from gpusim.pipeline.measurements.results import Reported, csv_text
from gpusim.report import Drawing, Measurement
from gpusim.report.measurement_figures import (
    RigCamera,
    draw_calibration,
    draw_reconstruction,
    draw_rig,
)
from gpusim.scene import Scene

PARAMETERS = {"fx": "px", "fy": "px", "cx": "px", "cy": "px", "baseline_mm": "mm",
              "angle_deg": "deg"}  # fmt: skip
"""Of a camera with their units; the last two against the first camera."""
RELATIVE_GOALS = {"fx": 2e-4, "baseline_mm": 2e-4}
GOALS = {"cx": 0.5, "cy": 0.5, "angle_deg": 0.005}


@dataclass(frozen=True, eq=False)
class StereoResult(MarkerResult):
    """Displacements of M markers from C cameras in F frames, and the calibration behind them.

    Per marker: its place as designed, as triangulated in the first images and aligned with the
    design (``found``; ``alignment_mm`` (F,) RMS of what is left), its displacement measured, true
    and uncertain (``sigma``) along the world's axes, ``epipolar_px`` and ``residual_px``.
    ``rig_motion_mm`` (F,): what static markers seemed to do, NaN without. Of the calibration:
    ``parameters`` (3, C, 6) found, true and uncertain (`PARAMETERS`, NaN where there is none),
    OpenCV's ``distortion`` (C, 14), ``camera_rms_px`` (C,), where the true cameras are and look
    (``eye_mm``, ``axis`` (C, 3)), ``resolution`` (C, 2) px,
    ``boards_mm`` (V, 4, 3) outlines, ``view_rms_px`` (C, V), corners (N, 2) with their errors and
    the number of their camera. ``points_px`` (C, M, 2), ``moved_px`` (F, C, M, 2).
    """

    lens: str
    alignment_mm: Float
    rig_motion_mm: Float
    calibration_px: float
    calibration_points: int
    calibration_outliers: int
    cameras: tuple[str, ...]
    parameters: Float
    distortion: Float
    camera_rms_px: Float
    eye_mm: Float
    axis: Float
    resolution: Long
    boards_mm: Float
    view_rms_px: Float
    corner_camera: Long
    corners_px: Float
    corner_errors_px: Float
    points_px: Float
    moved_px: Float

    def __post_init__(self) -> None:
        frames, count, cameras = len(self.table.frames), len(self.marker), len(self.cameras)
        wanted = {
            "points_px": (cameras, count, 2), "moved_px": (frames, cameras, count, 2),
            "rig_motion_mm": (frames,), "parameters": (3, cameras, len(PARAMETERS)),
            "eye_mm": (cameras, 3), "axis": (cameras, 3),
            "corners_px": (len(self.corner_camera), 2),
            "corner_errors_px": self.corners_px.shape,
            "view_rms_px": (cameras, len(self.boards_mm)),
        }  # fmt: skip
        wrong = [name for name, shape in wanted.items() if getattr(self, name).shape != shape]
        if wrong:
            raise ValueError(f"of another shape than its {count} markers: {', '.join(wrong)}")

    @property
    def found_mm(self) -> Float:
        """Where the markers (M, 3) were at first."""
        return self.table.last("found")

    @property
    def note(self) -> str:
        """What became of it, in a few words."""
        return (
            f"{self.measured_count} in space; calibration {self.calibration_px:.4f}"
            f" px over {self.calibration_points} corners"
        )

    def tables(self) -> dict[str, str]:
        """``.csv``: one row for each marker; ``-cameras.csv``: parameters of the calibration."""
        rows = [
            [camera, name, unit, *(f"{value:.10g}" for value in values)]
            for camera, table in zip(self.cameras, self.parameters.swapaxes(0, 1), strict=True)
            for (name, unit), values in zip(PARAMETERS.items(), table.T, strict=True)
            if np.isfinite(values[0])
        ]
        return {
            "": self.table.csv("epipolar_px"),
            "-cameras": csv_text(["camera", "parameter", "unit", "found", "true", "sigma"], rows),
        }

    def report(self, scene: Scene, out: Path) -> Reported:
        """The last frame's numbers, tracked markers, the rig and its calibration, and how far each
        marker moved over several frames."""
        views = zip(self.points_px, self.moved_px[-1], strict=True)
        overlays, crops = self.pictured(scene, out, dict(zip(self.cameras, views, strict=True)))
        histories = self.histories(scene, "total displacement", *self._lengths())
        figures = self._figures(inside(out, "figures"))
        return Reported(self.measurements(scene), histories, overlays, figures, crops)

    def _lengths(self) -> Iterator[Float]:
        """Of the measured and of the true displacements (F, M), mm."""
        for what in ("measured", "true"):
            yield np.linalg.norm(self.table.vectors(what), axis=-1)

    def measurements(self, scene: Scene) -> Sequence[Measurement]:
        """The free end's displacement, the error of all markers, and the calibration."""
        del scene
        name, marker = self.name, self.marker[-1]
        measured, true = (lengths[-1] for lengths in self._lengths())
        rows = [
            Measurement.compare(
                f"{name}: {marker}, total", "mm", float(measured[-1]), float(true[-1]),
                tolerance_relative=GOAL,
            )
        ]  # fmt: skip
        for axis, one, other in zip("xyz", self.measured_mm[-1], self.true_mm[-1], strict=True):
            rows.append(
                Measurement.compare(f"{name}: {marker}, +{axis}", "mm", float(one), float(other))
            )
        rows += self.rms_error()
        noise = [
            ("motion of static markers, RMS", "mm", float(self.rig_motion_mm[-1])),
            ("calibration, reprojection error", "px", self.calibration_px),
        ]
        rows += [
            Measurement.noise(f"{name}: {what}", unit, value)
            for what, unit, value in noise
            if np.isfinite(value)
        ]
        return [*rows, *self._calibration()]

    def _calibration(self) -> Iterator[Measurement]:
        """The cameras' parameters, as good as a rig has to know them."""
        for k, camera in enumerate(self.cameras):
            for name, found, true, _ in zip(PARAMETERS, *self.parameters[:, k], strict=True):
                goal = RELATIVE_GOALS.get(name, GOALS.get(name, np.nan) / max(abs(true), 1e-9))
                if np.isfinite(found) and np.isfinite(goal):
                    yield Measurement.compare(
                        f"{self.name}: {camera}, {name.split('_')[0]}", PARAMETERS[name],
                        float(found), float(true), tolerance_relative=float(goal),
                    )  # fmt: skip

    def _figures(self, folder: Path) -> list[Drawing]:
        """Reconstruction, rig and calibration, to be drawn into ``folder``."""
        stem = safe_name(self.name)
        of_camera = [self.corner_camera == k for k in range(len(self.cameras))]
        cameras = [
            RigCamera(name, eye, axis, self.corners_px[rows], self.corner_errors_px[rows], size)
            for name, eye, axis, rows, size in zip(
                self.cameras, self.eye_mm, self.axis, of_camera, self.resolution.tolist(),
                strict=True,
            )
        ]  # fmt: skip
        calibration = partial(
            draw_calibration, cameras, self.view_rms_px, inside(folder, f"{stem}-calibration.png")
        )
        fine = np.isfinite(self.found_mm).all(axis=1)
        if not fine.any():
            return [calibration]
        rest = self.found_mm
        # the largest displacement is drawn about as long as 15 % of the structure
        longest = 0.15 * float(np.ptp(rest[fine], axis=0).max())
        largest = float(np.nanmax(np.linalg.norm(self.true_mm, axis=1)))
        factor = round_down(max(longest / largest, 1.0)) if largest > 0.0 else 1.0
        return [
            partial(
                draw_reconstruction,
                rest, self.measured_mm, self.true_mm, factor, inside(folder, f"{stem}-space.png"),
            ),
            partial(
                draw_rig, cameras, rest[fine], self.boards_mm, inside(folder, f"{stem}-rig.png")
            ),
            calibration,
        ]  # fmt: skip
