"""report.html and report.json of a study: what its parameters do to what was measured."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations, groupby, zip_longest
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim._version import __version__
from gpusim.arrays.array_types import Float
from gpusim.files.atomic_files import PathLike, safe_name, write_text
from gpusim.files.output_folder import inside
from gpusim.report.figure_store import FigureStore
from gpusim.report.html import page_template
from gpusim.report.model import Drawing
from gpusim.report.text import plain_data
from gpusim.studies.effects import (
    Effect,
    SobolIndices,
    association,
    effect,
    interaction,
    levels_of,
    response,
    sobol,
)
from gpusim.studies.figures import draw_indices, draw_interaction, draw_main_effects, draw_scatter
from gpusim.studies.study_tables import Study
from gpusim.studies.table import SampleTable

_MOST_QUANTITIES = 4
_STRONGEST = 3
"""Parameters whose pairs are drawn."""
_MOST_AXES = 7
"""Of the plot of all against all."""
_SHOWN = 5
"""Rows of best points and worst samples."""
_MOST_FAILURES = 30
_TOGETHER = 0.3
"""Association from which on effects of two parameters aren't told apart by looking at one."""

Pictures = Callable[[int], Path | None]
"""A picture of a sample, by its number in the table; None if there is none."""


@dataclass(frozen=True)
class Finding:
    """What the parameters do to a quantity: ``effects`` of each, strongest first, ``indices`` if
    the points are Saltelli's, ``drawings``, rows of the ``best`` points and the ``worst`` samples.
    """

    quantity: tuple[str, str]
    is_error: bool
    whole: float
    effects: tuple[Effect, ...]
    indices: SobolIndices | None
    drawings: tuple[Drawing, ...]
    best: list[dict[str, Any]]
    worst: list[dict[str, Any]]

    def content(self) -> dict[str, Any]:
        """For report.json."""
        effects = {
            one.levels.parameter: {
                "share": one.share, "levels": one.levels.labels, "values": one.values,
                "sigmas": one.sigmas, "counts": one.counts,
            }
            for one in self.effects
        }  # fmt: skip
        name, unit = self.quantity
        return {
            "quantity": name, "unit": unit, "rms_error" if self.is_error else "mean": self.whole,
            "effects": effects, "sobol": self.indices, "best": self.best,
        }  # fmt: skip


def write_study_report(study: Study, table: SampleTable, out: PathLike, pictures: Pictures) -> Path:
    """Write report.json, figures and report.html of a finished study; returns the page."""
    folder, status = Path(out), np.asarray(table["status"])
    figures = inside(folder, "figures")
    findings = [
        _finding(study, table, quantity, figures, (lambda number: None) if k else pictures)
        for k, quantity in enumerate(main_quantities(table.quantities))
    ]
    columns = _numbers(table, [one.quantity for one in findings])
    scatter = [partial(draw_scatter, columns, inside(figures, "all.png"))] if columns else []
    failed: dict[tuple[str, str], list[int]] = {}
    for k in np.flatnonzero(status != "done"):
        failed.setdefault((str(status[k]), str(table["error"][k])), []).append(int(k))
    failures = [{"status": key[0], "error": key[1], "samples": own} for key, own in failed.items()]
    told = {
        "schema": 1, "version": __version__, "study": Path(study.source).stem,
        "samples": len(table), "parameters": list(table.parameters),
        "counts": {state: int(np.sum(status == state)) for state in sorted(set(status.tolist()))},
        "keys": {one.name: one.key for one in study.tables.parameter if one.name},
        "mixed": _mixed(study, table, status == "done"), "findings": findings, "failures": failures,
        "seconds": float(np.nansum(table["seconds"])),
    }  # fmt: skip
    write_text(inside(folder, "report.json"), json.dumps(plain_data(told), indent=2) + "\n")
    store = FigureStore(figures)
    page = page_template("study.html.j2").render(
        told, failed=sum(map(len, failed.values())), most=_MOST_FAILURES,
        figures=[[store.figure(one) for one in finding.drawings] for finding in findings],
        last=[store.figure(one) for one in scatter],
    )  # fmt: skip
    store.keep()
    return write_text(inside(folder, "report.html"), page)


def main_quantities(quantities: Sequence[tuple[str, str]]) -> list[tuple[str, str]]:
    """Of each measure its RMS errors, or its first number if there are none, as many as a page can
    show."""
    found: list[list[tuple[str, str]]] = []
    for _, own in groupby(quantities, lambda one: one[0].split(": ")[0]):
        some = [*own]
        found.append(
            [one for one in some if "RMS" in one[0] and "beyond" not in one[0]] or some[:1]
        )
    in_turn = [one for row in zip_longest(*found) for one in row if one is not None]
    return in_turn[:_MOST_QUANTITIES]


def _mixed(study: Study, table: SampleTable, done: npt.NDArray[Any]) -> list[list[str]]:
    """Pairs of parameters that weren't varied independently of each other."""
    levels = [levels_of(table, name) for name in table.parameters]
    drawn = {one.label for one in study.tables.drawn}
    return [
        [one.parameter, other.parameter]
        for one, other in combinations([one for one in levels if len(one.labels) > 1], 2)
        if association(one, other, done, bool(drawn & {one.parameter, other.parameter})) > _TOGETHER
    ]


def _finding(
    study: Study, table: SampleTable, quantity: tuple[str, str], folder: Path, pictures: Pictures
) -> Finding:
    """Of one quantity."""
    values, is_error = response(table, quantity)
    levels = [levels_of(table, one) for one in table.parameters]
    effects = [effect(values, one, is_error) for one in levels if len(one.labels) > 1]
    effects.sort(key=lambda one: -one.share)
    name, unit = quantity
    label = f"{'RMS error' if is_error else 'Mean'} ({unit})".removesuffix(" ()")
    file = safe_name(name).lower()[:60]
    drawings: list[Drawing] = []
    if effects:
        path = inside(folder, f"effects-{file}.png")
        drawings.append(partial(draw_main_effects, name, label, effects, path))
    for one, other in combinations([one.levels for one in effects[:_STRONGEST]], 2):
        lines = interaction(values, one, other, is_error)
        pair = safe_name(f"{one.parameter}-{other.parameter}").lower()[:60]
        path = inside(folder, f"pair-{file}-{pair}.png")
        drawings.append(partial(draw_interaction, name, label, lines, other, path))
    indices = None
    if study.tables.sensitivity:
        drawn = [one.label for one in study.tables.drawn]
        indices = sobol(values.reshape(len(drawn) + 2, -1), drawn)  # as `design` has them
        drawings.append(partial(draw_indices, name, indices, inside(folder, f"sobol-{file}.png")))
    known = values[np.isfinite(values)]
    whole = np.nan
    if len(known):
        whole = float(np.sqrt(np.mean(known**2)) if is_error else known.mean())
    best = _best(table, values, "RMS" in name) if is_error else []
    worst = _worst(table, values, pictures) if is_error else []
    return Finding(quantity, is_error, whole, tuple(effects), indices, tuple(drawings), best, worst)


def _numbers(table: SampleTable, quantities: Sequence[tuple[str, str]]) -> dict[str, Float]:
    """Parameters that are numbers and vary, and quantities."""
    varied = {one: table[one] for one in table.parameters if table[one].dtype.kind in "fiu"}
    columns = {one: column.astype(float) for one, column in varied.items() if np.ptp(column) > 0}
    columns |= {f"{name} ({unit})": response(table, (name, unit))[0] for name, unit in quantities}
    return dict([*columns.items()][-_MOST_AXES:])


def _point(table: SampleTable, k: int) -> str:
    """A sample's parameters in words."""
    texts = []
    for parameter in table.parameters:
        value = table[parameter][k]
        is_number = isinstance(value, float | np.floating)
        texts.append(f"{parameter} = {f'{value:.6g}' if is_number else value}")
    return ", ".join(texts)


def _best(table: SampleTable, values: Float, is_rms: bool) -> list[dict[str, Any]]:
    """Points with the least RMS error over their repeats; of one sample each that is luck, unless
    the response ``is_rms`` of many points itself."""
    points: dict[str, list[int]] = {}
    for k in np.flatnonzero(np.isfinite(values)).tolist():
        points.setdefault(_point(table, k), []).append(k)
    rows: list[dict[str, Any]] = [
        {"point": point, "value": float(np.sqrt(np.mean(values[own] ** 2))), "repeats": len(own)}
        for point, own in points.items()
    ]
    tells = len(rows) > 1 and (is_rms or len(rows) < np.isfinite(values).sum())
    return sorted(rows, key=lambda row: row["value"])[:_SHOWN] if tells else []


def _worst(table: SampleTable, values: Float, pictures: Pictures) -> list[dict[str, Any]]:
    """Samples with the largest errors, and a picture of each."""
    order = np.argsort(-np.abs(values), kind="stable")
    shown = [int(k) for k in order if np.isfinite(values[k])][:_SHOWN]
    return [
        {"sample": int(table["sample"][k]), "value": float(values[k]),
         "point": _point(table, k), "picture": pictures(int(table["sample"][k]))}
        for k in shown
    ]  # fmt: skip
