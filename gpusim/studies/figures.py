"""Figures of a study: main effects, two parameters together, all against all, Sobol indices."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.files.atomic_files import PathLike
from gpusim.report.model import Figure
from gpusim.report.style import GOOD, MEASURED, MUTED, TRUTH, axis_title, draw_png, named
from gpusim.studies.effects import Effect, Levels, SobolIndices

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas

_COLOURS = (TRUTH, MEASURED, GOOD, "#cc79a7", MUTED, "#e69f00", "#56b4e9", "#000000")
_LABEL = 14
"""Letters of a level beside its axis."""
_ACROSS = 4
"""Plots beside each other."""


def draw_main_effects(
    title: str, y_label: str, effects: Sequence[Effect], path: PathLike
) -> Figure:
    """Draw a response over the levels of each parameter, strongest first."""
    rows = -(-len(effects) // _ACROSS)
    across = min(len(effects), _ACROSS)

    def draw(canvas: Canvas) -> None:
        plots = canvas.subplots(rows, across, sharey=True, squeeze=False).ravel()
        for axes, one in zip(plots, effects, strict=False):
            _draw_effect(axes, one, TRUTH)
            axis_title(axes, f"{named(one.levels.parameter)} ({100 * one.share:.0f} %)")
        for axes in plots[len(effects) :]:
            axes.remove()
        for axes in plots[::across]:
            axes.set_ylabel(named(y_label))

    draw_png(path, (max(2.6 * across, 7.2), 2.9 * rows), draw)
    caption = "Bars are standard uncertainties. In brackets: the share of the variance of all "
    caption += "samples that lies between the levels."
    return Figure(Path(path), f"{title}: one parameter at a time", caption)


def draw_interaction(
    title: str, y_label: str, effects: Sequence[Effect], other: Levels, path: PathLike
) -> Figure:
    """Draw a response over the levels of one parameter, a line for each level of the other."""

    def draw(canvas: Canvas) -> None:
        axes = canvas.subplots()
        for one, colour, label in zip(effects, _COLOURS, other.labels, strict=False):
            _draw_effect(axes, one, colour, named(label))
        axes.set(xlabel=named(effects[0].levels.parameter), ylabel=named(y_label))
        canvas.legend(title=named(other.parameter), loc="outside right upper")

    draw_png(path, (7.2, 3.4), draw)
    pair = f"{effects[0].levels.parameter} and {other.parameter}"
    return Figure(Path(path), f"{title}: {pair}", "Lines that aren't parallel act on each other.")


def _draw_effect(axes: Axes, effect: Effect, colour: str, label: str = "") -> None:
    levels = effect.levels
    style: dict[str, Any] = {"color": colour, "marker": "o", "markersize": 4, "linewidth": 1.2}
    if not levels.are_numbers:
        style["linestyle"] = "none"
    axes.errorbar(levels.places, effect.values, np.nan_to_num(effect.sigmas), capsize=2,
                  label=label, **style)  # fmt: skip
    if levels.are_numbers and levels.places[0] > 0.0 and levels.places[-1] > 8 * levels.places[0]:
        axes.set_xscale("log")
        axes.xaxis.set_minor_formatter("")
    if not levels.are_numbers or len(levels.labels) <= 4:
        axes.set_xticks(levels.places, [named(one[:_LABEL]) for one in levels.labels])


def draw_scatter(columns: Mapping[str, Float], path: PathLike) -> Figure:
    """Draw numbers of all samples against each other, and how each is distributed."""
    names, size = list(columns), len(columns)

    def draw(canvas: Canvas) -> None:
        for (row, column), axes in np.ndenumerate(canvas.subplots(size, size, squeeze=False)):
            if row < column:
                axes.remove()
                continue
            x, y = columns[names[column]], columns[names[row]]
            if row == column:
                axes.hist(x[np.isfinite(x)], bins=20, color=MUTED)
            else:
                axes.plot(x, y, ".", color=TRUTH, markersize=3, alpha=0.5)
            axes.tick_params(labelsize=7, labelbottom=row == size - 1, labelleft=column == 0)
            if row == size - 1:
                axes.set_xlabel(named(names[column][:28]), fontsize=8)
            if column == 0:
                axes.set_ylabel(named(names[row][:28]), fontsize=8)

    side = max(4.0, 1.7 * size)
    draw_png(path, (side, side), draw)
    return Figure(Path(path), "All against all", "A dot is a sample.")


def draw_indices(title: str, indices: SobolIndices, path: PathLike) -> Figure:
    """Draw first-order and total indices as bars with their intervals."""

    def draw(canvas: Canvas) -> None:
        axes = canvas.subplots()
        places = np.arange(len(indices.parameters))
        bars = (
            ("alone", indices.first, indices.first_interval, TRUTH),
            ("with all others", indices.total, indices.total_interval, MEASURED),
        )
        for shift, (label, values, interval, colour) in zip((-0.2, 0.2), bars, strict=True):
            reach = np.abs(interval.T - values)
            axes.barh(places + shift, values, 0.38, xerr=reach, color=colour, label=label)
        axes.set_yticks(places, [named(one) for one in indices.parameters])
        axes.set(xlabel="Share of the variance")
        axes.invert_yaxis()
        axes.legend()

    draw_png(path, (7.2, 1.2 + 0.55 * len(indices.parameters)), draw)
    caption = f"Sobol indices of {indices.points} points; 95 % intervals by bootstrap."
    return Figure(Path(path), f"{title}: shares of the variance", caption)
