"""Fields at points over frames, measured and true, and how they were measured."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Bool, Float
from gpusim.measure.correlation.warp import Shape
from gpusim.pipeline.measurements.results import Result
from gpusim.scene.tables.table import name_and_unit


@dataclass(frozen=True, eq=False)
class PointFields(Result):
    """What correlation found at M points in F frames, and the truth at the same material points.

    Columns: ``status`` (a word of `gpusim.measure.Status`), ``hidden``, ``x_px`` and ``y_px`` in
    the reference picture; of each of the `quantities` what was ``measured``, what is ``true``, and
    the truth as subsets and strain windows see it: ``levelled``; standard uncertainties.
    ``cameras``; ``axes``: along which displacements are, in words; ``raw_px`` and ``rest_px``
    (F, C, M, 2): what is left of them less the truth, and less the levelled truth, in each camera's
    picture. ``pixel_mm``: width of a pixel on the surface. ``slope``, ``contrast`` (M,) and
    ``spread`` (M, 2): of the subsets (`subset_filter.FilteredField`). ``calibration_px``: NaN
    without one. ``geometric_errors``: parts (M, Q) by name of the error of `displacements` and
    `strains` in the last frame that no match has made, and ``causes`` of the part "calibration" by
    name, what each of them does alone. ``advice``: why these settings, if they were chosen from the
    picture, and ``advice_png``: the file of a picture of what they were chosen from.
    """

    cameras: tuple[str, ...]
    axes: tuple[str, ...]
    subset_px: int
    step_px: int
    shape: Shape
    strain: str
    strain_window: int
    blur_px: float
    formats: tuple[str, ...]
    pixel_mm: float
    calibration_px: float
    geometric_errors: Mapping[str, Float]
    causes: Mapping[str, Float]
    raw_px: Float
    rest_px: Float
    slope: Float
    contrast: Float
    spread: Float
    advice: str = ""
    advice_png: npt.NDArray[np.uint8] = field(default_factory=lambda: np.zeros(0, np.uint8))

    def __post_init__(self) -> None:
        shape = len(self.table.frames), len(self.cameras), len(self.table.points), 2
        if self.raw_px.shape != shape or self.rest_px.shape != shape:
            raise ValueError(f"errors {self.raw_px.shape}, {self.rest_px.shape}; expected {shape}")

    @property
    def quantities(self) -> list[str]:
        """Names, with their units, of what is measured at points: "U_mm", "exx"."""
        names = [one.removeprefix("levelled_") for one in self.table.columns]
        return [name for name in names if f"levelled_{name}" in self.table.columns]

    @property
    def displacements(self) -> list[str]:
        """Those of displacements, in mm if they are known in mm."""
        moved = [name for name in self.quantities if name_and_unit(name)[1]]
        lengths = [name for name in moved if name.endswith("_mm")]
        return lengths or moved

    @property
    def places(self) -> list[str]:
        """Columns of where points were found in the first pictures, along axes of displacements."""
        found = [one for one in self.table.columns if one.startswith("measured_")]
        shape = [one for one in found if one.removeprefix("measured_") not in self.quantities]
        return shape or ["x_px", "y_px"]

    @property
    def strains(self) -> list[str]:
        """Those of strains."""
        return [name for name in self.quantities if not name_and_unit(name)[1]]

    @property
    def strain_axis(self) -> str:
        """Along which exx is, in words: a pair tells strains in the surface."""
        return "the picture's rows" if len(self.axes) > 2 else self.axes[0]

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
