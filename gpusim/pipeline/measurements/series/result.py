"""Quantities of a few places over frames, measured and true: table, series, what the report says.

Strains are told in um/m.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.pipeline.measurements.dic.statistics import GOAL, MICRO_UNIT, MICROSTRAIN, rms
from gpusim.pipeline.measurements.results import Reported, Result
from gpusim.pipeline.pictures.file_names import image_path
from gpusim.report import Measurement, Overlay, Series
from gpusim.scene import Scene
from gpusim.scene.description.table import name_and_unit
from gpusim.scene.frames import frame_word

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
        what, found = f"measure {self.name!r}", []
        if lost := ", ".join(self.table.lost()):
            found.append(f"{what}: not measured: {lost}")
        least = self.table["followed"].min(axis=0)
        few = (least < LEAST_FOLLOWED) & (self.table["status"] == "OK").all(axis=0)
        if few.any():
            names = ", ".join(
                f"{self.table.points[k]} ({least[k]:.0%})" for k in np.flatnonzero(few)
            )
            found.append(f"{what}: few of the subsets were followed: {names}")
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
        camera = self.cameras[0]
        picture = image_path(scene, out, camera, 0)
        seen = Overlay(f"{self.name}: tracked subsets", picture, self.points_px, self.moved_px)
        series = self._profiles() if self.along else self._histories(scene)
        return Reported([*self._measurements()], [*series], [seen])

    def _measurements(self) -> Iterator[Measurement]:
        """Of the place where the main quantity is largest, of all places if they are few, and the
        error of all of them in all frames."""
        order = self.quantities
        if self.table.what == "gauge":
            order = sorted(order, key=lambda one: -abs(float(self.told(one)[3][-1, 0])))
        size = np.abs(self.told(order[0])[3][-1])
        few = len(size) <= MOST_ROWS and not self.along
        places = np.argsort(-size, kind="stable") if few else [int(np.argmax(size))]
        for number, place in enumerate(places):
            for name, unit, measured, true in map(self.told, order):
                yield Measurement.compare(
                    f"{self.name}: {self.table.points[place]}, {name}", unit,
                    float(measured[-1, place]), float(true[-1, place]),
                    tolerance_relative=None if number or name != name_and_unit(order[0])[0] else GOAL,
                )  # fmt: skip
        for name, unit, measured, true in map(self.told, order):
            error = rms(measured - true)
            yield Measurement.noise(f"{self.name}: RMS error of {name}, all frames", unit, error)

    def _histories(self, scene: Scene) -> Iterator[Series]:
        """Each quantity of the first places over several frames."""
        frames = self.table.frames
        instants = np.array([scene.analysis.load_factors[frame] for frame in frames])
        word = frame_word(scene).replace("_", " ")
        for name, unit, measured, true in map(
            self.told, self.quantities if len(frames) > 1 else ()
        ):
            for point, one, other in zip(
                self.table.points[:MOST_ROWS], measured.T, true.T, strict=False
            ):
                yield Series(
                    f"{self.name}: {point}, {name}", instants, one, other, word, name, unit,
                    figure=f"{self.name}: {name}",
                )  # fmt: skip

    def _profiles(self) -> Iterator[Series]:
        """Each quantity along the line, in some of the frames."""
        way, frames = self.table[self.along][0], self.table.frames
        places = np.linspace(0, len(frames) - 1, min(len(frames), MOST_CURVES)).astype(int)
        label = f"along the line ({name_and_unit(self.along)[1]})"
        for name, unit, measured, true in map(self.told, self.quantities):
            for k in places:
                yield Series(
                    f"{self.name}: {name}, frame {frames[k]}", way, measured[k], true[k], label,
                    name, unit, figure=f"{self.name}: {name} along the line",
                )  # fmt: skip
