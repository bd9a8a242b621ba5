"""One look for all figures; series colours that colour-blind readers can tell apart.

The series colours are those of Okabe & Ito (2008), in the variant that keeps a contrast of 3 : 1 on
white. On a dark page the report's style sheet inverts the lightness of plots and keeps their hues,
so that one file serves both.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure as Canvas

from gpusim.export.files import PathLike, atomic_path

__all__ = ["BAD", "GOOD", "MEASURED", "MUTED", "PAGE", "TEXT", "TRUTH", "axis_title", "draw_png"]

PAGE = "#ffffff"
TEXT = "#16202b"
MUTED = "#5b6876"
TRUTH = "#0072b2"
MEASURED = "#d55e00"
GOOD = "#0b8f6a"
BAD = "#c2321b"

_DPI = 200
# of zlib: half the time of its default for files a fifth larger
_COMPRESSION = 3
_SETTINGS: dict[Any, Any] = {
    "font.family": ["DejaVu Sans"],  # comes with matplotlib: the same letters everywhere
    "font.size": 10.5,
    "figure.facecolor": PAGE,
    "savefig.facecolor": PAGE,
    "text.color": TEXT,
    "axes.facecolor": PAGE,
    "axes.edgecolor": MUTED,
    "axes.labelcolor": TEXT,
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e3e8ee",
    "grid.linewidth": 0.8,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": TEXT,
    "ytick.labelcolor": TEXT,
    "legend.frameon": False,
    "lines.solid_capstyle": "round",
}


def draw_png(path: PathLike, size: tuple[float, float], draw: Callable[[Canvas], None]) -> None:
    """Let ``draw`` fill a canvas of ``size`` inches and write it to ``path`` (PNG, 200 dpi)."""
    with matplotlib.rc_context(_SETTINGS):
        canvas = Canvas(figsize=size, dpi=_DPI, layout="constrained")
        page: Any = FigureCanvasAgg(canvas)
        draw(canvas)
        with atomic_path(path) as part:
            # savefig would draw twice, the first time for a layout that drawing makes anyway
            page.print_png(part, pil_kwargs={"compress_level": _COMPRESSION})


def axis_title(axes: Axes, text: str) -> None:
    """Put a small bold heading above the left end of an axes."""
    axes.set_title(text, loc="left", fontsize=10.5, fontweight="bold", color=TEXT, pad=8)
