"""How pictures are correlated, and what is written of each of them and of all."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from gpusim._version import __version__
from gpusim.choices import Shape, Start, StrainKind, Update
from gpusim.export.correlation import write_correlation
from gpusim.field_summary import field_summary
from gpusim.files.atomic_files import PathLike, safe_name, write_text
from gpusim.files.frame_source import FrameSource
from gpusim.files.output_folder import inside
from gpusim.gpu import Device
from gpusim.measure import DicResult, StereoResult, StrainResult
from gpusim.report.correlation import correlation_report, draw_maps, summary, unmeasured
from gpusim.report.html import render_html
from gpusim.report.model import Figure
from gpusim.validation import checked

Progress = Callable[[str, float, str], None]
_SCHEMA = 1
LONG, FEW = 100, 25  # pictures: of more than so many, maps of so few are drawn, the last among them
UNSAID = ("formats", "backend")
"""Settings that a report doesn't repeat; and words for those that aren't made."""
MISSING = {
    "roi": "all",
    "mask": "none",
    "calibration": "none",
    "calibration_unit": "as the file says",
}


def silent(stage: str, done: float, text: str) -> None:
    """Show no progress."""


@checked
@dataclass(frozen=True)
class CorrelationSettings:
    """How pictures are correlated; names, units and meanings as in ``dic`` and ``strain``.

    Attributes
    ----------
    roi : (x0, y0, x1, y1) px; None: all of the reference.
    mask : a picture whose black pixels aren't used.
    calibration : file of the camera, whose lens is undone: OpenCV, Kalibr, MatchID, VIC or DICe.
    calibration_unit : of its lengths, if the file doesn't say: m, cm, mm, um, in.
    strain_window : odd number of points across the strain gauge.
    formats : of the tables: csv, npz, h5.

    Examples
    --------
    >>> gs.applications.CorrelationSettings(subset=21, strain="hencky").step
    10
    """

    subset: int = 31
    step: int = 10
    shape: Shape = "affine"
    roi: tuple[int, int, int, int] | None = None
    mask: PathLike | None = None
    calibration: PathLike | None = None
    calibration_unit: str | None = None
    update: Update = "never"
    start: Start = "auto"
    search_px: int = 20
    blur_px: float = 0.0
    min_zncc: float = 0.8
    apart_px: float = 0.1
    tolerance: float = 1e-4
    strain: StrainKind | Literal["none"] = "green-lagrange"
    strain_window: int = 5
    formats: tuple[str, ...] = ("csv",)
    backend: str = "auto"
    __repr__ = field_summary


@dataclass(frozen=True)
class CorrelationOutput:
    """What a correlation has found, and the files that it has written.

    Attributes
    ----------
    results : of each picture, or pair, in their order; none if they weren't to be kept.
    strains : of each; None where none was asked for.
    report : what report.json holds: settings, and a row of numbers for each picture.
    files : tables, maps, report.json and, last, report.html.

    Examples
    --------
    >>> settings = gs.applications.CorrelationSettings(step=20, backend="numpy")
    >>> flat = np.full((1, 120, 160), 90, np.uint8)
    >>> gs.applications.correlate_files("before.png", flat, "flat", settings).failure
    'no point could be measured in frame 0; flat/report.html says why'
    """

    results: Sequence[DicResult | StereoResult]
    strains: Sequence[StrainResult | None]
    report: dict[str, Any]
    files: Sequence[Path]
    __repr__ = field_summary

    @property
    def failure(self) -> str:
        """Which pictures have no point measured; "" if all have."""
        empty = unmeasured(self.report["images"])
        text = f"no point could be measured in {empty}; {self.files[-1]} says why"
        return text if empty else ""


@dataclass
class ResultWriter:
    """What has been found and written so far: tables and a map of each result.

    ``pictures`` by what they are called in tables; the first ones name the files.
    """

    folder: Path
    reference: npt.NDArray[Any]
    pictures: Mapping[str, FrameSource]
    settings: dict[str, Any]
    formats: tuple[str, ...]
    progress: Progress
    files: list[Path] = field(default_factory=list)
    results: list[Any] = field(default_factory=list)
    strains: list[StrainResult | None] = field(default_factory=list)
    rows: list[dict[str, Any]] = field(default_factory=list)
    figures: list[Figure] = field(default_factory=list)
    since: float = field(default_factory=time.perf_counter)

    def add(
        self,
        number: int,
        result: DicResult | StereoResult,
        strains: StrainResult | None,
        *,
        keep: bool = True,
    ) -> None:
        """Write the result of the pictures of a ``number``, found since the last one."""
        row = self.sum_up(number, result, strains)
        files = {side: frames.names[number] for side, frames in self.pictures.items()}
        picture, frames = next(iter(files.values())), next(iter(self.pictures.values()))
        stem = f"{number + 1:04d}_{safe_name(Path(picture).stem)}"
        tables = [inside(self.folder, f"{stem}.{suffix}") for suffix in self.formats]
        taken = {name: row[name] for name in ("time_s",) if name in row}
        for path in tables:
            write_correlation(path, result, strains, self.settings | files | taken)
        self.files += tables
        names, count = [Path(name).name for name in files.values()], len(frames)
        if (count - 1 - number) % (1 if count <= LONG else -(-count // FEW)) == 0:
            figure = draw_maps(self.reference, result, strains, inside(self.folder, f"{stem}.png"))
            self.figures.append(replace(figure, frame=", ".join(names)))
            self.files.append(figure.path)
        if keep:
            self.results.append(result)
            self.strains.append(strains)
        self.progress("dic", (number + 1) / len(frames), f"{names[0]}: {row['measured']} measured")
        self.since = time.perf_counter()

    def sum_up(
        self, number: int, result: DicResult | StereoResult, strains: StrainResult | None
    ) -> dict[str, Any]:
        """The row of the pictures of a ``number``, found since the last one."""
        frames, since = next(iter(self.pictures.values())), self.since
        self.since = time.perf_counter()
        row = summary(frames.names[number], result, strains, self.since - since)
        taken = float(frames.times[number])
        self.rows.append(row if np.isnan(taken) else row | {"time_s": taken})
        return self.rows[-1]

    def finished(self, warnings: Sequence[str] = ()) -> CorrelationOutput:
        """All of it, with report.json and report.html of all results."""
        rows, settings, folder = self.rows, self.settings, self.folder
        for frames in self.pictures.values():
            warnings = [
                *warnings,
                *frames.notes,
                *[frames.times_guessed] * bool(frames.times_guessed),
            ]
        report = {"schema": _SCHEMA, "version": __version__, "settings": settings, "images": rows,
                  "warnings": list(warnings)}  # fmt: skip
        tables = [path for path in self.files if path.suffix != ".png"]
        shown = correlation_report(rows, settings, warnings, tables)
        page = render_html(shown, {"other": self.figures}, folder)
        self.files += [
            write_text(inside(folder, "report.json"), json.dumps(report, indent=2) + "\n"),
            write_text(inside(folder, "report.html"), page),
        ]
        return CorrelationOutput(self.results, self.strains, report, self.files)


def described(
    reference: str, settings: CorrelationSettings, device: Device | None
) -> dict[str, Any]:
    """The settings as reports and tables repeat them."""
    given = {key: value for key, value in vars(settings).items() if key not in UNSAID}
    given |= {key: str(given[key] or word) for key, word in MISSING.items()}
    if settings.roi is not None:
        given["roi"] = ",".join(map(str, settings.roi))
    adapter = "none (NumPy)" if device is None else str(device.info.get("device", ""))
    return {"reference": reference, **given, "adapter": adapter, "version": __version__}
