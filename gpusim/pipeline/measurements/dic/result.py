"""Displacements and strains at points over frames, measured and true: tables, files, what the
report says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import scipy

from gpusim import measure
from gpusim.export.images import encoded_picture
from gpusim.files.atomic_files import safe_name, write_bytes
from gpusim.files.hdf5_file import writing_hdf5
from gpusim.files.output_folder import inside
from gpusim.graph.stage import Output
from gpusim.pipeline.measurements.dic import statistics
from gpusim.pipeline.measurements.dic.point_fields import PointFields
from gpusim.pipeline.measurements.results import Reported, csv_text, mean, rms
from gpusim.pipeline.pictures.file_names import image_path
from gpusim.report import Drawing, Figure, Measurement, Series
from gpusim.report.advice import CAPTION, advice_curves, reason
from gpusim.report.field_maps import ComparedField, draw_compared_fields, draw_differences
from gpusim.scene import Scene
from gpusim.scene.tables.table import name_and_unit

MOST_LOST = 0.02
"""Share of the points from which on a warning says that they were lost."""
KINDS = "measured", "true", "levelled"


@dataclass(frozen=True, eq=False)
class FullFieldResult(PointFields):
    """These fields as files, and what the report says of them."""

    @property
    def note(self) -> str:
        """What became of it, in a few words."""
        frames, points = self.ok.shape
        return f"{int(self.ok[-1].sum())} of {points} points in {frames} frame{'s' * (frames > 1)}"

    @property
    def warnings(self) -> list[str]:
        """The frame in which most points were lost, if they are many, with the reasons."""
        lost, count = (~self.ok).sum(axis=1), len(self.table.points)
        frames, worst = int((lost > MOST_LOST * count).sum()), int(lost.argmax())
        if not frames:
            return []
        what = f"{lost[worst]} of {count} points lost in frame {self.table.frames[worst]}"
        more = f" (more than {100 * MOST_LOST:g} % in {frames} frames)" if frames > 1 else ""
        told = ", ".join(f"{number} {why}" for why, number in self.reasons(worst).items())
        return [f"measure {self.name!r}: {what}{more}: {told}"]

    def with_advice(self, advice: measure.Advice) -> FullFieldResult:
        """The same, and why it has these settings."""
        chosen = ", ".join(f"{key.replace('_', ' ')} {v}" for key, v in advice.settings.items())
        picture = np.frombuffer(encoded_picture(advice_curves(advice), ".png"), np.uint8)
        text = f"Chosen for this picture: {chosen}. {reason(advice)} {CAPTION}"
        return replace(self, advice=text, advice_png=picture)

    def tables(self) -> dict[str, str]:
        """``.csv``: a row for each point and frame, if asked for; ``-statistics.csv``."""
        told = statistics.measurements(self)
        rows = [[one.name, one.unit, one.measured, one.truth] for one in told]
        texts = {"-statistics": csv_text(["quantity", "unit", "measured", "true"], rows)}
        if "csv" in self.formats:
            texts[""] = replace(self.table, columns=self.maps()).csv()
        return texts

    def contents(self) -> dict[str, Output]:
        """Tables, and the maps on their grid in the formats that were asked for."""
        stem, wanted = safe_name(self.name), [one for one in self.formats if one in ("h5", "mat")]
        return super().contents() | {f"{stem}.{suffix}": self._write_grids for suffix in wanted}

    def _write_grids(self, path: Path) -> None:
        gridded = self.grids()
        if path.suffix == ".mat":
            scipy.io.savemat(str(path), gridded, appendmat=False, do_compression=True)
            return
        with writing_hdf5(path) as file:
            for name, values in gridded.items():
                data = file.create_dataset(name, data=values, compression="gzip")
                data.attrs["unit"] = name_and_unit(name)[1] or "1"
            file.attrs["axes"] = ", ".join(self.axes)

    def report(self, scene: Scene, out: Path) -> Reported:
        """The last frame's numbers and maps, and how errors and mean strains went over frames."""
        picture = image_path(scene, out, self.cameras[0], 0)
        figures = self._figures(picture, inside(out, "figures"))
        return Reported(self.measurements(scene), self._series(scene), figures=figures)

    def measurements(self, scene: Scene) -> Sequence[Measurement]:
        """The last frame's numbers."""
        del scene
        return statistics.measurements(self)

    def _figures(self, picture: Path, folder: Path) -> list[Drawing]:
        """Maps of the last frame, and the histogram of the differences."""
        if not self.ok[-1].any():
            return []
        stem, frame = safe_name(self.name), self.table.frames[-1]
        points = np.stack([self.table["x_px"][-1], self.table["y_px"][-1]], axis=1)
        moved = zip(self.displacements, self.axes, strict=True)
        along = ", ".join(f"{name_and_unit(name)[0]} along {axis}" for name, axis in moved)
        drawings: list[Drawing] = []
        for what, names, about in (
            ("displacement", self.displacements, along),
            (
                "strain",
                self.strains,
                f"{self.strain}, x along {self.strain_axis}, gauge of {self.gauge_px} px",
            ),
        ):
            fields = [
                ComparedField(
                    " in ".join(filter(None, name_and_unit(name))),
                    *(self.table[f"{kind}_{name}"][-1] for kind in KINDS),
                )
                for name in names
            ]
            title, path = (
                f"{self.name}: {what} in frame {frame}",
                inside(folder, f"{stem}-{what}.png"),
            )
            if fields:
                drawings.append(
                    partial(
                        draw_compared_fields, picture, points, fields, f"{title} ({about})", path
                    )
                )
        title, path = f"{self.name}: differences", inside(folder, f"{stem}-histogram.png")
        raw, rest = self.raw_px[-1].ravel(), self.rest_px[-1].ravel()
        drawings.append(partial(draw_differences, raw, rest, title, path))
        if self.advice:
            data, path = self.advice_png.tobytes(), inside(folder, f"{stem}-settings.png")
            drawings.append(
                partial(_kept_picture, data, path, f"{self.name}: settings", self.advice)
            )
        return drawings

    def _series(self, scene: Scene) -> list[Series]:
        """Over several frames: the error, and each mean strain."""
        frames = self.table.frames
        if len(frames) < 2:
            return []
        instants, word = self.instants(scene)
        errors = np.array([rms(one) for one in self.raw_px])
        lines = [("RMS error", "px", errors, np.zeros(len(frames)))]
        for name in self.strains:
            measured, smooth = (
                np.where(np.isfinite(self.table[f"measured_{name}"]), self.table[one], np.nan)
                for one in (f"measured_{name}", f"levelled_{name}")
            )
            found, true = (
                statistics.MICROSTRAIN * np.array([mean(one) for one in values])
                for values in (measured, smooth)
            )
            lines.append((f"mean {name}", statistics.MICRO_UNIT, found, true))
        return [
            Series(f"{self.name}: {what}", instants, found, true, word, what, unit)
            for what, unit, found, true in lines
        ]


def _kept_picture(data: bytes, path: Path, title: str, caption: str) -> Figure:
    """A picture that was drawn before."""
    write_bytes(path, data)
    return Figure(path, title, caption)
