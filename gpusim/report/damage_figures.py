"""Figures of a comparison of states: deflection lines, differences, and where a slope changes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from gpusim.files.atomic_files import PathLike
from gpusim.report.model import Figure
from gpusim.report.style import MUTED, PAGE, axis_title, draw_png

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas

__all__ = ["StateCurve", "draw_deflections", "draw_differences"]

Floats = npt.NDArray[np.float64]
_SIZE = (7.2, 4.2)  # inches
_COLOURS = ("#0072b2", "#d55e00", "#0b8f6a", "#b0569a", "#8a6d00", "#56707f")
_MARKS = ("o", "s", "^", "D", "v", "P")


@dataclass(frozen=True)
class StateCurve:
    """One state: positions x (M,), values measured and true (M,), and what was found in them.

    ``breaks`` and ``sigma`` (K,) are positions of slope changes, ``damage`` (D,) the true ones;
    ``fitted_x``, ``fitted_y`` a curve through the measured values, or empty.
    """

    name: str
    x: Floats
    measured: Floats
    true: Floats
    breaks: Floats
    sigma: Floats
    damage: Floats
    fitted_x: Floats
    fitted_y: Floats


def draw_deflections(curves: Sequence[StateCurve], axes: tuple[str, str], path: PathLike) -> Figure:
    """All states' deflection lines; ``axes`` are the labels of both axes."""

    def draw(canvas: Canvas) -> None:
        plot = canvas.subplots()
        for k, curve in enumerate(curves):
            _points(plot, k, curve)
        plot.set_xlabel(axes[0])
        plot.set_ylabel(axes[1])
        plot.legend(loc="best")
        axis_title(plot, "Deflection lines (lines: finite elements)")

    draw_png(path, _SIZE, draw)
    return Figure(
        Path(path), "Deflection lines", "Measured points on the true line, for every state."
    )


def draw_differences(
    curves: Sequence[StateCurve], axes: tuple[str, str], mm_per_px: float, path: PathLike
) -> Figure:
    """Differences to the reference, their fits and breaks, and measured minus true in px."""

    def draw(canvas: Canvas) -> None:
        upper, lower = canvas.subplots(2, 1, sharex=True, height_ratios=[2.6, 1.0])
        for k, curve in enumerate(curves):
            _points(upper, k, curve, line=False)
            upper.plot(curve.fitted_x, curve.fitted_y, color=_COLOURS[k % 6], linewidth=1.6)
            at: Floats = curve.breaks
            if len(at):
                at = np.interp(at, curve.fitted_x, curve.fitted_y)
            upper.plot(curve.breaks, at, "|", color=_COLOURS[k % 6], markersize=22, mew=1.6)
            error = (curve.measured - curve.true) / mm_per_px
            lower.plot(curve.x, error, _MARKS[k % 6] + "-", color=_COLOURS[k % 6], markersize=3,
                       linewidth=0.8)  # fmt: skip
        for place in sorted({float(p) for curve in curves for p in curve.damage}):
            for plot in (upper, lower):
                plot.axvline(place, color=MUTED, linestyle=":", linewidth=1.1)
        lower.axhline(0.0, color=MUTED, linewidth=0.8)
        upper.set_ylabel(axes[1])
        upper.legend(loc="best")
        lower.set_xlabel(axes[0])
        lower.set_ylabel("Error (px)")
        axis_title(upper, "Difference to the reference (dotted: where the damage is)")
        axis_title(lower, "Measured minus true difference")

    draw_png(path, (_SIZE[0], 5.6), draw)
    places = [
        f"{curve.name} at "
        + ", ".join(f"{p:.1f} ± {s:.1f}" for p, s in zip(curve.breaks, curve.sigma, strict=True))
        for curve in curves
        if len(curve.breaks)
    ]
    found = "; ".join(places) if places else "none"
    caption = f"Broken lines fitted to the measured differences; slope changes (mm): {found}."
    return Figure(Path(path), "Differences of the deflection lines", caption)


def _points(plot: Axes, k: int, curve: StateCurve, line: bool = True) -> None:
    colour = _COLOURS[k % 6]
    if line:
        plot.plot(curve.x, curve.true, color=colour, linewidth=1.4)
    plot.plot(
        curve.x, curve.measured, _MARKS[k % 6], markersize=4.2, markerfacecolor=PAGE,
        markeredgecolor=colour, markeredgewidth=1.2, label=curve.name,
    )  # fmt: skip
