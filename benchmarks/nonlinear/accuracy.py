"""Cases with a reference, on meshes that reach it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from gpusim.errors import NotConverged
from gpusim.fem import Solution
from tests.support.nonlinear_cases import (
    NonlinearCase,
    bimetal_strip,
    curved_cantilever,
    end_load,
    following_pressure,
    own_weight,
    pressed_column,
    published_cantilever,
    ring,
    roll_up,
    rolled_by_pressures,
    shallow_arch,
)
from tests.support.nonlinear_shells import holed_hemisphere, pulled_cylinder, slit_annulus


@dataclass(frozen=True)
class Row:
    """A case on one mesh; ``wanted``: the error that it is to stay below."""

    mesh: str
    build: Callable[[], NonlinearCase]
    wanted: float


ROWS = (
    Row("hex8 100x1x1", lambda: end_load("hex8", (100, 1, 1)), 1e-3),
    Row("hex20 80x1x1", lambda: end_load("hex20", (80, 1, 1)), 1e-3),
    Row("tet10 100x1x1", lambda: end_load("tet10", (100, 1, 1)), 1e-3),
    Row("wedge15 80x1x1", lambda: end_load("wedge15", (80, 1, 1)), 1e-3),
    Row("hex8 60x1x1", lambda: published_cantilever("hex8", (60, 1, 1)), 1e-3),
    Row("hex20 40x1x1", lambda: published_cantilever("hex20", (40, 1, 1)), 1e-3),
    Row("tet10 60x1x1", lambda: published_cantilever("tet10", (60, 1, 1)), 1e-3),
    Row("hex8 100x1x1", lambda: own_weight("hex8", (100, 1, 1)), 2e-3),
    Row("hex8 100x1x1", lambda: following_pressure("hex8", (100, 1, 1)), 2e-3),
    Row("hex8 100x1x1", lambda: ring("hex8", (100, 1, 1)), 2e-3),
    Row("tet10 60x1x1", lambda: ring("tet10", (60, 1, 1)), 2e-3),
    Row("hex8 100x1x1", lambda: roll_up("hex8", (100, 1, 1), 1.0, 10), 5e-3),
    Row("hex8 100x1x1", lambda: roll_up("hex8", (100, 1, 1), 3.0, 30), 5e-3),
    Row("hex8 100x1x2", lambda: rolled_by_pressures("hex8", (100, 1, 2), 1.0, 10), 5e-3),
    Row("hex8 300x1x2", lambda: rolled_by_pressures("hex8", (300, 1, 2), 3.0, 30), 5e-3),
    Row("hex8 100x1x2", lambda: bimetal_strip((100, 1, 2), (52, 137)), 5e-3),
    Row("hex8 60x1x1", lambda: shallow_arch("hex8", (60, 1, 1), 12.0), 1e-2),
    Row("hex8 60x1x1", lambda: pressed_column((60, 1, 1), 3.0, 1e-2), 1e-2),
    Row("hex8 60x1x1", lambda: pressed_column((60, 1, 1), 10.0, 1e-2), 1e-2),
    Row("hex20 40x2x2", lambda: curved_cantilever("hex20", (40, 2, 2)), 1e-2),
    Row("hex8 64x64x1", lambda: holed_hemisphere("hex8", (64, 64, 1)), 1e-2),
    Row("hex8 180x16x1", lambda: slit_annulus("hex8", (180, 16, 1)), 1e-2),
    Row("hex8 48x36x1", lambda: pulled_cylinder("hex8", (48, 36, 1)), 1e-2),
)

HEADINGS = (
    "case", "mesh", "unknowns", "Newton", "linear", "processor s", "wall s",
    "value", "reference", "error", "wanted", "source",
)  # fmt: skip


def measured(row: Row) -> list[str]:
    """What is said of a case, in the order of `HEADINGS`."""
    case = row.build()
    wall, processor = time.perf_counter(), time.process_time()
    try:
        solution = case.solve()
    except NotConverged as error:
        blank = [""] * 5
        return [case.name, row.mesh, *blank, "none", "", str(error), "", case.source]
    wall, processor = time.perf_counter() - wall, time.process_time() - processor
    every = [one for step in solution.steps for one in step.iterations]
    values, expected, error = _worst(case, solution)
    return [
        case.name, row.mesh, f"{solution.unknowns:,}", str(len(every)), str(solution.iterations),
        f"{processor:.2f}", f"{wall:.2f}", values, expected, error, f"{row.wanted:.1%}",
        case.source,
    ]  # fmt: skip


def _worst(case: NonlinearCase, solution: Solution) -> tuple[str, str, str]:
    """Values of the step that is most in error, what they should be, and by how much they aren't;
    the message of a solution that isn't whole."""
    if not solution.converged:
        return "none", "", solution.message
    errors = case.errors(solution)
    step = int(np.abs(errors).max(axis=1).argmax())
    wanted = [one for one in solution.steps if one.wanted]
    texts = [
        " ".join(f"{value:.5g}" for value in values)
        for values in (case.values(wanted[step].u), case.expected[step])
    ]
    size = "" if case.size is None else f" of {case.size:g}"
    return texts[0], texts[1], f"{np.abs(errors).max():.3%}{size}"


def accuracy(name: str) -> Iterator[list[str]]:
    """One row of text after the other, of cases whose name holds ``name``."""
    for row in ROWS:
        if name in row.build().name:
            yield measured(row)
