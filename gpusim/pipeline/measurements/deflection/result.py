"""A deflection line and its truth, over frames: its table, its warnings, what the report says."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.pipeline.measurements.deflection.projection_error import PARTS
from gpusim.pipeline.measurements.marker_measurement import GOAL, MarkerResult
from gpusim.pipeline.measurements.results import Reported
from gpusim.report import Measurement, Series
from gpusim.scene import Scene

MOST_TILT_DEG = 1.0
"""Beyond it one scale coefficient is off by more than 0.015 %."""
LEAST_SHARE, SIGMAS = 1e-3, 3.0
"""An error of projection is told from this share of the largest displacement, and this many
standard uncertainties, on."""


@dataclass(frozen=True, eq=False)
class DeflectionResult(MarkerResult):
    """A deflection line measured in the images of one camera, and its truth.

    Per marker, in the order from the clamp: its place in space and in the first image, and in each
    frame its displacement in the image, measured and true in the image plane's two world axes; what
    one scale for the image makes of the true motion (``axis_error``, ``plane_error``,
    ``lens_error``, ``scale_error``, ``towards_mm``; `projection_error`).
    ``axes``: those two axes, such as ("+x", "+z"). ``curves`` (G, 3, K): per group the position
    along it and the true displacement in both axes, in the last frame. ``static_px`` (F, S, 2):
    what the markers that can't move seemed to do. ``tracking_px`` (F,): RMS difference of the
    tracked subsets and the refined centres.
    ``tilt_deg``: how far the camera looks off the normal of the plane it measures in.
    """

    camera: str
    direction: str
    axes: tuple[str, str]
    mm_per_px: float
    mm_per_px_sigma: float
    mm_per_px_true: float
    scale_residual_px: float
    subset_px: int
    tilt_deg: float
    static_px: Float
    tracking_px: Float
    curves: Float

    def __post_init__(self) -> None:
        frames, groups = len(self.table.frames), len(dict.fromkeys(self.group))
        static = (frames, self.static_px.shape[1], 2)
        if self.static_px.shape != static or self.curves.shape[:2] != (groups, 3):
            raise ValueError(f"curves {self.curves.shape}, static markers {self.static_px.shape}")

    @property
    def note(self) -> str:
        """What became of it, in a few words."""
        return f"{self.measured_count} measured"

    def tables(self) -> dict[str, str]:
        """``.csv``: one row for each marker."""
        return {"": self.table.csv("sigma_mm")}

    @property
    def warnings(self) -> list[str]:
        """Markers that were not well measured, and what one scale for the image does."""
        found = super().warnings
        if not self.tilt_deg <= MOST_TILT_DEG:
            short = 100.0 * (1.0 - np.cos(np.radians(self.tilt_deg)))
            found.append(
                f"measure {self.name!r}: the camera looks {self.tilt_deg:.1f} degrees off the "
                f"normal of the plane {self.axes[0][1]}-{self.axes[1][1]}; one scale for the image "
                f"reads displacements up to {short:.2g} % short"
            )
        return [*found, *self._projection()]

    def _projection(self) -> Iterator[str]:
        """What one scale for the whole image adds to the values of markers that were measured, in
        the last frame."""
        measured, true = self.measured_mm, self.true_mm
        lost = ~np.isfinite(measured).all(axis=1)
        largest = float(np.linalg.norm(true, axis=1).max(initial=0.0))
        sigma = self.table["sigma_mm"][-1]
        known = sigma[np.isfinite(sigma)]
        noise = float(np.median(known)) if known.size else 0.0
        for part, why in PARTS.items():
            if not any(name.startswith(f"{part}_error_") for name in self.table.columns):
                continue
            errors = self.table.vectors(f"{part}_error")[-1]
            size = np.where(lost, 0.0, np.nan_to_num(np.linalg.norm(errors, axis=1)))
            worst = int(np.argmax(size))
            if not size[worst] > max(LEAST_SHARE * largest, SIGMAS * noise):
                continue
            k = int(np.argmax(np.abs(errors[worst])))
            advice = '; several cameras ([[measure]] type = "stereo") measure in space'
            if part == "axis":
                comes = self.table["towards_mm"][-1][worst]
                way = "towards" if comes > 0 else "away from"
                why += f": {self.marker[worst]} moves {abs(comes):.3g} mm {way} the camera; that"
            elif part == "scale":
                why += (
                    f" ({self.mm_per_px:.5g} mm/px; {self.mm_per_px_true:.5g} at their depth): that"
                )
                advice = ""
            elif part == "exposure":
                why += ": that, the mean of its exposure less its middle,"
                advice = "; a shorter camera.shutter exposure_ms blurs it less"
            else:
                why += ": that"
                advice = "" if part == "start" else advice
            yield (
                f"measure {self.name!r}: {why} explains {errors[worst, k]:+.3g} mm of the error of "
                f"{measured[worst, k] - true[worst, k]:+.3g} mm along {self.axes[k]} at "
                f"{self.marker[worst]}{advice}"
            )

    def report(self, scene: Scene, out: Path) -> Reported:
        """The last frame's numbers and line, tracked markers, and how each marker moved over
        several frames."""
        points, moved = (
            np.stack([self.table[f"{d}column_px"][-1], self.table[f"{d}row_px"][-1]], axis=-1)
            for d in ("", "d")
        )
        overlays, crops = self.pictured(scene, out, {self.camera: (points, moved)}, self.mm_per_px)
        title = f"displacement along {self.direction}"
        lines = [*self._lines(), *self.histories(scene, title, *self._compared())]
        return Reported(self.measurements(scene), lines, overlays, crops=crops)

    def _compared(self) -> Iterator[Float]:
        """What was measured and what is true (F, M) along the measure's direction."""
        k, sign = self._along()
        for what in ("measured", "true"):
            yield sign * self.table.vectors(what)[..., k] + 0.0  # 0, not -0

    def _along(self) -> tuple[int, float]:
        """Which image axis the measure's direction is, and its sign against that axis."""
        for k, axis in enumerate(self.axes):
            if axis[1] == self.direction[1]:
                return k, 1.0 if axis[0] == self.direction[0] else -1.0
        return 1, 1.0

    def measurements(self, scene: Scene) -> Sequence[Measurement]:
        """Of the last marker, the one that moved most, and all."""
        del scene
        name, marker = self.name, self.marker
        measured, truth = (values[-1] for values in self._compared())
        rows = [(f"{marker[-1]}, {self.direction}", "mm", measured[-1], truth[-1])]
        length = np.linalg.norm(self.true_mm, axis=1)
        most = int(np.argmax(length))
        if most != len(length) - 1:
            total = np.linalg.norm(self.measured_mm[most])
            rows.append((f"{marker[most]}, total", "mm", total, length[most]))
        rows.append(("scale coefficient", "mm/px", self.mm_per_px, self.mm_per_px_true))
        found = [
            Measurement.compare(
                f"{name}: {what}", unit, float(one), float(true), tolerance_relative=GOAL
            )
            for what, unit, one, true in rows
        ]
        found += self.rms_error()
        still = self.static_px[-1][np.isfinite(self.static_px[-1]).all(axis=1)]
        if len(still):
            drift = float(np.linalg.norm(still, axis=1).max())
            found.append(
                Measurement.noise(f"{name}: largest motion of a static marker", "px", drift)
            )
        return found

    def _lines(self) -> list[Series]:
        """The deflection line of each group in the last frame."""
        lines = []
        for group, curve in zip(dict.fromkeys(self.group), self.curves, strict=True):
            rows = np.flatnonzero(np.array(self.group) == group)
            own = self.position_mm[rows]
            # across the member: the image axis along which the markers spread least
            spread = [np.ptp(own[:, "xyz".index(axis[1])]) for axis in self.axes]
            across = int(np.argmin(spread))
            axis = self.axes[across]
            sign = -1.0 if axis[1] == self.direction[1] and axis != self.direction else 1.0
            shown = ("-" if axis[0] == "+" else "+") + axis[1] if sign < 0 else axis
            lines.append(
                Series(
                    name=f"{group}: deflection along {shown}",
                    x=np.linalg.norm(own - own[0], axis=1),
                    y_measured=sign * self.measured_mm[rows, across],
                    y_truth=sign * self.true_mm[rows, across],
                    x_label=f"distance along the {group} from {self.marker[rows[0]]} (mm)",
                    y_label=f"deflection along {shown}",
                    y_unit="mm",
                    units_per_px=self.mm_per_px,
                    truth_x=curve[0],
                    truth_y=sign * curve[1 + across],
                )
            )
        return lines
