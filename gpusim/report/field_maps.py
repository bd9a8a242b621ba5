"""Measured fields beside true ones: maps over the reference picture, and their differences."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
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
    from gpusim.report.correlation import draw_map, grey_picture

    backdrop = grey_picture(read_image(picture))
    low, high = points.min(axis=0), points.max(axis=0)
    margin = 0.05 * float((high - low).max()) + 1.0
    wide, tall = high - low + 2.0 * margin
    inches = float(np.clip(_PANEL * tall / wide, 0.9, 4.5))

    def draw(canvas: Canvas) -> None:
        panels = canvas.subplots(len(fields), 4, squeeze=False)
        for row, one in zip(panels, fields, strict=True):
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
            for axes, (name, values), (start, stop) in zip(row, maps.items(), scales, strict=True):
                colours = "viridis" if start != -stop else "RdBu_r"
                shown = np.where(known, values, np.nan)
                draw_map(axes, backdrop, points, FieldMap(shown, name), vmin=start, vmax=stop,
                         cmap=colours, alpha=1.0)  # fmt: skip
                axes.set_axis_off()
                axes.axis((low[0] - margin, high[0] + margin, high[1] + margin, low[1] - margin))

    draw_png(path, (4 * (_PANEL + 0.8), len(fields) * (inches + 0.5)), draw)
    caption = (
        "Measured and true at the same material points, in one scale; their difference, and beside "
        "it, in the same scale, how far subsets and strain windows smooth the truth."
    )
    return Figure(Path(path), title, caption, photo=True)


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
