"""One look for all figures; series colours that colour-blind readers can tell apart.

The series colours are those of Okabe & Ito (2008), in the variant that keeps a contrast of 3 : 1 on
white. On a dark page the report's style sheet inverts the lightness of plots and keeps their hues,
so that one file serves both.

Nothing imports matplotlib, half a second's work, but what draws with it: that is mostly a process
of its own (`gpusim.parallel.processes`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
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


@dataclass(frozen=True)
class Margins:
    """Inches around the plots of a page, which hold their labels; ``beside`` and ``between`` them.

    matplotlib's layouts look at every label of a figure before it draws them: that takes as long as
    drawing.
    """

    left: float = 1.05
    right: float = 0.15
    top: float = 0.36
    bottom: float = 0.58
    beside: float = 0.95
    between: float = 0.62

    def fit(self, canvas: Canvas) -> None:
        """Move the plots of ``canvas``, which are those of one grid."""
        grid: Any = canvas.axes[0].get_subplotspec()
        rows, columns = grid.get_gridspec().get_geometry()
        width, height = canvas.get_size_inches()
        tall = (height - self.top - self.bottom - (rows - 1) * self.between) / rows
        wide = (width - self.left - self.right - (columns - 1) * self.beside) / columns
        canvas.subplots_adjust(
            self.left / width, self.bottom / height, 1.0 - self.right / width,
            1.0 - self.top / height, self.beside / wide, self.between / tall,
        )  # fmt: skip


Layout = Margins | Literal["constrained", "none"] | None


def draw_png(
    path: PathLike,
    size: tuple[float, float],
    draw: Callable[[Canvas], None],
    layout: Layout = None,
) -> None:
    """Let ``draw`` fill a canvas of ``size`` inches and write it to ``path`` (PNG, 200 dpi)."""
    write_image(path, drawn(size, draw, layout), pixels_per_metre=_DPI / 0.0254)


def drawn(
    size: tuple[float, float],
    draw: Callable[[Canvas], None],
    layout: Layout = None,
    dpi: int = _DPI,
) -> npt.NDArray[np.uint8]:
    """(H, W, 3) of a canvas of ``size`` inches that ``draw`` fills.

    ``layout``: margins around the plots, usual ones unless given; "constrained" for plots that
    share a page with colour bars, "none" for those that are in place.
    """
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure as Canvas

    with _drawing, matplotlib.rc_context(_SETTINGS):
        own: Any = "constrained" if layout == "constrained" else "none"
        canvas = Canvas(figsize=size, dpi=dpi, layout=own)
        page: Any = FigureCanvasAgg(canvas)
        draw(canvas)
        if not isinstance(layout, str):
            (layout or Margins()).fit(canvas)
        # savefig would draw twice, the first time for a layout that drawing makes anyway
        page.draw()
        return np.array(page.buffer_rgba(), np.uint8)[..., :3]


def page_pixels(size: tuple[float, float]) -> tuple[int, int]:
    """Width and height (px) of a page of ``size`` inches."""
    return int(size[0] * _DPI), int(size[1] * _DPI)


def text_inches(text: str) -> float:
    """How wide a line is in the usual size of letters."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import TextToPath

    found = FontProperties(family=_SETTINGS["font.family"], size=_SETTINGS["font.size"])
    width, _, _ = TextToPath().get_text_width_height_descent(text, found, ismath=False)
    return float(width) / 72.0


def named(name: str) -> str:
    """A name of somebody else's as a text of a figure, where dollars would begin a formula."""
    return printable(name).replace("$", r"\$")


def axis_title(axes: Axes, text: str) -> None:
    """Put a small bold heading above the left end of an axes."""
    from matplotlib import rcParams

    colour = rcParams["axes.labelcolor"]  # of a figure of somebody else's, too
    axes.set_title(text, loc="left", fontsize=10.5, fontweight="bold", color=colour, pad=8)
