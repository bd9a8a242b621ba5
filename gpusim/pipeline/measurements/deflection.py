"""A measured deflection line with its truth, as it is kept in the output folder."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.files.atomic_files import safe_name, write_text
from gpusim.files.input_file import Reader, read_input
from gpusim.files.output_folder import inside
from gpusim.pipeline.measurements.projection_error import PARTS
from gpusim.scene.description import model as m

__all__ = ["DeflectionResult", "unrefined_text"]

Array = npt.NDArray[np.float64]
_TWO = ("axis_error_mm", "plane_error_mm", "lens_error_mm", "scale_error_mm")
MOST_TILT_DEG = 1.0
"""Beyond it one scale coefficient is off by more than 0.015 %."""
LEAST_SHARE, SIGMAS = 1e-3, 3.0
"""An error of projection is told from this share of the largest displacement, and this many
standard uncertainties, on."""


@dataclass(frozen=True, eq=False)
class DeflectionResult:
    """A deflection line measured from two images, and its truth.

    Per marker (M,), in the order from the clamp: ``marker`` names, ``group`` names,
    ``position_mm`` (M, 3) on the unloaded structure, ``points_px``, ``displacement_px`` (M, 2),
    ``measured_mm``, ``true_mm`` (M, 2) in the image plane's two world axes, ``sigma_mm``,
    ``status`` names. ``axes``: those axes, such as ("+x", "+z"). ``curves``: per group, (3, K)
    position along the group and the true displacement in both axes. ``static_px`` (S, 2): what the
    markers that can't move seemed to do. ``tracking_px``: RMS difference of the tracked subsets
    and the refined centres. ``saturated``: markers with clipped pixels. ``unrefined``: markers
    measured by correlation alone, because their cross couldn't be fitted.
    ``tilt_deg``: how far the camera looks off the normal of the plane it measures in.
    ``axis_error_mm``, ``plane_error_mm``, ``lens_error_mm``, ``scale_error_mm`` (M, 2),
    ``towards_mm`` (M,): what one scale for the image makes of the true motion
    (`projection_error`).
    """

    name: str
    camera: str
    direction: str
    axes: tuple[str, str]
    marker: tuple[str, ...]
    group: tuple[str, ...]
    status: tuple[str, ...]
    position_mm: Array
    points_px: Array
    displacement_px: Array
    measured_mm: Array
    true_mm: Array
    sigma_mm: Array
    static_px: Array
    mm_per_px: float
    mm_per_px_sigma: float
    mm_per_px_true: float
    scale_residual_px: float
    subset_px: int
    tracking_px: float
    saturated: tuple[str, ...]
    unrefined: tuple[str, ...]
    tilt_deg: float
    axis_error_mm: Array
    plane_error_mm: Array
    lens_error_mm: Array
    scale_error_mm: Array
    towards_mm: Array
    curves: dict[str, Array]

    @property
    def note(self) -> str:
        """What became of it, in a few words."""
        count = sum(status == "OK" for status in self.status)
        return f"{count} of {len(self.status)} markers measured"

    @property
    def warnings(self) -> list[str]:
        """Markers that were not measured, and those whose white is clipped."""
        found = self._lost()
        if self.saturated:
            found.append(
                f"measure {self.name!r}: saturated pixels on {', '.join(self.saturated)}; a "
                "clipped edge moves its marker: lower [sensor] exposure"
            )
        found += unrefined_text(self.name, self.unrefined)
        if not self.tilt_deg <= MOST_TILT_DEG:
            short = 100.0 * (1.0 - np.cos(np.radians(self.tilt_deg)))
            found.append(
                f"measure {self.name!r}: the camera looks {self.tilt_deg:.1f} degrees off the "
                f"normal of the plane {self.axes[0][1]}-{self.axes[1][1]}; one scale for the image "
                f"reads displacements up to {short:.2g} % short"
            )
        return found + self._projection()

    def _projection(self) -> list[str]:
        """What one scale for the whole image adds to the values of markers that were measured."""
        parts = {"axis": self.axis_error_mm, "plane": self.plane_error_mm,
                 "lens": self.lens_error_mm, "scale": self.scale_error_mm}  # fmt: skip
        found = []
        lost = ~np.isfinite(self.measured_mm).all(axis=1)
        for part, errors in parts.items():
            if not len(errors):
                continue
            size = np.where(lost, 0.0, np.nan_to_num(np.linalg.norm(errors, axis=1)))
            worst = int(np.argmax(size))
            if not size[worst] > max(LEAST_SHARE * self._largest(), SIGMAS * self._noise()):
                continue
            k = int(np.argmax(np.abs(errors[worst])))
            wrong = self.measured_mm[worst, k] - self.true_mm[worst, k]
            why, advice = (
                PARTS[part],
                '; several cameras ([[measure]] type = "stereo") measure in space',
            )
            if part == "axis":
                comes = self.towards_mm[worst]
                way = "towards" if comes > 0 else "away from"
                why += f": {self.marker[worst]} moves {abs(comes):.3g} mm {way} the camera; that"
            elif part == "scale":
                why += (
                    f" ({self.mm_per_px:.5g} mm/px; {self.mm_per_px_true:.5g} at their depth): that"
                )
                advice = ""
            else:
                why += ": that"
            found.append(
                f"measure {self.name!r}: {why} explains {errors[worst, k]:+.3g} mm of the error of "
                f"{wrong:+.3g} mm along {self.axes[k]} at {self.marker[worst]}{advice}"
            )
        return found

    def _largest(self) -> float:
        """The largest true displacement in the image's plane, mm."""
        return float(np.linalg.norm(self.true_mm, axis=1).max(initial=0.0))

    def _noise(self) -> float:
        known = self.sigma_mm[np.isfinite(self.sigma_mm)]
        return float(np.median(known)) if known.size else 0.0

    def _lost(self) -> list[str]:
        lost = [
            f"{marker} ({status})"
            for marker, status in zip(self.marker, self.status, strict=True)
            if status != "OK"
        ]
        return [f"measure {self.name!r}: not measured: {', '.join(lost)}"] if lost else []

    def write(self, folder: Path) -> list[Path]:
        """``<name>.csv`` for people and ``<name>.json`` with everything."""
        stem = safe_name(self.name)
        values = {}
        for item in fields(self):
            value = getattr(self, item.name)
            if isinstance(value, np.ndarray):
                value = _plain(value)
            elif item.name == "curves":
                value = {group: _plain(curve) for group, curve in value.items()}
            elif isinstance(value, float) and not np.isfinite(value):
                value = None
            values[item.name] = value
        text = json.dumps(values, indent=1, allow_nan=False) + "\n"
        return [
            write_text(inside(folder, f"{stem}.csv"), self._csv()),
            write_text(inside(folder, f"{stem}.json"), text),
        ]

    def _csv(self) -> str:
        a, b = (axis[1] for axis in self.axes)
        stream = io.StringIO()
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(
            ["marker", "status", "x_mm", "y_mm", "z_mm", "column_px", "row_px", "dcolumn_px",
             "drow_px", f"measured_{a}_mm", f"measured_{b}_mm", f"true_{a}_mm", f"true_{b}_mm",
             "sigma_mm"]
        )  # fmt: skip
        for i, marker in enumerate(self.marker):
            numbers = [
                *self.position_mm[i], *self.points_px[i], *self.displacement_px[i],
                *self.measured_mm[i], *self.true_mm[i], self.sigma_mm[i],
            ]  # fmt: skip
            cells = [f"{v:.7g}" if np.isfinite(v) else "" for v in numbers]
            writer.writerow([marker, self.status[i], *cells])
        return stream.getvalue()

    @staticmethod
    def read(folder: Path, spec: m.Deflection, read: Reader = read_input) -> DeflectionResult:
        """What an earlier run wrote for ``spec``; ``read``: how. Raises InputError
        or ValueError for damage."""
        file = read(str(inside(folder, f"{safe_name(spec.name)}.json")))
        values = json.loads(file.data)
        values.setdefault("unrefined", [])  # earlier runs didn't say
        for name in (*_TWO, "towards_mm"):
            values.setdefault(name, [])
        for item in fields(DeflectionResult):
            value = values[item.name]
            if item.name == "curves":
                values[item.name] = {g: _array(c, (3, 0)) for g, c in value.items()}
            elif item.type == "Array":
                shape = (0, 2) if item.name in ("static_px", *_TWO) else (0,)
                values[item.name] = _array(value, shape)
            elif isinstance(value, list):
                values[item.name] = tuple(value)
            elif value is None:
                values[item.name] = np.nan
        found = DeflectionResult(**values)
        found._check()
        return found

    def _check(self) -> None:
        """Raises ValueError for arrays that don't belong together."""
        count = len(self.marker)
        shapes = {
            "position_mm": (count, 3), "points_px": (count, 2), "displacement_px": (count, 2),
            "measured_mm": (count, 2), "true_mm": (count, 2), "sigma_mm": (count,),
            "static_px": (len(self.static_px), 2),
        }  # fmt: skip
        wrong = [name for name, shape in shapes.items() if getattr(self, name).shape != shape]
        wrong += [name for name in ("group", "status") if len(getattr(self, name)) != count]
        wrong += [group for group, curve in self.curves.items() if curve.shape[:1] != (3,)]
        if wrong or not count or len(self.axes) != 2:
            raise ValueError(f"of another shape than its {count} markers: {', '.join(wrong)}")


def unrefined_text(name: str, markers: Sequence[str]) -> list[str]:
    """The warning, if any, for markers that correlation alone has measured."""
    if not markers:
        return []
    return [
        f"measure {name!r}: by correlation alone, without a fit of the cross: "
        f"{', '.join(markers)}; a sharp marker may be off by 0.02 px then (others: 0.003)"
    ]


def _plain(values: Array) -> Any:
    """Nested lists with None for what isn't finite."""
    whole = values.astype(object)
    whole[~np.isfinite(values)] = None
    return whole.tolist()


def _array(values: Any, empty: tuple[int, ...]) -> Array:
    array = np.array(values, dtype=np.float64)
    return array if array.size else np.zeros(empty)
