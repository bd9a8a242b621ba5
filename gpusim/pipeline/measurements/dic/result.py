"""Displacements and strains at points over frames, measured and true: tables, files, what the
report says."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy

from gpusim.arrays.array_types import Bool, Float
from gpusim.files.atomic_files import atomic_path, safe_name
from gpusim.files.hdf5_file import writing_hdf5
from gpusim.files.output_folder import inside
from gpusim.pipeline.measurements.dic import statistics
from gpusim.pipeline.measurements.results import Reported, Result, csv_text
from gpusim.pipeline.pictures.file_names import image_path
from gpusim.report import Drawing, Series
from gpusim.report.field_maps import ComparedField, draw_compared_fields, draw_differences
from gpusim.scene import Scene
from gpusim.scene.description.table import name_and_unit
from gpusim.scene.frames import frame_word

MOST_LOST = 0.02
"""Share of the points from which on a warning says that they were lost."""
KINDS = "measured", "true", "levelled"


@dataclass(frozen=True, eq=False)
class FullFieldResult(Result):
    """What correlation found at M points in F frames, and the truth at the same material points.

    Columns: ``status`` (a word of `gpusim.measure.Status`), ``hidden``, ``x_px`` and ``y_px`` in
    the reference picture; of each of the `quantities` what was ``measured``, what is ``true``, and
    the truth as subsets and strain windows see it: ``levelled``; standard uncertainties.
    ``cameras``; ``axes``: along which displacements are, in words; ``raw_px`` and ``rest_px``
    (F, C, M, 2): what is left of them less the truth, and less the levelled truth, in each camera's
    picture. ``pixel_mm``: width of a pixel on the surface. ``slope`` and ``contrast`` (M,): of the
    subsets (`subset_filter.FilteredField`). ``calibration_px``: NaN without one.
    ``known_errors`` (K, M, Q): what faults of these ``known_names`` do to `displacements` and
    `strains` in the last frame, without any fault of the matches (`geometric_error`).
    """

    cameras: tuple[str, ...]
    axes: tuple[str, ...]
    subset_px: int
    step_px: int
    shape: str
    strain: str
    strain_window: int
    blur_px: float
    formats: tuple[str, ...]
    pixel_mm: float
    calibration_px: float
    known_names: tuple[str, ...]
    known_errors: Float
    raw_px: Float
    rest_px: Float
    slope: Float
    contrast: Float

    def __post_init__(self) -> None:
        shape = len(self.table.frames), len(self.cameras), len(self.table.points), 2
        if self.raw_px.shape != shape or self.rest_px.shape != shape:
            raise ValueError(f"errors {self.raw_px.shape}, {self.rest_px.shape}; expected {shape}")

    @property
    def quantities(self) -> list[str]:
        """Names, with their units, of what is measured at points: "U_mm", "exx"."""
        names = (one.partition("measured_") for one in self.table.columns)
        return [
            name for _, found, name in names if found and f"levelled_{name}" in self.table.columns
        ]

    @property
    def displacements(self) -> list[str]:
        """Those of displacements, in mm if they are known in mm."""
        moved = [name for name in self.quantities if name_and_unit(name)[1]]
        lengths = [name for name in moved if name.endswith("_mm")]
        return lengths or moved

    @property
    def strains(self) -> list[str]:
        """Those of strains."""
        return [name for name in self.quantities if not name_and_unit(name)[1]]

    @property
    def gauge_px(self) -> int:
        """Width of the virtual strain gauge."""
        return (self.strain_window - 1) * self.step_px + self.subset_px

    @property
    def ok(self) -> Bool:
        """(F, M), whether points were measured."""
        return np.asarray(self.table["status"] == "OK")

    def values(self, kind: str, names: list[str]) -> Float:
        """(F, M, K): some quantities as "measured", "true" or "levelled"."""
        return np.stack([self.table[f"{kind}_{name}"] for name in names], axis=-1)

    @property
    def note(self) -> str:
        """What became of it, in a few words."""
        frames, points = self.ok.shape
        return f"{int(self.ok[-1].sum())} of {points} points in {frames} frame{'s' * (frames > 1)}"

    @property
    def warnings(self) -> list[str]:
        """Frames in which many points were lost, with the reasons."""
        found = []
        for place, frame in enumerate(self.table.frames):
            lost, count = self.reasons(place), len(self.table.points)
            total = sum(lost.values())
            if total > MOST_LOST * count:
                told = ", ".join(f"{number} {why}" for why, number in lost.items())
                found.append(
                    f"measure {self.name!r}: {total} of {count} points lost in frame {frame}: "
                    f"{told}"
                )
        return found

    def reasons(self, place: int) -> dict[str, int]:
        """Why points were lost in a frame of the table, in words, the most frequent first."""
        states, hidden = self.table["status"][place], self.table["hidden"][place]
        lost = states != "OK"
        words = Counter(
            "hidden from a camera" if out else state.lower().replace("_", " ")
            for state, out in zip(states[lost].tolist(), hidden[lost].tolist(), strict=True)
        )
        return dict(words.most_common())

    def maps(self) -> dict[str, npt.NDArray[Any]]:
        """All columns with ``difference`` (measured less true) of each quantity, (F, M)."""
        columns = dict(self.table.columns)
        for name in self.quantities:
            columns[f"difference_{name}"] = columns[f"measured_{name}"] - columns[f"true_{name}"]
        return columns

    def tables(self) -> dict[str, str]:
        """``.csv``: a row for each point and frame, if asked for; ``-statistics.csv``."""
        rows = [[one.name, one.unit, one.measured, one.truth] for one in statistics.rows(self)]
        told = {"-statistics": csv_text(["quantity", "unit", "measured", "true"], rows)}
        return told | ({"": self.table.csv()} if "csv" in self.formats else {})

    def write(self, folder: Path) -> list[Path]:
        """Tables, and the maps on their grid in the formats that were asked for."""
        paths = super().write(folder)
        gridded = self.grids() if {"h5", "mat"} & set(self.formats) else {}
        stem = safe_name(self.name)
        if "h5" in self.formats:
            path = inside(folder, f"{stem}.h5")
            with atomic_path(path) as part, writing_hdf5(part) as file:
                for name, values in gridded.items():
                    data = file.create_dataset(name, data=values, compression="gzip")
                    data.attrs["unit"] = name_and_unit(name)[1] or "1"
                file.attrs["axes"] = ", ".join(self.axes)
            paths.append(path)
        if "mat" in self.formats:
            path = inside(folder, f"{stem}.mat")
            with atomic_path(path) as part:
                scipy.io.savemat(str(part), gridded, appendmat=False, do_compression=True)
            paths.append(path)
        return paths

    def grids(self) -> dict[str, npt.NDArray[Any]]:
        """Maps (F, rows, columns) on the measuring grid, NaN where there is no point; ``frame``
        (F,), ``column_px`` and ``row_px`` of the grid."""
        columns, column = np.unique(self.table["x_px"][0], return_inverse=True)
        rows, row = np.unique(self.table["y_px"][0], return_inverse=True)
        result = {"frame": np.array(self.table.frames), "column_px": columns, "row_px": rows}
        for name, values in self.maps().items():
            if name == "status":
                name, values = "measured", values == "OK"
            grid = np.full((len(values), len(rows), len(columns)), np.nan)
            grid[:, row, column] = values
            result[name] = grid
        return result

    def report(self, scene: Scene, out: Path) -> Reported:
        """The last frame's numbers and maps, and how errors and mean strains went over frames."""
        rows = statistics.rows(self)
        picture = image_path(scene, out, self.cameras[0], 0)
        return Reported(rows, self._series(scene), figures=self._figures(picture, out))

    def _figures(self, picture: Path, out: Path) -> list[Drawing]:
        """Maps of the last frame, and the histogram of the differences."""
        if not self.ok[-1].any():
            return []
        folder, stem = inside(out, "figures"), safe_name(self.name)
        points = np.stack([self.table["x_px"][-1], self.table["y_px"][-1]], axis=1)
        fields = {
            name: ComparedField(
                _title(name),
                *(self.table[f"{kind}_{name}"][-1] for kind in KINDS),
            )
            for name in self.quantities
        }
        drawings: list[Drawing] = []
        along = ", ".join(
            f"{name_and_unit(name)[0]} along {axis}"
            for name, axis in zip(self.displacements, self.axes, strict=True)
        )
        groups = {
            "displacement": (self.displacements, along),
            "strain": (self.strains, f"{self.strain}, gauge of {self.gauge_px} px"),
        }
        for what, (names, about) in groups.items():
            if names:
                drawings.append(
                    partial(
                        draw_compared_fields, picture, points, [fields[name] for name in names],
                        f"{self.name}: {what} in frame {self.table.frames[-1]} ({about})",
                        inside(folder, f"{stem}-{what}.png"),
                    )
                )  # fmt: skip
        drawings.append(
            partial(
                draw_differences, self.raw_px[-1].ravel(), self.rest_px[-1].ravel(),
                f"{self.name}: measured less true displacement",
                inside(folder, f"{stem}-histogram.png"),
            )
        )  # fmt: skip
        return drawings

    def _series(self, scene: Scene) -> list[Series]:
        """Over several frames: the error, and each mean strain."""
        frames = self.table.frames
        if len(frames) < 2:
            return []
        instants = np.array([scene.analysis.load_factors[frame] for frame in frames])
        word = frame_word(scene).replace("_", " ")
        errors = [statistics.rms(one) for one in self.raw_px]
        found = [
            Series(f"{self.name}: RMS error", instants, np.array(errors), np.zeros(len(errors)),
                   word, "RMS error", "px")
        ]  # fmt: skip
        for name in self.strains:
            measured, true = (
                np.array([statistics.mean(one[ok]) for one, ok in zip(
                    self.table[f"{kind}_{name}"], np.isfinite(self.table[f"measured_{name}"]),
                    strict=True)])
                for kind in ("measured", "levelled")
            )  # fmt: skip
            found.append(
                Series(f"{self.name}: mean {name}", instants, 1e6 * measured, 1e6 * true, word,
                       f"mean {name}", "1e-6")
            )  # fmt: skip
        return found


def _title(name: str) -> str:
    """A quantity with its unit."""
    what, unit = name_and_unit(name)
    return f"{what} ({unit})" if unit else what
