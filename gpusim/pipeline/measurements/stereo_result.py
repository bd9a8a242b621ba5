"""Measured points in space with their truth, as they are kept in the output folder."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.files.atomic_files import safe_name, write_text
from gpusim.files.input_file import Reader, read_input
from gpusim.files.output_folder import inside
from gpusim.pipeline.measurements.deflection import unrefined_text

__all__ = ["CalibratedCamera", "StereoResult"]

Array = npt.NDArray[np.float64]
Pixels = tuple[Array, ...]


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


@dataclass(frozen=True, eq=False)
class StereoResult:
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

    @property
    def note(self) -> str:
        """What became of it, in a few words."""
        count = sum(status == "OK" for status in self.status)
        return (
            f"{count} of {len(self.status)} markers in space; calibration {self.calibration_px:.4f}"
            f" px over {self.calibration_points} corners"
        )

    @property
    def warnings(self) -> list[str]:
        """Markers that were not measured, and those whose white is clipped."""
        lost = [
            f"{marker} ({status})"
            for marker, status in zip(self.marker, self.status, strict=True)
            if status != "OK"
        ]
        found = [f"measure {self.name!r}: not measured: {', '.join(lost)}"] if lost else []
        if self.saturated:
            found.append(
                f"measure {self.name!r}: saturated pixels on {', '.join(self.saturated)}; a "
                "clipped edge moves its marker: lower [sensor] exposure"
            )
        return found + unrefined_text(self.name, self.unrefined)

    def write(self, folder: Path) -> list[Path]:
        """``<name>.csv`` and ``<name>-cameras.csv`` for people, ``<name>.json`` with everything."""
        stem = safe_name(self.name)
        text = json.dumps(_plain(asdict(self)), indent=1, allow_nan=False) + "\n"
        return [
            write_text(inside(folder, f"{stem}.csv"), self._csv()),
            write_text(inside(folder, f"{stem}-cameras.csv"), self._cameras_csv()),
            write_text(inside(folder, f"{stem}.json"), text),
        ]

    def _csv(self) -> str:
        stream = io.StringIO()
        writer = csv.writer(stream, lineterminator="\n")
        head = [f"{what}_{axis}_mm" for what in ("found", "measured", "true", "sigma")
                for axis in "xyz"]  # fmt: skip
        writer.writerow(["marker", "status", "x_mm", "y_mm", "z_mm", *head, "epipolar_px"])
        columns = np.concatenate(
            [self.position_mm, self.found_mm, self.measured_mm, self.true_mm, self.sigma_mm,
             self.epipolar_px[:, None]], axis=1,
        )  # fmt: skip
        for marker, status, row in zip(self.marker, self.status, columns, strict=True):
            cells = [f"{v:.7g}" if np.isfinite(v) else "" for v in row]
            writer.writerow([marker, status, *cells])
        return stream.getvalue()

    def _cameras_csv(self) -> str:
        stream = io.StringIO()
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(["camera", "parameter", "unit", "found", "true", "sigma"])
        for camera in self.cameras:
            for name, value in camera.found.items():
                numbers = (value, camera.true[name], camera.sigma[name])
                unit = next((u for u in ("mm", "deg") if name.endswith(f"_{u}")), "px")
                writer.writerow([camera.name, name, unit, *(f"{v:.10g}" for v in numbers)])
        return stream.getvalue()

    @staticmethod
    def read(folder: Path, name: str, read: Reader = read_input) -> StereoResult:
        """What an earlier run wrote; ``read``: how. Raises InputError, ValueError for damage."""
        file = read(str(inside(folder, f"{safe_name(name)}.json")))
        values = json.loads(file.data)
        values.setdefault("unrefined", [])  # earlier runs didn't say
        count = len(values["marker"])
        shapes = {"epipolar_px": (count,), "residual_px": (count,), "boards_mm": (-1, 4, 3)}
        for item in fields(StereoResult):
            value = values[item.name]
            if item.type == "Array":
                shape = shapes.get(item.name, (len(value), -1) if value else (0, 3))
                values[item.name] = _array(value).reshape(shape)
            elif item.type == "Pixels":
                values[item.name] = tuple(_array(one).reshape(-1, 2) for one in value)
            elif item.name == "cameras":
                values[item.name] = tuple(_camera(one) for one in value)
            elif isinstance(value, list):
                values[item.name] = tuple(value)
            elif value is None:
                values[item.name] = float("nan")
        found = StereoResult(**values)
        found._check()
        return found

    def _check(self) -> None:
        """Raises ValueError for arrays that don't belong together."""
        count, cameras = len(self.marker), len(self.cameras)
        shapes = dict.fromkeys(
            ("position_mm", "found_mm", "measured_mm", "true_mm", "sigma_mm"), (count, 3)
        ) | {"epipolar_px": (count,), "residual_px": (count,)}
        wrong = [name for name, shape in shapes.items() if getattr(self, name).shape != shape]
        wrong += [name for name in ("group", "status") if len(getattr(self, name)) != count]
        for name in ("points_px", "moved_px"):
            rows = getattr(self, name)
            if len(rows) != cameras or any(own.shape != (count, 2) for own in rows):
                wrong.append(name)
        if len(self.view_rms_px) != cameras or len(self.corners_px) != cameras:
            wrong.append("calibration")
        if wrong or not count:
            raise ValueError(f"of another shape than its {count} markers: {', '.join(wrong)}")


def _camera(values: dict[str, Any]) -> CalibratedCamera:
    for key in ("distortion", "eye_mm", "axis"):
        values[key] = _array(values[key])
    for key in ("found", "true", "sigma"):
        values[key] = {n: float("nan") if v is None else v for n, v in values[key].items()}
    width, height = values.pop("resolution")
    return CalibratedCamera(**values, resolution=(width, height))


def _array(values: Any) -> Array:
    return np.array(values, dtype=np.float64)


def _plain(value: Any) -> Any:
    """Plain data for JSON, with None for what isn't finite."""
    if isinstance(value, dict):
        return {key: _plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    if isinstance(value, np.ndarray):
        whole = value.astype(object)
        whole[~np.isfinite(value)] = None
        return whole.tolist()
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value
