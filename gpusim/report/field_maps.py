"""Measured fields beside true ones: maps over the reference picture, and their differences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.export.field_catalogue import FieldMap
from gpusim.export.images import read_image
from gpusim.files.atomic_files import PathLike
from gpusim.report.model import Figure
from gpusim.report.style import MEASURED, TRUTH, axis_title, draw_png

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

_PANEL = 2.3  # inches
_SHOWN = 0.01  # share of the values beyond either end of a colour bar
_BINS = 81


@dataclass(frozen=True)
class ComparedField:
    """A field at M points, with its unit in its ``title``: as it was ``measured``, as it is, and as
    subsets and windows see it."""

    title: str
    measured: Float
    true: Float
    levelled: Float


def draw_compared_fields(
    picture: PathLike, points: Float, fields: Sequence[ComparedField], title: str, path: PathLike
) -> Figure:
    """Each field measured, true, their difference, and how much of it the settings' smoothing is;
    at ``points`` (M, 2) px over a ``picture``, of which the part around them is shown.

    The first two share a scale, the last two another one with zero in its middle.
    """
    rows = []
    for one in fields:
        known = np.isfinite(one.measured)
        maps = {
            f"{one.title}: measured": one.measured,
            "true": one.true,
            "measured less true": one.measured - one.true,
            "smoothing": one.levelled - one.true,
        }
        own = _range(np.concatenate([one.measured[known], one.true[known]]))
        most = max(np.abs(_range(maps["measured less true"])))
        scales = [own, own, (-most, most), (-most, most)]
        rows.append([
            (FieldMap(np.where(known, values, np.nan), name), scale)
            for (name, values), scale in zip(maps.items(), scales, strict=True)
        ])  # fmt: skip
    _draw_panels(picture, points, rows, path)
    caption = (
        "Measured and true at the same material points, in one scale; their difference, and beside "
        "it, in the same scale, how far subsets and strain windows smooth the truth."
    )
    return Figure(Path(path), title, caption, photo=True)


def draw_error_parts(
    picture: PathLike,
    points: Float,
    parts: Mapping[str, Float],
    quantities: Sequence[str],
    title: str,
    path: PathLike,
) -> Figure:
    """A row of maps for each part (M, Q) of an error, a column for each of the ``quantities``."""
    rows = []
    for name, values in parts.items():
        scales = [_range(column) for column in values.T]
        rows.append([
            (FieldMap(column, f"{name}: {quantity}"),
             (-max(-low, high), max(-low, high)) if low < 0.0 < high else (low, high))
            for column, quantity, (low, high) in zip(values.T, quantities, scales, strict=True)
        ])  # fmt: skip
    _draw_panels(picture, points, rows, path)
    caption = (
        "Every map has a scale of its own, red and blue about zero where it has both signs; parts "
        "add up to the whole."
    )
    return Figure(Path(path), title, caption, photo=True)


def _draw_panels(
    picture: PathLike,
    points: Float,
    rows: Sequence[Sequence[tuple[FieldMap, tuple[float, float]]]],
    path: PathLike,
) -> None:
    """Maps with the ends of their scales, in rows, over the part of a picture around them."""
    from gpusim.report.correlation import draw_map, grey_picture

    backdrop = grey_picture(read_image(picture))
    low, high = points.min(axis=0), points.max(axis=0)
    margin = 0.05 * float((high - low).max()) + 1.0
    wide, tall = high - low + 2.0 * margin
    inches = float(np.clip(_PANEL * tall / wide, 0.9, 4.5))

    def draw(canvas: Canvas) -> None:
        panels = canvas.subplots(len(rows), len(rows[0]), squeeze=False)
        for axes, (one, (start, stop)) in zip(panels.ravel(), chain(*rows), strict=True):
            colours = "viridis" if start != -stop else "RdBu_r"
            draw_map(axes, backdrop, points, one, vmin=start, vmax=stop, cmap=colours, alpha=1.0)
            axes.set_axis_off()
            axes.axis((low[0] - margin, high[0] + margin, high[1] + margin, low[1] - margin))

    draw_png(path, (len(rows[0]) * (_PANEL + 0.8), len(rows) * (inches + 0.5)), draw)


def _range(values: Float) -> tuple[float, float]:
    """Quantiles that colours span; wider than nothing."""
    known = values[np.isfinite(values)]
    if not known.size:
        return -1.0, 1.0
    low, high = (float(one) for one in np.quantile(known, [_SHOWN, 1.0 - _SHOWN]))
    least = 1e-9 * max(abs(low), abs(high), 1e-9)
    return (low, high) if high - low > least else (low - least, high + least)


def draw_differences(raw: Float, rest: Float, title: str, path: PathLike) -> Figure:
    """Histograms of errors (N,) px, and of what the settings' smoothing doesn't explain of them."""
    raw, rest = raw[np.isfinite(raw)], rest[np.isfinite(rest)]
    low, high = _range(np.concatenate([raw, rest]))
    edges = np.linspace(low, high, _BINS).tolist()

    def draw(canvas: Canvas) -> None:
        plot = canvas.subplots()
        plot.hist(raw, edges, histtype="stepfilled", alpha=0.35, color=MEASURED,
                  label="measured less true")  # fmt: skip
        plot.hist(rest, edges, histtype="step", linewidth=1.5, color=TRUTH,
                  label="beyond the settings' smoothing")  # fmt: skip
        plot.set(xlabel="Difference (px)", ylabel="Values")
        plot.legend(loc="best")
        axis_title(plot, "Differences of displacements in the pictures")

    draw_png(path, (7.2, 3.6), draw)
    spread = [float(np.sqrt(np.mean(one**2))) if one.size else float("nan") for one in (raw, rest)]
    caption = f"RMS {spread[0]:.2g} px, of which {spread[1]:.2g} px aren't the settings' smoothing."
    return Figure(Path(path), title, caption)
