"""Modes, measured and true: tables, what the report says."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.measure.vibration.operational_modes import amplitudes
from gpusim.pipeline.measurements.results import Reported, Result, csv_text
from gpusim.pipeline.pictures.file_names import image_path
from gpusim.report import Measurement, Overlay, Series, Table
from gpusim.report.text import number, uncertain
from gpusim.scene import Scene

GOALS = {"frequency": 0.005, "damping": 0.1, "MAC": 0.01}
"""Relative errors that are good."""


@dataclass(frozen=True, eq=False)
class ModesResult(Result):
    """N modes at P points of a ``camera``'s picture. Columns of the table: frequencies, damping
    (shares of critical) and their standard uncertainties, ``complexity``, ``true_mode``: the number
    of the body's mode that it is, and ``mac`` with that.

    points_px : (P, 2).
    shapes, true_shapes : (N, P, 2), the greatest measured component 1; true ones of the size that
        fits best, NaN where there is none.
    times, displacement_px : (T,) s and (T, P, 2) from which they come.
    lost : so many other points weren't found in all pictures.
    sought : so many modes were looked for, at most; 0 of an earlier run.
    """

    camera: str
    points_px: Float
    shapes: Float
    true_shapes: Float
    times: Float
    displacement_px: Float
    lost: int
    sought: int = 0

    @property
    def note(self) -> str:
        """What became of it, in a few words."""
        found = ", ".join(f"{one:.4g}" for one in self.table["measured_frequency_Hz"][-1])
        return f"{found} Hz"

    @property
    def warnings(self) -> list[str]:
        """Points that were lost, modes that were, and those of which nobody knows the true one."""
        said = [f"{self.lost} points weren't found in all pictures"] if self.lost else []
        if len(self.shapes) < self.sought:
            said += [f"{len(self.shapes)} of {self.sought} modes found"]
        unknown = np.flatnonzero(~np.isfinite(self.table["true_frequency_Hz"][-1]))
        said += [f"{self.table.points[k]} is like none of the body's modes" for k in unknown]
        return [f"measure {self.name!r}: {one}" for one in said]

    def tables(self) -> dict[str, str]:
        """``.csv``: modes; ``-shapes.csv``: a row for each point; ``-series.csv``: displacements, a
        row for each picture."""
        places = [f"{axis}_px" for axis in "xy"]
        count = range(1, len(self.shapes) + 1)
        head = [f"{kind}{k}_{axis}" for k in count for kind in ("mode", "true") for axis in "xy"]
        both = np.stack([self.shapes, self.true_shapes], axis=1)
        shapes = np.moveaxis(both, 2, 0).reshape(len(self.points_px), -1)
        points = range(1, len(self.points_px) + 1)
        moved = [f"p{k}_{axis}_px" for k in points for axis in "xy"]
        series = self.displacement_px.reshape(len(self.times), -1)
        return {
            "": self.table.csv(),
            "-shapes": csv_text([*places, *head], np.hstack([self.points_px, shapes]).tolist()),
            "-series": csv_text(["time_s", *moved], np.c_[self.times, series].tolist()),
        }

    def report(self, scene: Scene, out: Path) -> Reported:
        """Numbers of each mode, its shape along the line and over the first picture."""
        picture = image_path(scene, out, self.camera, 0)
        sizes = amplitudes(self.shapes, self.displacement_px)
        overlays = [
            Overlay(f"{self.name}: {title}", picture, self.points_px, size * shape)
            for title, size, shape in zip(self._titles(), sizes, self.shapes, strict=True)
        ]
        lines, tables = [*self._lines()], [self._summary()]
        return Reported(self.measurements(scene), lines, overlays, tables=tables)

    @property
    def _columns(self) -> dict[str, list[float]]:
        return {name: column[-1].tolist() for name, column in self.table.columns.items()}

    def _summary(self) -> Table:
        """A row for each mode, as far as its uncertainties say."""
        table, names = self._columns, self.table.points
        shares = np.multiply(100.0, (table["measured_damping"], table["sigma_damping"])).tolist()
        rows = zip(
            names, (number(one, 1) for one in table.get("true_mode", [np.nan] * len(names))),
            map(uncertain, table["measured_frequency_Hz"], table["sigma_frequency_Hz"]),
            map(uncertain, *shares), (number(one, 5) for one in table["mac"]), strict=True,
        )  # fmt: skip
        columns = "Mode", "Mode of the body", "Frequency / Hz", "Damping / %", "MAC"
        return Table(f"Measured modes: {self.name}", columns, tuple(rows))

    def _titles(self) -> Sequence[str]:
        rows = zip(self.table.points, self.table["measured_frequency_Hz"][-1], strict=True)
        return [f"{mode}, {frequency:.5g} Hz" for mode, frequency in rows]

    def measurements(self, scene: Scene) -> Sequence[Measurement]:
        """Of every mode; its MAC, if there is one, is compared with 1."""
        del scene
        return [*self._measurements()]

    def _measurements(self) -> Iterator[Measurement]:
        table = self._columns
        for k, mode in enumerate(self.table.points):
            for what, unit, scale, measured, true in (
                ("frequency", "Hz", 1.0, table["measured_frequency_Hz"][k],
                 table["true_frequency_Hz"][k]),
                ("damping", "%", 100.0, table["measured_damping"][k], table["true_damping"][k]),
                ("MAC", "", 1.0, table["mac"][k], 1.0),
            ):  # fmt: skip
                if what == "MAC" and not np.isfinite(measured):
                    continue
                yield Measurement.compare(
                    f"{self.name}: {mode}, {what}", unit, scale * measured, scale * true,
                    tolerance_relative=GOALS[what],
                )  # fmt: skip

    def _lines(self) -> Iterator[Series]:
        """Each shape along the line, in the picture's direction in which it is greatest."""
        along = np.linalg.norm(self.points_px - self.points_px[0], axis=1)
        for title, shape, true in zip(self._titles(), self.shapes, self.true_shapes, strict=True):
            k = int(np.abs(shape).max(axis=0).argmax())
            yield Series(
                f"{self.name}: {title}", along, shape[:, k], true[:, k],
                "along the line (px)", f"shape, along the picture's {'xy'[k]}", "",
            )  # fmt: skip
