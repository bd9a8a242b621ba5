"""report.html: one self-contained page, readable without network, server or script."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from gpusim.report.model import Figure, Report, Stage
from gpusim.report.pages import page_template
from gpusim.report.pictures import page_pair

__all__ = ["FigureSet", "render_html"]


@dataclass(frozen=True)
class FigureSet:
    """The figures by the section of the page they stand in."""

    series: tuple[Figure, ...] = ()
    errors: Figure | None = None
    overlays: tuple[Figure, ...] = ()
    convergence: Figure | None = None
    other: tuple[Figure, ...] = ()

    def all(self) -> tuple[Figure, ...]:
        """Return every figure in page order."""
        single = [figure for figure in (self.errors, self.convergence) if figure is not None]
        return (*self.series, *self.overlays, *single, *self.other)


def render_html(report: Report, figures: FigureSet, folder: Path) -> str:
    """Return the page as text.

    Pictures are embedded; links to full-size files are relative to ``folder``, where the page will
    be written. Raises InputError if a picture can't be read.
    """
    return page_template("report.html.j2").render(
        folder=folder,
        report=report,
        figures=figures,
        pairs=[page_pair(pair) for pair in report.frames],
        headline=report.measurements[0] if report.measurements else None,
        total=sum(stage.seconds for stage in report.stages if math.isfinite(stage.seconds)),
        bars=_bars(report.stages),
    )


def _bars(stages: Sequence[Stage]) -> list[tuple[Stage, float]]:
    """Pair each stage with the length of its bar, per cent of the longest stage."""
    longest = max((s.seconds for s in stages if math.isfinite(s.seconds)), default=0.0)
    return [
        (
            stage,
            100.0 * stage.seconds / longest if longest > 0 and math.isfinite(stage.seconds) else 0,
        )
        for stage in stages
    ]
