"""Tables of a report: what Newton's method took, and the modes that were found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gpusim.report import LoadStepRow, Table
from gpusim.report.text import number

_MOST_ROWS = 40
_UNITS = {"Hz": "Hz", "percent": "%"}


def newton_table(steps: Sequence[LoadStepRow]) -> tuple[Table, ...]:
    """What Newton's method took, of at most so many load steps as can be read."""
    if not steps:
        return ()
    columns = (
        "Body", "Frame", "Load", "Greatest displacement / mm", "By linear theory / mm", "Steps",
        "Iterations", "Iterations of the linear solver", "Estimated error", "Stored / J",
        "Work / J",
    )  # fmt: skip
    shown = np.unique(np.linspace(0, len(steps) - 1, min(len(steps), _MOST_ROWS)).astype(int))
    rows = tuple(
        (one.body, str(one.frame), f"{one.factor:g}", number(one.moved_mm, 5),
         number(one.linear_mm, 5), str(one.substeps), str(one.iterations),
         str(one.solver_iterations), f"{one.error_estimate:.1e}", number(one.stored_J, 4),
         number(one.work_J, 4))
        for one in (steps[k] for k in shown)
    )  # fmt: skip
    return (Table("Newton's method", columns, rows),)


def mode_table(modes: Sequence[Mapping[str, Any]]) -> tuple[Table, ...]:
    """Frequencies and effective masses, or critical load factors, of the first modes."""
    if not modes:
        return ()
    columns = tuple(_heading(key) for key in modes[0])
    rows = tuple(
        tuple(_cell(key, value) for key, value in one.items()) for one in modes[:_MOST_ROWS]
    )
    return (Table("Modes", columns, rows),)


def _heading(key: str) -> str:
    """Of a key that may end in its unit."""
    what, _, unit = key.rpartition("_")
    text = f"{what} / {_UNITS[unit]}" if unit in _UNITS else key
    return f"{text[0].upper()}{text[1:].replace('_', ' ')}"


def _cell(key: str, value: Any) -> str:
    if not isinstance(value, float):
        return str(value)
    return f"{value:.1e}" if key == "error" else f"{value:.6g}"


def lowest_modes(modes: Sequence[Mapping[str, Any]]) -> dict[str, tuple[str, str]]:
    """A card for the lowest mode of each body."""
    firsts = [[*one.items()] for one in modes if one["mode"] == 1]
    return {
        f"Lowest {what.partition('_')[0]}, {body}": (
            f"{number(value, 5)} {what.partition('_')[2]}", "mode 1"
        )
        for (_, body), _, (what, value), *_ in firsts
    }  # fmt: skip
