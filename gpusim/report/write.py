"""Write a report: report.json, figures/*.png and report.html in the output folder."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import groupby
from pathlib import Path

import numpy as np

from gpusim.errors import GpusimError
from gpusim.files.atomic_files import PathLike, safe_name, write_text
from gpusim.files.output_folder import delete, inside
from gpusim.report.figure_store import FigureStore
from gpusim.report.figures import (
    draw_convergence,
    draw_errors,
    draw_load_path,
    draw_overlay,
    draw_series,
)
from gpusim.report.html import SECTIONS, render_html
from gpusim.report.model import Figure, Report

# iterations; a direct solve takes one or two, and there is nothing to see of them
_WORTH_A_PLOT = 4
# frames
_WORTH_A_LINE = 3
# errors; the table above them tells one or two as well
_WORTH_BARS = 3


@dataclass(frozen=True)
class ReportPaths:
    """Where the parts of a report lie."""

    html: Path
    json: Path
    figures: tuple[Path, ...]


def write_report(report: Report, out_dir: PathLike) -> ReportPaths:
    """Write ``report.json``, then the figures, then ``report.html``, each of them atomically.

    The JSON comes first, so that it is there whatever happens to the pictures; where that fails,
    it says so. A rerun replaces
    what an earlier one wrote. Raises InputError if a picture that the report names can't be read or
    ``out_dir`` can't be written to, GpusimError if the disk is full.
    """
    folder = Path(out_dir)
    json_path = write_text(inside(folder, "report.json"), report.to_json())
    try:
        figures = _draw(report, inside(folder, "figures"))
        html_path = write_text(inside(folder, "report.html"), render_html(report, figures, folder))
    except Exception as error:
        if not report.failure:
            failed = replace(report, status="failed", failure=f"report: {error}")
            with suppress(OSError, GpusimError):  # it mustn't say "done", even on a full disk
                delete(folder, "report.json")
                write_text(json_path, failed.to_json())
        raise
    every = tuple(figure.path for section in figures.values() for figure in section)
    return ReportPaths(html_path, json_path, every)


def _draw(report: Report, folder: Path) -> dict[str, list[Figure]]:
    """The figures by the section of the page that they stand in."""
    store = FigureStore(folder)
    figure = store.figure
    sections = {"other": [figure(drawing) for drawing in report.figures]}
    sections["explanations"] = [figure(one) for why in report.explanations for one in why.figures]
    together = groupby(report.series, lambda one: one.figure or one.name)
    sections["series"] = [
        figure(partial(draw_series, item, _path(folder, "line", number, name), beside))
        for number, (name, (item, *beside)) in enumerate(together, 1)
    ]
    sections["overlays"] = [
        figure(partial(draw_overlay, item, _path(folder, "markers", number, item.title)))
        for number, item in enumerate(report.overlays, 1)
    ]
    judged = [
        item for item in report.measurements
        if item.tolerance_relative is not None and np.isfinite(item.relative_told)
    ]  # fmt: skip
    if len(judged) >= _WORTH_BARS:
        sections["errors"] = [figure(partial(draw_errors, judged, inside(folder, "errors.png")))]
    if len(report.residuals) >= _WORTH_A_PLOT:
        path = inside(folder, "convergence.png")
        sections["convergence"] = [figure(partial(draw_convergence, report.residuals, path))]
    load_path = report.load_path
    if load_path is not None and len(load_path.frames) >= _WORTH_A_LINE:
        path = inside(folder, "load-path.png")
        sections["load_path"] = [figure(partial(draw_load_path, load_path, path))]
    store.keep()
    return {name: sections.get(name, []) for name in SECTIONS}


def _path(folder: Path, kind: str, number: int, title: str) -> Path:
    """Return a place that stays the same from run to run and is unique in the report."""
    return inside(folder, f"{kind}-{number}-{safe_name(title).lower()[:60]}.png")
