"""One look for all figures; series colours that colour-blind readers can tell apart.

The series colours are those of Okabe & Ito (2008), in the variant that keeps a contrast of 3 : 1 on
white. On a dark page the report's style sheet inverts the lightness of plots and keeps their hues,
so that one file serves both.

Nothing imports matplotlib, half a second's work, but what draws with it.
"""

from __future__ import annotations

from collections.abc import Callable
from threading import Lock
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from gpusim.export.images import write_image
from gpusim.files.atomic_files import PathLike
from gpusim.printable import printable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas

PAGE = "#ffffff"
TEXT = "#16202b"
MUTED = "#5b6876"
TRUTH = "#0072b2"
MEASURED = "#d55e00"
GOOD = "#0b8f6a"
BAD = "#c2321b"

_DPI = 200
# matplotlib's settings are the process's
_drawing = Lock()
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
    # where titles go is said, and not looked for above all that there is
    "axes.titley": 1.0,
    "lines.solid_capstyle": "round",
}


Layout = Literal["constrained"] | None


def draw_png(
    path: PathLike,
    size: tuple[float, float],
    draw: Callable[[Canvas], None],
    layout: Layout = "constrained",
) -> None:
    """Let ``draw`` fill a canvas of ``size`` inches and write it to ``path`` (PNG, 200 dpi)."""
    write_image(path, drawn(size, draw, layout), pixels_per_metre=_DPI / 0.0254)


def drawn(
    size: tuple[float, float],
    draw: Callable[[Canvas], None],
    layout: Layout = "constrained",
    dpi: int = _DPI,
) -> npt.NDArray[np.uint8]:
    """(H, W, 3) of a canvas of ``size`` inches that ``draw`` fills.

    ``layout``: None for plots that are in place; else there is room for their labels.
    """
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure as Canvas

    with _drawing, matplotlib.rc_context(_SETTINGS):
        canvas = Canvas(figsize=size, dpi=dpi, layout=layout)
        page: Any = FigureCanvasAgg(canvas)
        draw(canvas)
        # savefig would draw twice, the first time for a layout that drawing makes anyway
        page.draw()
        return np.array(page.buffer_rgba(), np.uint8)[..., :3]


def page_pixels(size: tuple[float, float]) -> tuple[int, int]:
    """Width and height (px) of a page of ``size`` inches."""
    return int(size[0] * _DPI), int(size[1] * _DPI)


def named(name: str) -> str:
    """A name of somebody else's as a text of a figure, where dollars would begin a formula."""
    return printable(name).replace("$", r"\$")


def axis_title(axes: Axes, text: str) -> None:
    """Put a small bold heading above the left end of an axes."""
    from matplotlib import rcParams

    colour = rcParams["axes.labelcolor"]  # of a figure of somebody else's, too
    axes.set_title(text, loc="left", fontsize=10.5, fontweight="bold", color=colour, pad=8)
