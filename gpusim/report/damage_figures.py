"""Figures of a comparison of states: deflection lines, differences, and where a slope changes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from gpusim.export.files import PathLike
from gpusim.report.chart import draw_chart
from gpusim.report.model import Figure
from gpusim.report.panel import Panel
from gpusim.report.style import MUTED

__all__ = ["StateCurve", "draw_deflections", "draw_differences"]

Floats = npt.NDArray[np.float64]
_SIZE = (7.2, 4.2)  # inches
_COLOURS = ("#0072b2", "#d55e00", "#0b8f6a", "#b0569a", "#8a6d00", "#56707f")
_MARKS = ("o", "s", "^", "D", "v", "x")


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
    panel = Panel("Deflection lines (lines: finite elements)", *axes)
    for k, curve in enumerate(curves):
        panel.line(curve.x, curve.true, _COLOURS[k % 6])
    for k, curve in enumerate(curves):
        _points(panel, k, curve)
    draw_chart(path, _SIZE, [[panel]])
    return Figure(
        Path(path), "Deflection lines", "Measured points on the true line, for every state."
    )


def draw_differences(
    curves: Sequence[StateCurve], axes: tuple[str, str], mm_per_px: float, path: PathLike
) -> Figure:
    """Differences to the reference, their fits and breaks, and measured minus true in px."""
    upper = Panel("Difference to the reference (dotted: where the damage is)", y_label=axes[1])
    lower = Panel("Measured minus true difference", axes[0], "Error (px)", rows=5)
    for place in sorted({float(p) for curve in curves for p in curve.damage}):
        for plot in (upper, lower):
            plot.rule(place, MUTED, upright=True, dotted=True, width=1.1)
    lower.rule(0.0, MUTED, width=0.8)
    for k, curve in enumerate(curves):
        _points(upper, k, curve)
        upper.line(curve.fitted_x, curve.fitted_y, _COLOURS[k % 6], 1.6)
        if len(curve.breaks):
            at = np.interp(curve.breaks, curve.fitted_x, curve.fitted_y)
            upper.marks(curve.breaks, at, _COLOURS[k % 6], "|", 22.0, edge=1.6)
        error = (curve.measured - curve.true) / mm_per_px
        lower.line(curve.x, error, _COLOURS[k % 6], 0.8)
        lower.marks(curve.x, error, _COLOURS[k % 6], _MARKS[k % 6], 3.0, inside=_COLOURS[k % 6])
    upper.x_range = lower.x_range = upper.ranges()[0]
    draw_chart(path, (_SIZE[0], 5.6), [[upper], [lower]], [2.6, 1.0])
    places = [
        f"{curve.name} at "
        + ", ".join(f"{p:.1f} ± {s:.1f}" for p, s in zip(curve.breaks, curve.sigma, strict=True))
        for curve in curves
        if len(curve.breaks)
    ]
    found = "; ".join(places) if places else "none"
    caption = f"Broken lines fitted to the measured differences; slope changes (mm): {found}."
    return Figure(Path(path), "Differences of the deflection lines", caption)


def _points(panel: Panel, k: int, curve: StateCurve) -> None:
    panel.marks(curve.x, curve.measured, _COLOURS[k % 6], _MARKS[k % 6], 4.2, label=curve.name)
