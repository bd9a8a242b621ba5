"""The error budget on the terminal."""

from __future__ import annotations

from pathlib import Path

from gpusim.cli.console import out
from gpusim.report import Budget

__all__ = ["print_budget"]


def print_budget(budget: Budget, folder: Path) -> None:
    """One column for each error, one line for each state of the images."""
    names = [f"{name} / {unit}" if unit else name for name, unit in budget.quantities]
    for number, name in enumerate(names, start=1):
        out(f"({number}) {name}")
    columns = range(1, len(names) + 1)
    out(f"{'images with':<28}" + "".join(f"{f'({number})':>12}" for number in columns))
    words = {"all": "everything", "none": "none of the effects"}
    for row in budget.rows:
        label = words.get(row.state) or f"{row.state} {row.source}"
        out(f"{label:<28}" + "".join(f"{value:12.3g}" for value in row.errors))
    out()
    out(f"Report: {folder / 'report.html'}")
