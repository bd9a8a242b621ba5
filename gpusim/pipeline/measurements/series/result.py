"""Quantities of a few places over frames, measured and true: table, series, what the report says.

Strains are told in um/m.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.pipeline.measurements.dic.field_columns import STRAINS
from gpusim.pipeline.measurements.dic.statistics import GOAL, MICRO_UNIT, MICROSTRAIN
from gpusim.pipeline.measurements.results import Reported, Result, rms
from gpusim.pipeline.pictures.file_names import image_path
from gpusim.report import Measurement, Overlay, Series
from gpusim.scene import Scene
from gpusim.scene.tables.table import name_and_unit

MOST_ROWS, MOST_CURVES = 8, 6
"""Places whose numbers are told one by one; profiles in a figure."""
LEAST_FOLLOWED = 0.5
"""Share of the subsets of a place below which a warning says so."""


@dataclass(frozen=True, eq=False)
class SeriesResult(Result):
    """Columns of the table: ``status`` ("OK", or why a place was lost), ``followed`` (which share
    of its subsets was), and of each quantity what was ``measured``, what is ``true``, and their
    ``difference``. ``axes``: along which displacements are, in words. ``points_px`` (S, 2): subsets
    in the first camera's reference picture, and how far they went until the last frame,
    ``moved_px``."""

    cameras: tuple[str, ...]
    axes: tuple[str, ...]
    points_px: Float
    moved_px: Float

    @property
    def quantities(self) -> list[str]:
        """Names, with their units, of what was measured: "U_mm", "exx"; the main one first."""
        names = [one.removeprefix("difference_") for one in self.table.columns]
        return [name for name in names if f"difference_{name}" in self.table.columns]

    @property
    def along(self) -> str:
        """The column that says where on a line places are; "" if they aren't on one."""
        return next((one for one in self.table.columns if one.startswith("along_")), "")

    @property
    def warnings(self) -> list[str]:
        """Places that were lost, and those of which much was."""
        found = super().warnings
        least = self.table["followed"].min(axis=0)
        few = (least < LEAST_FOLLOWED) & (self.table["status"] == "OK").all(axis=0)
        if few.any():
            names = ", ".join(
                f"{self.table.points[k]} ({least[k]:.0%})" for k in np.flatnonzero(few)
            )
            found.append(f"measure {self.name!r}: few of the subsets were followed: {names}")
        return found

    def told(self, quantity: str) -> tuple[str, str, Float, Float]:
        """A quantity as people read it: its name, unit, what was measured (F, P), and what is
        true."""
        name, unit = name_and_unit(quantity)
        measured, true = (self.table[f"{kind}_{quantity}"] for kind in ("measured", "true"))
        factor = 1.0 if unit else MICROSTRAIN
        return name, unit or MICRO_UNIT, factor * measured, factor * true

    def report(self, scene: Scene, out: Path) -> Reported:
        """The last frame's numbers, quantities over frames or along a line, and the subsets in the
        reference picture."""
        picture = image_path(scene, out, self.cameras[0], 0)
        seen = Overlay(f"{self.name}: tracked subsets", picture, self.points_px, self.moved_px)
        return Reported(self.measurements(scene), [*self._series(scene)], [seen])

    def _title(self, quantity: str, place: str, *, place_first: bool = False) -> str:
        """Of a number or a curve; the only place of a measure has no name of its own."""
        parts = [quantity] if place == self.table.what else [quantity, place]
        return f"{self.name}: {', '.join(reversed(parts) if place_first else parts)}"

    def measurements(self, scene: Scene) -> Sequence[Measurement]:
        """Of the place where the main quantity is largest, of all places if they are few, and the
        error of all of them in all frames."""
        del scene
        return [*self._measurements()]

    def _measurements(self) -> Iterator[Measurement]:
        told = [self.told(one) for one in self.quantities]
        main = told[0][1]
        # what is largest comes first: a deflection, not how far the line moved along itself
        told.sort(key=lambda one: (one[1] != main, -np.nan_to_num(np.abs(one[3][-1])).max()))
        order = np.argsort(-np.abs(told[0][3][-1]), kind="stable")
        places = order if len(order) <= MOST_ROWS and not self.along else order[:1]
        goal: float | None = GOAL
        for place in places:
            for name, unit, *values in told:
                measured, true = (float(one[-1, place]) for one in values)
                along = " (x along the picture's rows)" if name in STRAINS else ""
                point = self.table.points[place]
                what = self._title(f"{name}{along}", point, place_first=True)
                yield Measurement.compare(what, unit, measured, true, tolerance_relative=goal)
                goal = None
        for name, unit, found, real in told:
            what = f"{self.name}: RMS error of {name}, all frames"
            yield Measurement.noise(what, unit, rms(found - real))

    def _series(self, scene: Scene) -> Iterator[Series]:
        """Each quantity along the line, in some of the frames, or of the first places over
        frames."""
        frames = self.table.frames
        (x, label), how = self.instants(scene), ""
        curves: list[tuple[str, Any]] = [
            (name, (..., k)) for k, name in enumerate(self.table.points[:MOST_ROWS])
        ]
        labels = [name for name, _ in curves]
        if self.along:
            x, label = self.table[self.along][0], f"along the line ({self.along[-2:]})"
            chosen = np.linspace(0, len(frames) - 1, min(len(frames), MOST_CURVES)).astype(int)
            curves, how = [(f"frame {frames[k]}", (k, ...)) for k in chosen], " along the line"
            labels = [scene.analysis.frame_text(frames[k]) for k in chosen]
        for quantity in self.quantities if len(x) > 1 else ():
            name, unit, measured, true = self.told(quantity)
            for (curve, at), shown in zip(curves, labels, strict=True):
                yield Series(
                    self._title(name, curve), x, measured[at], true[at], label, name, unit,
                    figure=f"{self.name}: {name}{how}", label=shown,
                )  # fmt: skip
