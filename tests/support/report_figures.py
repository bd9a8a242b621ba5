"""Figures of reports take a third of the time of a small run: they are drawn where a test looks at
them, which is marked ``drawn``, or where its fixture asks for them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from gpusim.report import write
from gpusim.report.html import SECTIONS
from gpusim.report.model import Figure

_DRAW = write._draw


def _no_figures(*_: object) -> dict[str, list[Figure]]:
    return {name: [] for name in SECTIONS}


def draw_figures(wanted: bool) -> None:
    """From now on, by whatever runs scenes in this process."""
    write._draw = _DRAW if wanted else _no_figures  # type: ignore[assignment]


@contextmanager
def figures_drawn() -> Iterator[None]:
    """For a run of a fixture, which several tests share."""
    before = write._draw
    draw_figures(True)
    try:
        yield
    finally:
        write._draw = before
