"""The points of a study: what each parameter is in each of them."""

from __future__ import annotations

import csv
import io
import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import InputError, require
from gpusim.files.input_file import read_input
from gpusim.scene import parse_value
from gpusim.studies.study_tables import ParameterTable, Study, StudyTable

Columns = Mapping[str, Sequence[Any]]
MOST = 1_000_000
"""Points of a study."""
_INSIDE = 1e-12  # of a probability: no value is infinite


def points(study: Study) -> dict[str, list[Any]]:
    """The values of all points, by the label of each parameter; the same for the same study.

    Combinations of lists come one after the other, each with all points of the distributions; with
    ``sensitivity`` these are Saltelli's: A, B, and A with each column of B in turn. Raises
    InputError for a file of rows that isn't one, and lists that don't go together.

    Examples
    --------
    >>> from gpusim.studies import load_study
    >>> from gpusim.studies.design import points
    >>> from pathlib import Path
    >>> _ = Path("study.toml").write_text('''scene = "bar.toml"
    ... [[parameter]]
    ... key = "camera.side.focal_mm"
    ... list = [49.0, 51.0]
    ... ''')
    >>> points(load_study("study.toml"))
    {'camera.side.focal_mm': [49.0, 51.0]}
    """
    tables = study.tables
    axes: list[Columns] = [] if tables.rows is None else [_rows(study)]
    axes += [{one.label: one.list_} for one in tables.parameter if one.list_ is not None]
    others = {name for one in tables.parameter for name in (one.key, one.label)}
    others |= {one.key for one in tables.derived}
    for label in others & {*axes[0]} if tables.rows is not None else ():
        raise InputError(f"{study.source}: {label} stands in rows, too; expected it once")
    if tables.combine == "zip" and axes:
        axes = [{name: values for one in axes for name, values in one.items()}]
    drawn = _drawn(tables)
    if drawn:
        axes.append(drawn)
    sizes = [_length(one, study.source) for one in axes]
    count = int(np.prod(sizes, dtype=float)) if sizes else 1
    what = f"{study.source}: points of the study"
    require(
        count * tables.repeats <= MOST, what, f"{count * tables.repeats:,}", f"at most {MOST:,}"
    )
    found: dict[str, list[Any]] = {}
    for position, axis in enumerate(axes):
        inner = int(np.prod(sizes[position + 1 :], dtype=int))
        which = (np.arange(count) // inner % sizes[position]).tolist()
        found |= {name: [values[k] for k in which] for name, values in axis.items()}
    labels = [one.label for one in tables.parameter]  # as they stand in the file, rows first
    rest = [name for name in found if name not in labels]
    return {name: found[name] for name in [*rest, *labels]}


def _length(axis: Columns, source: str) -> int:
    """The one length of the columns that go together."""
    sizes = {name: len(values) for name, values in axis.items()}
    if len(set(sizes.values())) > 1:
        got = ", ".join(f"{size} of {name}" for name, size in sizes.items())
        raise InputError(f"{source}: lists to be zipped; got {got}; expected equally many of each")
    return next(iter(sizes.values()))


def _drawn(tables: StudyTable) -> dict[str, list[float]]:
    """Points of the parameters that have distributions."""
    if not tables.drawn:
        return {}
    assert tables.samples is not None
    size = len(tables.drawn)
    if not tables.sensitivity:
        shares = _unit_points(tables, size)
    else:
        both = _unit_points(tables, 2 * size)
        a, b = both[:, :size], both[:, size:]
        mixed = [np.where(np.arange(size) == k, b, a) for k in range(size)]
        shares = np.concatenate([a, b, *mixed])
    return {one.label: _quantiles(one, shares[:, k]).tolist() for k, one in enumerate(tables.drawn)}


def _unit_points(tables: StudyTable, size: int) -> Float:
    """Points (samples, size) between 0 and 1."""
    from scipy.stats import qmc

    generator, count = np.random.default_rng(tables.seed), tables.samples or 0
    if tables.design == "random":
        return generator.random((count, size))
    engines = {"latin_hypercube": qmc.LatinHypercube, "sobol": qmc.Sobol, "halton": qmc.Halton}
    with warnings.catch_warnings():  # any number of points is allowed
        warnings.simplefilter("ignore", UserWarning)
        found: Float = engines[tables.design](size, rng=generator).random(count)
    return found


def _quantiles(parameter: ParameterTable, shares: Float) -> Float:
    """The values below which ``shares`` of a distribution lie."""
    from scipy import stats

    first, second = getattr(parameter, parameter.distribution)
    match parameter.distribution:
        case "uniform":
            return np.asarray(first + (second - first) * shares)
        case "log_uniform":
            return np.asarray(np.exp(np.log(first) + np.log(second / first) * shares))
        case "normal":
            law = stats.norm(first, second)
        case _:
            law = stats.lognorm(second, scale=first)
    low = 0.0 if parameter.low is None else law.cdf(parameter.low)
    high = 1.0 if parameter.high is None else law.cdf(parameter.high)
    what, expected = f"parameter {parameter.label}: low and high", "more of the distribution"
    require(high - low > _INSIDE, what, f"{high - low:.1g} of it", expected)
    within = np.clip(low + (high - low) * shares, _INSIDE, 1.0 - _INSIDE)
    return np.asarray(law.ppf(within))


def _rows(study: Study) -> dict[str, list[Any]]:
    """The columns of the file of points."""
    path = study.folder / str(study.tables.rows)
    lines = list(csv.reader(io.StringIO(read_input(path, "a CSV file").text("a table in UTF-8"))))
    lines = [[cell.strip() for cell in line] for line in lines if line]
    require(len(lines) > 1, f"{path}: rows", len(lines[1:]), "a head of keys, and a row or more")
    head = [name.removeprefix("\ufeff") for name in lines[0]]
    twice = len(set(head)) < len(head) or not all(head)
    require(not twice, f"{path}: head", ", ".join(head), "keys, each once")
    for number, line in enumerate(lines[1:], 2):
        got = len([cell for cell in line if cell])
        require(
            got == len(head) == len(line), f"{path}: row {number}", f"{got} values", f"{len(head)}"
        )
    columns = {}
    for name, cells in zip(head, zip(*lines[1:], strict=True), strict=True):
        columns[name] = [parse_value(cell) for cell in cells]
        texts = [k for k, value in enumerate(columns[name]) if isinstance(value, str)]
        if texts and len(texts) < len(cells):
            where = f"{path}: row {texts[0] + 2}: {name}"
            raise InputError(f"{where}; got {cells[texts[0]]!r}; expected a value as the others")
    return columns
