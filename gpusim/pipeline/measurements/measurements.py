"""Every kind of measurement that a scene can ask for: done, read again, and told in the report."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt

from gpusim.errors import GpusimError
from gpusim.files.atomic_files import safe_name
from gpusim.files.input_file import Reader
from gpusim.files.output_folder import inside
from gpusim.pipeline.build.scene_objects import SceneObjects
from gpusim.pipeline.measurements.deflection import DeflectionResult, measure_deflection
from gpusim.pipeline.measurements.sources import Sources
from gpusim.pipeline.measurements.stereo import CalibratedCamera, StereoResult, measure_stereo
from gpusim.pipeline.stages.images import image_path
from gpusim.report import Drawing, Measurement, Overlay, Series
from gpusim.report.measurement_figures import (
    RigCamera,
    draw_calibration,
    draw_reconstruction,
    draw_rig,
)
from gpusim.scene import Scene
from gpusim.scene.description import model as m

__all__ = ["Result", "read_result", "reported", "run_measure", "tracked"]

Array = npt.NDArray[np.float64]
Result = DeflectionResult | StereoResult
GOAL = 1e-3
"""Relative error up to which a measured displacement counts as good."""
GOAL_FOCAL, GOAL_BASELINE = 2e-4, 2e-4
GOAL_CENTRE_PX, GOAL_ANGLE_DEG = 0.5, 0.005


def run_measure(spec: m.Measure, scene: Scene, objects: SceneObjects, sources: Sources) -> Result:
    """Do one measurement."""
    if isinstance(spec, m.Deflection):
        return measure_deflection(spec, scene, objects, sources)
    if isinstance(spec, m.Stereo):
        return measure_stereo(spec, scene, objects, sources)
    raise GpusimError(f"measure {spec.name!r}: compares variants; the scene has none")


def read_result(spec: m.Measure, folder: Path, read: Reader) -> Result:
    """What an earlier run wrote for ``spec``; ``read``: how its files are read."""
    kind = DeflectionResult if isinstance(spec, m.Deflection) else StereoResult
    return kind.read(folder, spec.name, read)


@dataclass(frozen=True)
class Reported:
    """What a measurement says in the report; figures are to be drawn."""

    measurements: list[Measurement]
    series: list[Series]
    overlays: list[Overlay]
    figures: list[Drawing]


def reported(result: Result, scene: Scene, out: Path) -> Reported:
    """Numbers, lines, tracked markers and figures of a measurement."""
    stereo = isinstance(result, StereoResult)
    overlays = [
        Overlay(
            f"{result.name}: tracked markers{f', {camera}' if stereo else ''}",
            image_path(scene, out, camera, 0),
            np.where(np.isfinite(points), points, 0.0),
            moved,
            None if isinstance(result, StereoResult) else result.mm_per_px,
        )
        for camera, points, moved in tracked(result)
    ]
    if isinstance(result, StereoResult):
        figures = _stereo_figures(result, inside(out, "figures"))
        return Reported(_stereo_measurements(result), [], overlays, figures)
    return Reported(_deflection_measurements(result), _deflection_lines(result), overlays, [])


def tracked(result: Result) -> list[tuple[str, Array, Array]]:
    """Camera, markers (M, 2) px in its first picture, and how far they moved into its last one."""
    if isinstance(result, DeflectionResult):
        return [(result.camera, result.points_px, result.displacement_px)]
    names = [camera.name for camera in result.cameras]
    return list(zip(names, result.points_px, result.moved_px, strict=True))


def _deflection_measurements(result: DeflectionResult) -> list[Measurement]:
    k, sign = _along(result)
    measured = sign * result.measured_mm[:, k] + 0.0  # 0, not -0
    truth = sign * result.true_mm[:, k] + 0.0
    tip = len(measured) - 1
    name = f"{result.name}: {result.marker[tip]}, {result.direction}"
    rows = [
        Measurement.compare(name, "mm", float(measured[tip]), float(truth[tip]),
                            tolerance_relative=GOAL)
    ]  # fmt: skip
    length = np.linalg.norm(result.true_mm, axis=1)
    most = int(np.argmax(length))
    if most != tip:
        rows.append(
            Measurement.compare(
                f"{result.name}: {result.marker[most]}, total", "mm",
                float(np.linalg.norm(result.measured_mm[most])), float(length[most]),
                tolerance_relative=GOAL,
            )
        )  # fmt: skip
    rows.append(
        Measurement.compare(
            f"{result.name}: scale coefficient", "mm/px", result.mm_per_px, result.mm_per_px_true,
            tolerance_relative=GOAL,
        )
    )  # fmt: skip
    error = result.measured_mm - result.true_mm
    fine = np.isfinite(error).all(axis=1)
    if fine.any():
        rms = float(np.sqrt(np.mean(np.sum(error[fine] ** 2, axis=1))))
        rows.append(Measurement.noise(f"{result.name}: RMS error of all markers", "mm", rms))
    still = result.static_px[np.isfinite(result.static_px).all(axis=1)]
    if len(still):
        drift = float(np.linalg.norm(still, axis=1).max())
        name = f"{result.name}: largest motion of a static marker"
        rows.append(Measurement.noise(name, "px", drift))
    return rows


def _along(result: DeflectionResult) -> tuple[int, float]:
    """Which image axis the measure's direction is, and its sign against that axis."""
    for k, axis in enumerate(result.axes):
        if axis[1] == result.direction[1]:
            return k, 1.0 if axis[0] == result.direction[0] else -1.0
    return 1, 1.0


def _deflection_lines(result: DeflectionResult) -> list[Series]:
    lines = []
    groups = np.array(result.group)
    for group, curve in result.curves.items():
        rows = np.flatnonzero(groups == group)
        own = result.position_mm[rows]
        # across the member: the image axis along which the markers spread least
        spread = [np.ptp(own[:, "xyz".index(axis[1])]) for axis in result.axes]
        across = int(np.argmin(spread))
        axis = result.axes[across]
        sign = -1.0 if axis[1] == result.direction[1] and axis != result.direction else 1.0
        shown = ("-" if axis[0] == "+" else "+") + axis[1] if sign < 0 else axis
        lines.append(
            Series(
                name=f"{group}: deflection along {shown}",
                x=np.linalg.norm(own - own[0], axis=1),
                y_measured=sign * result.measured_mm[rows, across],
                y_truth=sign * result.true_mm[rows, across],
                x_label=f"distance along the {group} from {result.marker[rows[0]]} (mm)",
                y_label=f"deflection along {shown}",
                y_unit="mm",
                units_per_px=result.mm_per_px,
                truth_x=curve[0],
                truth_y=sign * curve[1 + across],
            )
        )
    return lines


def _stereo_measurements(result: StereoResult) -> list[Measurement]:
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
        rows.append(Measurement.noise(f"{name}: RMS error of all markers", "mm", rms))
    if np.isfinite(result.rig_motion_mm):
        still = f"{name}: motion of static markers, RMS"
        rows.append(Measurement.noise(still, "mm", result.rig_motion_mm))
    rms = result.calibration_px
    rows.append(Measurement.noise(f"{name}: calibration, reprojection error", "px", rms))
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


def _stereo_figures(result: StereoResult, folder: Path) -> list[Drawing]:
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
