"""Records: values over time, linear in between, as loads and grounds follow them."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float
from gpusim.field_summary import field_summary
from gpusim.files.input_file import read_input
from gpusim.validation import as_float64, finite_numbers, require, unmasked


@unmasked()
@dataclass(frozen=True, eq=False)
class Record:
    """``values`` (R,) or (R,k) at increasing ``times`` (R,), linear in between.

    Raises InputError for anything else, and for numbers that aren't finite.

    Examples
    --------
    >>> pulse = gs.Record(times=[0.0, 0.01, 0.02, 1.0], values=[0.0, 500.0, 0.0, 0.0])
    >>> pulse.at(np.array([0.005, 0.5]))[:, 0].tolist()
    [250.0, 0.0]
    """

    times: Float
    values: Float
    __repr__ = field_summary

    def __post_init__(self) -> None:
        times = increasing(self.times, "Record.times")
        count = len(times)
        given = np.asarray(self.values)
        shapes = ((count,), (count, given.shape[-1] if given.ndim == 2 else 1))
        expected = f"({count},) or ({count}, k) finite numbers"
        values = finite_numbers(self.values, "Record.values", shapes, expected)
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "values", values.reshape(count, -1))

    def at(self, times: Float) -> Float:
        """(m,k) at ``times`` (m,); beyond its ends it stays as it is there."""
        found = [np.interp(times, self.times, one) for one in self.values.T]
        return np.reshape(found, (-1, len(times))).T

    def slope(self, times: Float) -> Float:
        """(m,k) at ``times`` (m,) within its ends; after a bend where it bends."""
        number = np.searchsorted(self.times, times, side="right") - 1
        steps = np.diff(self.values, axis=0) / np.diff(self.times)[:, None]
        return np.asarray(steps[np.clip(number, 0, len(steps) - 1)])

    def within(self, first: float, last: float, what: str) -> Record:
        """From the ``first`` to the ``last`` of some instants. Raises InputError, naming ``what``,
        unless it reaches from one to the other."""
        got = f"{self.times[0]:.6g} to {self.times[-1]:.6g}"
        covers = self.times[0] <= first and last <= self.times[-1]
        require(covers, f"{what}: times", got, f"{first:.6g} to {last:.6g}, or beyond")
        inside = (self.times > first) & (self.times < last)
        times = np.concatenate([[first], self.times[inside], [last]])
        return Record(times, self.at(times))


def increasing(times: npt.ArrayLike, what: str) -> Float:
    """At least two instants, one after the other. Raises InputError naming ``what``."""
    expected = "(R,) finite numbers"
    shape = (as_float64(times, what, expected).size,)
    given = finite_numbers(times, what, [shape], expected)
    require(len(given) > 1, what, f"{len(given)} instants", "at least 2")
    step = np.diff(given)
    late = int(np.argmin(step))
    got = f"{given[late + 1]:.6g} after {given[late]:.6g}, number {late + 1}"
    require(bool((step > 0.0).all()), what, got, "times that increase")
    return given


def _begins_as_number(cell: str) -> bool:
    return bool(re.match(r"\s*[-+]?\.?\d", cell))


def read_record(path: str | os.PathLike[str]) -> Record:
    """A CSV file: time in the first column, values in the others; one line of names at most.

    Raises InputError for lines that aren't numbers (NaN is none), and times that don't increase.

    Examples
    --------
    >>> with open("quake.csv", "w") as file:
    ...     _ = file.write("t,ax\\n0.0,0.0\\n0.1,9.81\\n")
    >>> gs.read_record("quake.csv").values.ravel().tolist()
    [0.0, 9.81]
    """
    rows: list[list[float]] = []
    for number, line in enumerate(read_input(path, "a CSV file").text().splitlines(), 1):
        cells = line.replace(";", ",").split(",")
        try:
            row = [float(cell) for cell in cells]
        except ValueError:
            named = number == 1 and not any(map(_begins_as_number, cells))
            if named or not line.strip():
                continue
            row = []
        width = len(rows[0]) if rows else max(len(row), 2)
        fits = len(row) == width and bool(np.isfinite(row).all())
        require(fits, f"{path}: line {number}", repr(line), f"{width} finite numbers")
        later = not rows or row[0] > rows[-1][0]
        require(later, f"{path}: line {number}", repr(line), "times that increase")
        rows.append(row)
    require(len(rows) > 1, f"{path}", f"{len(rows)} lines of numbers", "at least 2")
    table = np.array(rows)
    return Record(table[:, 0], table[:, 1:])
