"""A run's errors beside somebody else's, and what each effect in the images adds to them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

from gpusim.report.numbers import json_number

__all__ = ["Budget", "BudgetRow", "Published"]


@dataclass(frozen=True)
class Published:
    """The relative error (1) of ``name`` in this run beside one from ``source``."""

    name: str
    error_relative: float
    published_relative: float
    source: str

    @property
    def better(self) -> bool:
        """Whether this run's error is the smaller one; not if it wasn't measured."""
        return abs(self.error_relative) <= self.published_relative

    def content(self) -> dict[str, Any]:
        """For report.json; a number that isn't finite is null."""
        return {
            "name": self.name,
            "error_relative": json_number(self.error_relative),
            "published_relative": json_number(self.published_relative),
            "source": self.source,
        }


@dataclass(frozen=True)
class BudgetRow:
    """Errors of one state of the images, in the order of the budget's quantities.

    ``state``: "all" effects, "none" of them, "only" the one of the name ``source``, or all but it
    ("no"). NaN where a quantity wasn't measured.
    """

    state: Literal["all", "none", "only", "no"]
    source: str
    errors: tuple[float, ...]


@dataclass(frozen=True)
class Budget:
    """What each effect adds to the measured errors.

    ``quantities``: name and unit of each error. Differences between rows are exact: each state is
    rendered and measured anew, with the same seeds.
    """

    quantities: tuple[tuple[str, str], ...]
    rows: tuple[BudgetRow, ...]

    @property
    def sources(self) -> tuple[str, ...]:
        """The effects, in the order of their rows."""
        return tuple(row.source for row in self.rows if row.state == "only")

    def row(self, state: str, source: str = "") -> BudgetRow:
        """The row of a state. Raises KeyError."""
        for row in self.rows:
            if (row.state, row.source) == (state, source):
                return row
        raise KeyError(f"{state} {source}")

    def added(self, source: str) -> tuple[float, ...]:
        """How much each error grows if this effect alone is added to perfect images."""
        return _differences(self.row("only", source).errors, self.row("none").errors)

    def removed(self, source: str) -> tuple[float, ...]:
        """How much each error falls if this effect alone is taken away."""
        return _differences(self.row("all").errors, self.row("no", source).errors)

    def content(self) -> dict[str, Any]:
        """For report.json; a number that isn't finite is null."""
        return {
            "quantities": [{"name": name, "unit": unit} for name, unit in self.quantities],
            "rows": [
                {
                    "state": row.state,
                    "source": row.source,
                    "errors": [json_number(value) for value in row.errors],
                }
                for row in self.rows
            ],
        }


def _differences(one: Sequence[float], other: Sequence[float]) -> tuple[float, ...]:
    pairs = zip(one, other, strict=True)
    return tuple(a - b if math.isfinite(a) and math.isfinite(b) else math.nan for a, b in pairs)
