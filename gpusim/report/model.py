"""What a run found, as plain data: the source of report.json, the figures and report.html."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from gpusim._version import __version__
from gpusim.arrays.array_types import Float
from gpusim.display import notebook_html, plotted
from gpusim.field_summary import field_summary
from gpusim.printable import printable
from gpusim.report.findings import (
    Budget,
    Explanation,
    FieldPicture,
    LoadPath,
    Mechanics,
    MeshSummary,
    Published,
)
from gpusim.report.text import plain_data
from gpusim.validation import require

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SCHEMA = 1
StageState = Literal["run", "skipped", "reused", "failed"]
Status = Literal["done", "failed"]
MOST_TOLD = 10.0
"""Errors over the truth from which on their ratio says nothing."""


@dataclass(frozen=True)
class Stage:
    """One stage of the run: what was done with it, why, and how long it took (s)."""

    name: str
    state: StageState
    reason: str
    seconds: float


@dataclass(frozen=True)
class SolutionSummary:
    """How the solve ended. ``error_estimate`` is the relative displacement error (energy norm),
    ``method`` the solver that was used."""

    unknowns: int
    iterations: int
    converged: bool
    error_estimate: float
    method: str = ""


@dataclass(frozen=True)
class Measurement:
    """One measured number beside the true one, in ``unit``.

    NaN stands for "not measured" and becomes null in JSON. ``tolerance_relative`` is the relative
    error up to which the number counts as good; without it the report gives no verdict. A
    ``detail`` is shown on demand.
    """

    name: str
    unit: str
    measured: float
    truth: float
    error: float
    error_relative: float
    tolerance_relative: float | None = None
    detail: bool = False

    @classmethod
    def compare(
        cls,
        name: str,
        unit: str,
        measured: float,
        truth: float,
        *,
        tolerance_relative: float | None = None,
        detail: bool = False,
    ) -> Measurement:
        """Return the measurement with error = measured - truth, relative to abs(truth)."""
        error = measured - truth
        relative = error / abs(truth) if truth != 0.0 else math.nan
        return cls(name, unit, measured, truth, error, relative, tolerance_relative, detail)

    @classmethod
    def noise(cls, name: str, unit: str, measured: float) -> Measurement:
        """Return the measurement of what should be zero."""
        return cls(name, unit, measured, 0.0, measured, math.nan)

    def content(self) -> dict[str, Any]:
        """For report.json."""
        shown = "tolerance_relative", "detail"
        return {key: value for key, value in vars(self).items() if key not in shown}

    @property
    def relative_told(self) -> float:
        """The relative error for a reader: NaN where the truth is zero but for rounding or noise,
        many times smaller than the error."""
        return self.error_relative if abs(self.error_relative) < MOST_TOLD else math.nan

    @property
    def verdict(self) -> Literal["good", "bad", "unknown"]:
        """``good`` within the tolerance, ``bad`` beyond it or not measured, else ``unknown``."""
        if not math.isfinite(self.measured):
            return "bad"
        if self.tolerance_relative is None or not math.isfinite(self.truth):
            return "unknown"
        # |error| <= tolerance |truth| also judges a truth of zero, and is false for NaN.
        good = abs(self.error) <= self.tolerance_relative * abs(self.truth)
        return "good" if good else "bad"


@dataclass(frozen=True)
class Series:
    """Measured points on a line, against the truth at the same places.

    Parameters
    ----------
    name, x_label, y_label, y_unit
        Words for the figure; ``x_label`` carries its unit, ``y_label`` doesn't.
    x, y_measured, y_truth
        (M,) float64; NaN where a point was not measured.
    units_per_px
        Units of y per pixel; with it the residual is also shown in pixels.
    truth_x, truth_y
        (T,) float64, the truth drawn as a finer curve; empty to draw it through ``y_truth``.
    figure, label
        Series over the same x that follow each other and name one figure are drawn in it together,
        each with its label.
    """

    name: str
    x: Float
    y_measured: Float
    y_truth: Float
    x_label: str
    y_label: str
    y_unit: str
    units_per_px: float | None = None
    truth_x: Float = field(default_factory=lambda: np.empty(0))
    truth_y: Float = field(default_factory=lambda: np.empty(0))
    figure: str = ""
    label: str = ""

    def __post_init__(self) -> None:
        what, x, measured, truth = f"series {self.name!r}", self.x, self.y_measured, self.y_truth
        alike = all(array.shape == (len(x),) for array in (x, measured, truth))
        got = f"x {x.shape}, measured {measured.shape}, truth {truth.shape}"
        require(len(x) > 0 and alike, what, got, "three times (M,), M > 0")
        x, truth = self.truth_x, self.truth_y
        got = f"truth_x {x.shape}, truth_y {truth.shape}"
        require(x.shape == truth.shape and x.ndim == 1, what, got, "twice (T,)")


@dataclass(frozen=True)
class FramePair:
    """The reference and the deformed image of one camera.

    Parameters
    ----------
    camera, reference, deformed, caption
        Camera name, the two image files, one sentence.
    crops
        Up to four places shown at full resolution: (label, x, y, x deformed, y deformed) px.
    bits
        Of the grey levels: 12 in a file of 16 would be shown nearly black. 0: as few as hold them.
    frames
        All images of the camera with what is said of each, in order: shown with a slider.
    shown
        What the deformed one shows, in a word or two.
    """

    camera: str
    reference: Path
    deformed: Path
    caption: str
    crops: tuple[tuple[str, float, float, float, float], ...] = ()
    bits: int = 0
    frames: tuple[tuple[str, Path], ...] = ()
    shown: str = "loaded"


@dataclass(frozen=True)
class Film:
    """The ``file`` of a camera's film, one to be ``shown`` in its place (MP4), and a sentence."""

    camera: str
    file: Path
    shown: Path
    caption: str


@dataclass(frozen=True)
class Overlay:
    """Tracked points on an image.

    ``image`` is the picture they were tracked from, or its file, ``points`` (M, 2) px (x right,
    y down; integer = pixel centre), ``displacement`` (M, 2) px, NaN where a point was lost.
    """

    title: str
    image: Path | npt.NDArray[Any]
    points: Float
    displacement: Float
    units_per_px: float | None = None
    unit: str = "mm"

    def __post_init__(self) -> None:
        what, shape, moved = f"overlay {self.title!r}", self.points.shape, self.displacement.shape
        places = len(shape) == 2 and shape[1] == 2 and shape[0] > 0
        require(places, f"{what}: points", f"shape {shape}", "(M, 2), M > 0")
        require(moved == shape, f"{what}: displacement", f"shape {moved}", f"{shape}")
        known = np.isfinite(self.points).all()
        require(known, f"{what}: points", "some that aren't finite", "finite numbers, px")


@dataclass(frozen=True)
class Figure:
    """A picture file; on a dark page a plot is inverted, a ``photo`` isn't.

    Figures of one title that follow each other and say of which ``frame`` they are ("load factor
    0.5") are shown as one, with a slider over the frames.
    """

    path: Path
    title: str
    caption: str
    photo: bool = False
    frame: str = ""


Drawing = Callable[[], Figure]
"""Draws a figure: something that can be pickled, as `functools.partial` of a module's function is.
By what is pickled one sees whether it has changed."""


@dataclass(frozen=True)
class Link:
    """A file that the run wrote, named for the reader."""

    label: str
    path: Path


@dataclass(frozen=True)
class Table:
    """Results as text: a heading, column titles, and rows whose first cell names the row."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    def __post_init__(self) -> None:
        for row in self.rows:
            cells, columns = len(row), len(self.columns)
            got = f"a row of {cells} cells"
            require(cells == columns, f"table {self.title!r}", got, f"{columns}")


@dataclass(frozen=True)
class Report:
    """Everything a run has to say. Only the first block goes into report.json.

    ``failure`` is the error's message if ``status`` is "failed". ``highlights`` are label ->
    (value, note) of the cards on top, ``first_tables`` stand before what was measured, ``facts``
    are label -> value pairs (device, versions, sizes), and ``scene_text`` is the resolved scene
    file.

    Examples
    --------
    >>> gs.Report(scene="bar", adapter="llvmpipe", status="done").to_json().splitlines()[:3]
    ['{', '  "schema": 1,', '  "version": "0.1.0",']
    """

    scene: str
    adapter: str
    status: Status
    stages: tuple[Stage, ...] = ()
    solution: SolutionSummary | None = None
    measurements: tuple[Measurement, ...] = ()
    warnings: tuple[str, ...] = ()
    version: str = __version__
    mechanics: Mechanics | None = None
    meshes: tuple[MeshSummary, ...] = ()
    published: tuple[Published, ...] = ()
    budget: Budget | None = None
    explanations: tuple[Explanation, ...] = ()
    fields: tuple[FieldPicture, ...] = ()
    load_path: LoadPath | None = None
    modes: tuple[Mapping[str, Any], ...] = ()

    description: str = ""
    failure: str = ""
    highlights: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    facts: Mapping[str, str] = field(default_factory=dict)
    scene_text: str = ""
    frames: tuple[FramePair, ...] = ()
    films: tuple[Film, ...] = ()
    series: tuple[Series, ...] = ()
    overlays: tuple[Overlay, ...] = ()
    residuals: tuple[float, ...] = ()
    tolerance: float | None = None
    figures: tuple[Drawing, ...] = ()
    first_tables: tuple[Table, ...] = ()
    tables: tuple[Table, ...] = ()
    links: tuple[Link, ...] = ()
    __repr__ = field_summary

    def __post_init__(self) -> None:
        fits = (self.status == "failed") == bool(self.failure)
        got = f"status {self.status!r} with failure {self.failure!r}"
        require(fits, "report", got, "a failure message exactly if the run failed")

    def _repr_html_(self) -> str | None:
        return notebook_html("report", self)

    def plot(self, ax: Axes | None = None, *, series: str | int = 0, **style: Any) -> Axes:
        """Draw what was measured against what is true, in matplotlib's axes.

        ``series``: one of the measured lines, by name or number; a run without lines shows the
        relative errors. ``style`` goes to the measured points. Returns the axes.
        """
        return plotted("report", self, ax, series=series, **style)

    def to_json(self) -> str:
        """Return the text of report.json, schema 1; a number that isn't finite is null."""
        content = {
            "schema": SCHEMA,
            "version": self.version,
            "scene": self.scene,
            "adapter": self.adapter,
            "status": self.status,
            "stages": self.stages,
            "solution": self.solution,
            "mesh": self.meshes,
            "mechanics": self.mechanics,
            "fields": self.fields,
            "load_path": self.load_path,
            "modes": self.modes,
            "measurements": self.measurements,
            "published": self.published,
            "budget": self.budget,
            "explanations": self.explanations,
            "warnings": ([self.failure] if self.failure else []) + list(self.warnings),
            "facts": self.facts,
        }
        text = json.dumps(plain_data(content), indent=2, ensure_ascii=False, allow_nan=False)
        return printable(text, keep="\n") + "\n"
