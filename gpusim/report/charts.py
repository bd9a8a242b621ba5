"""Charts of what was computed: curves over one quantity."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gpusim.files.atomic_files import PathLike
from gpusim.report.model import Figure
from gpusim.report.style import GOOD, MEASURED, MUTED, TRUTH, draw_png

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

_SIZE = 7.2, 3.2  # inches
_COLORS = (TRUTH, MEASURED, GOOD, MUTED)
_MOST_NAMED = 12  # curves
_NOTHING = 1e-9
"""Of the greatest value: a curve below it isn't drawn."""


@dataclass(frozen=True)
class Chart:
    """``curves`` by name, each as long as ``x``; ``log``: y is logarithmic."""

    title: str
    caption: str
    x_label: str
    y_label: str
    x: Sequence[float]
    curves: Mapping[str, Sequence[float]]
    log: bool = False


def draw_chart(chart: Chart, path: PathLike) -> Figure:
    """Draw the curves that aren't zero throughout."""
    curves = chart.curves.items()
    size = {name: float(np.nanmax(np.abs(curve), initial=0.0)) for name, curve in curves}
    most = max(size.values(), default=0.0)
    shown = [name for name in chart.curves if size[name] > _NOTHING * most]

    def draw(canvas: Canvas) -> None:
        axes = canvas.subplots()
        for name, color in zip(shown, cycle(_COLORS), strict=False):
            axes.plot(chart.x, chart.curves[name], color=color, linewidth=1.2, label=name)
        if chart.log:
            axes.set_yscale("log")
        axes.set(xlabel=chart.x_label, ylabel=chart.y_label)
        if 1 < len(shown) <= _MOST_NAMED:
            canvas.legend(loc="outside right upper")

    draw_png(path, _SIZE, draw)
    return Figure(Path(path), chart.title, chart.caption)
