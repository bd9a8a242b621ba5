"""What a run found: measured beside true, warnings, a picture and a deflection line."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from gpusim.errors import InputError
from gpusim.export.images import read_image
from gpusim.notebook.axes import flat_axes
from gpusim.notebook.page import Picture, page, quantity
from gpusim.report.figures import draw_error_bars, draw_measured
from gpusim.report.html import aligned, fitting, reduced
from gpusim.report.model import FramePair, Measurement, Report, Series
from gpusim.report.style import drawn, named
from gpusim.report.text import duration, signed_percent
from gpusim.validation import require

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MOST_ROWS, _MOST_NOTES = 12, 5
_WIDTH, _HEIGHT = 480, 360  # px, at most
_MARKS = {"good": "✓", "bad": "✗", "unknown": ""}


def html(report: Report) -> str:
    """Measurements with their errors, warnings; the first loaded picture, the first line."""
    shown = report.measurements[:_MOST_ROWS]
    rows = [_row(item) for item in shown]
    head = ("", "measured", "true", "error", "relative", "") if rows else ()
    seconds = sum(s.seconds for s in report.stages if np.isfinite(s.seconds))
    facts = [report.status, report.adapter, duration(seconds) if report.stages else ""]
    if report.solution is not None:
        error = quantity(report.solution.error_estimate, digits=2)
        facts.append(f"{report.solution.unknowns:,} unknowns, displacements right to {error}")
    notes = [", ".join(fact for fact in facts if fact) + "."]
    if report.failure:
        notes.insert(0, f"Failed: {report.failure}")
    more = len(report.measurements) - len(shown)
    notes += [f"And {more} more measurements."] if more else []
    notes += [f"Warning: {text}" for text in report.warnings[:_MOST_NOTES]]
    if len(report.warnings) > _MOST_NOTES:
        notes.append(f"And {len(report.warnings) - _MOST_NOTES} more warnings.")
    page_file = _page_of(report)
    notes += [f"All of it: {page_file}"] if page_file else []
    pictures = [partial(_photo, pair) for pair in report.frames[:1] if pair.deformed.is_file()]
    pictures += [partial(_line, series) for series in report.series[:1]]
    return page(f"Report of {report.scene}", rows, pictures, notes, head)


def plot(report: Report, ax: Axes | None, *, series: str | int = 0, **style: Any) -> Axes:
    """A measured line on the true one; the relative errors of a run without lines."""
    if report.series:
        return plot_series(_chosen(report, series), ax, **style)
    known = [one for one in report.measurements if np.isfinite(one.relative_told)]
    what = "Report.plot: nothing was measured against a true value"
    require(bool(known), what, "no relative error", "some")
    ax = flat_axes(ax)
    draw_error_bars(ax, known)
    return ax


def plot_series(series: Series, ax: Axes | None, **style: Any) -> Axes:
    """Measured points on the true curve; ``style`` is the points'."""
    ax = flat_axes(ax)
    draw_measured(ax, series, **style)
    ax.set_xlabel(series.x_label)
    ax.set_title(named(series.name))
    return ax


def _chosen(report: Report, series: str | int) -> Series:
    names = [one.name for one in report.series]
    if isinstance(series, str) and series in names:
        return report.series[names.index(series)]
    if isinstance(series, int) and 0 <= series < len(names):
        return report.series[series]
    raise InputError(f"Report.plot: series; got {series!r}; expected one of {names}, or its number")


def _row(item: Measurement) -> tuple[str, ...]:
    measured, true, error = aligned(item)
    name = f"{item.name} ({item.unit})" if item.unit else item.name
    relative = signed_percent(item.relative_told, 2)
    return name, measured, true, error, relative, _MARKS[item.verdict]


def _page_of(report: Report) -> str:
    """Where the run's report.html lies, if that is known."""
    for link in report.links:
        page_file = link.path.with_name("report.html")
        if link.path.name == "report.json" and page_file.is_file():
            return str(page_file)
    return ""


def _photo(pair: FramePair) -> Picture:
    image = read_image(pair.deformed)
    size = fitting(image.shape, _WIDTH, _HEIGHT)
    caption = f"Camera {pair.camera}, loaded."
    return Picture(f"camera {pair.camera}", reduced(image, size, pair.bits), caption)


def _line(series: Series) -> Picture:
    def draw(canvas: Any) -> None:
        plot_series(series, canvas.subplots())

    pixels = drawn((5.6, 3.4), draw, dpi=100)
    return Picture(series.name, pixels, shown_width=_WIDTH)
