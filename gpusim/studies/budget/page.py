"""report.html and report.json of an uncertainty budget."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

from gpusim._version import __version__
from gpusim.files.atomic_files import PathLike, write_text
from gpusim.files.output_folder import inside
from gpusim.report.html import page_template
from gpusim.report.model import Figure
from gpusim.report.style import draw_png, named
from gpusim.report.text import plain_data
from gpusim.studies.budget.uncertainty import UncertaintyBudget, rounded

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

_COLOURS = ("#0072b2", "#d55e00", "#0b8f6a", "#cc79a7", "#e69f00", "#56b4e9", "#5b6876", "#000000")
_CAPTION = (
    "Shares of the variance; a source's standard uncertainty goes with the root of its share."
)


def write_budget(name: str, budget: UncertaintyBudget, out: PathLike) -> Path:
    """Write report.json, report.html and the chart of shares into the folder ``out``; returns the
    page.

    Examples
    --------
    >>> import numpy as np
    >>> from gpusim.studies.budget import SourceDraws, UncertaintyBudget, write_budget
    >>> noise = np.array([[-1.0], [1.0], [0.0]])
    >>> source = SourceDraws("noise", ("seed",), np.nan * noise, noise)
    >>> budget = UncertaintyBudget((("length", "mm"),), np.zeros(1), (source,), noise)
    >>> write_budget("gauge", budget, "budget").name
    'report.html'
    """
    told = {"schema": 1, "version": __version__, "budget": name, **budget.content()}
    write_text(inside(Path(out), "report.json"), json.dumps(plain_data(told), indent=2) + "\n")
    figure = draw_shares(budget, inside(Path(out), "figures", "shares.png"))
    page = page_template("budget.html.j2").render(told, figure=figure, rounded=rounded)
    return write_text(inside(Path(out), "report.html"), page)


def draw_shares(budget: UncertaintyBudget, path: PathLike) -> Figure:
    """Draw the share of each source in the variance of each quantity, as a bar of pieces."""
    names = [name for name, _ in budget.quantities]

    def draw(canvas: Canvas) -> None:
        axes = canvas.subplots()
        end = 0.0 * budget.combined
        for k, (source, own) in enumerate(zip(budget.sources, 100.0 * budget.shares, strict=True)):
            axes.barh(names, own, left=end, color=_COLOURS[k % len(_COLOURS)],
                      label=named(source.name), height=0.6, hatch="//" * (k // len(_COLOURS)),
                      edgecolor="white")  # fmt: skip
            end = end + own
        axes.invert_yaxis()
        axes.grid(axis="y", visible=False)
        axes.set(xlabel="Share of the variance (%)", xlim=(0.0, 100.0))
        canvas.legend(loc="outside lower center", ncols=4)

    rows = len(budget.sources) // 4 + 1
    draw_png(path, (9.0, 1.0 + 0.45 * len(names) + 0.3 * rows), draw)
    return Figure(Path(path), "Which source makes how much", _CAPTION)
