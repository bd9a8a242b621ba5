"""The figures of a report: deflection line, convergence, tracked markers, errors.

Each function draws one PNG, writes it atomically and returns a `Figure` with its caption.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.round_numbers import round_down
from gpusim.export.images import read_image
from gpusim.files.atomic_files import PathLike
from gpusim.report.findings import LoadPath
from gpusim.report.html import reduced
from gpusim.report.model import Figure, Measurement, Overlay, Series
from gpusim.report.style import (
    BAD,
    GOOD,
    MEASURED,
    MUTED,
    PAGE,
    TEXT,
    TRUTH,
    axis_title,
    draw_png,
    page_pixels,
)
from gpusim.report.text import number, signed_percent
from gpusim.validation import require

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas

_WIDTH = 7.2  # inches
_ARROW_FRACTION = 0.12  # the longest arrow covers about this part of the image's width,
_LONGEST_SIDES = 1.75  # but no more than of an image that is so many times as wide as high
_LABEL = 0.35  # of half a chart of errors, which a number beside its bar may take


def draw_series(series: Series, path: PathLike, beside: Sequence[Series] = ()) -> Figure:
    """Draw measured points on the true curve, and below it their difference in units and pixels;
    ``beside``: more of them in the same figure."""
    title = series.figure or series.name
    residual = np.concatenate([one.y_measured - one.y_truth for one in (series, *beside)])

    def draw(canvas: Canvas) -> None:
        upper, lower = canvas.subplots(2, 1, sharex=True, height_ratios=[2.2, 1.0])
        for one in beside:
            draw_measured(upper, one, legend=False)
        draw_measured(upper, series)
        _label_curves(upper, [series, *beside])
        axis_title(upper, title)
        _draw_residual(lower, series, residual, 1 + len(beside))

    draw_png(path, (_WIDTH, 5.2), draw)
    finite = np.abs(residual[np.isfinite(residual)])
    caption = f"{finite.size} of {residual.size} points measured"
    if finite.size:
        rms, largest = float(np.sqrt(np.mean(finite**2))), float(finite.max())
        unit = f" {series.y_unit}".rstrip()
        caption += f"; difference to the truth {number(rms, 2)}{unit} RMS"
        caption += f", at most {number(largest, 2)}{unit}"
        if series.units_per_px:
            caption += f" ({number(largest / abs(series.units_per_px), 2)} px)"
    return Figure(Path(path), title, caption + ".")


def draw_measured(axes: Axes, series: Series, legend: bool = True, **style: Any) -> None:
    """Draw measured points on the true curve; ``style`` is the points'."""
    labels = "Finite elements (truth)", "Measured from the images"
    true, measured = labels if legend else ("_", "_")
    order = np.argsort(series.x, kind="stable")
    line = series.x[order], series.y_truth[order]
    if series.truth_x.size:
        line = series.truth_x, series.truth_y
    axes.plot(*line, color=TRUTH, linewidth=2.2, label=true)
    axes.plot(
        series.x,
        series.y_measured,
        "o",
        **{
            "markersize": 6.5,
            "markerfacecolor": PAGE,
            "markeredgecolor": MEASURED,
            "markeredgewidth": 1.8,
            "label": measured,
            **style,
        },
    )
    if legend:
        axes.set_ylabel(_with_unit(series.y_label, series))
        axes.legend(loc="best")


def _with_unit(label: str, series: Series) -> str:
    """A label of what has the unit of a series, or none."""
    return f"{label} ({series.y_unit})" if series.y_unit else label


def _label_curves(axes: Axes, curves: Sequence[Series]) -> None:
    """Each of several curves where it stands farthest from the others."""
    values = np.stack([one.y_truth for one in curves])
    for k, one in enumerate(curves if len(curves) > 1 else ()):
        apart = np.abs(np.delete(values, k, axis=0) - values[k]).min(axis=0)
        if one.label and np.isfinite(apart).any():
            at = int(np.nanargmax(apart))
            side = "left" if one.x[at] < one.x.mean() else "right"
            axes.annotate(
                one.label, (one.x[at], one.y_truth[at]), (0, 10), textcoords="offset points",
                ha=side, fontsize="small", color=TEXT,
                bbox={"facecolor": PAGE, "edgecolor": "none", "alpha": 0.7, "pad": 1.0},
            )  # fmt: skip


def _draw_residual(axes: Axes, series: Series, residual: npt.NDArray[Any], count: int) -> None:
    """Of ``count`` series over the same x."""
    from matplotlib.ticker import MaxNLocator

    x = np.tile(series.x, count)
    axes.axhline(0.0, color=TRUTH, linewidth=1.4)
    axes.vlines(x, 0.0, residual, color=MEASURED, linewidth=1.6)
    axes.plot(x, residual, "o", color=MEASURED, markersize=4.5)
    axes.set(xlabel=series.x_label, ylabel=_with_unit("Residual", series))
    axes.yaxis.set_major_locator(MaxNLocator(5))
    # Zero in the middle: a bias shows as points on one side.
    finite = np.abs(residual[np.isfinite(residual)])
    span = 1.25 * float(finite.max(initial=0.0)) or 1.0
    axes.set_ylim(-span, span)
    if series.units_per_px:
        scale = abs(series.units_per_px)
        to_px, to_units = partial(np.multiply, 1.0 / scale), partial(np.multiply, scale)
        right = axes.secondary_yaxis("right", functions=(to_px, to_units))
        right.set_ylabel("(px)", color=TEXT)
        right.spines["right"].set_visible(True)
        right.yaxis.set_major_locator(MaxNLocator(5))
    axis_title(axes, "Measured minus truth")


def draw_convergence(residuals: Sequence[float], path: PathLike) -> Figure:
    """Draw the solver's residuals, log scale; ``residuals[k]`` is that before iteration k + 1."""
    values = np.asarray(residuals, np.float64)
    some = values.ndim == 1 and values.size > 0
    require(some, "residuals", f"shape {values.shape}", "(iterations,), not empty")
    shown = np.where(np.isfinite(values) & (values > 0.0), values, np.nan)

    def draw(canvas: Canvas) -> None:
        from matplotlib.ticker import MaxNLocator, NullLocator

        axes = canvas.subplots()
        axes.semilogy(np.arange(values.size), shown, color=TRUTH, linewidth=2.0)
        axes.plot(values.size - 1, shown[-1], "o", color=TRUTH, markersize=6)
        axes.set(xlabel="Iteration", ylabel="Residual / first one")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.yaxis.set_minor_locator(NullLocator())
        axis_title(axes, "Conjugate gradients")

    draw_png(path, (_WIDTH, 3.1), draw)
    last = number(values[-1], 2) if np.isfinite(values[-1]) else "not finite"
    count = values.size
    caption = (
        f"Norm of the preconditioned residual before each of {count} "
        f"iteration{'s' if count != 1 else ''}, the last one {last}. The solver stops by its "
        "estimate of the displacement error, not by this."
    )
    return Figure(Path(path), "Convergence of the solver", caption)


def draw_overlay(overlay: Overlay, path: PathLike) -> Figure:
    """Draw tracked points with magnified displacement arrows on the down-scaled image.

    Raises InputError if that can't be read.
    """
    image = read_image(overlay.image) if isinstance(overlay.image, Path) else overlay.image
    height, width = image.shape[:2]
    size = _WIDTH, _WIDTH * height / width
    pixels = reduced(image, page_pixels(size))
    found = np.isfinite(overlay.displacement[:, 0] + overlay.displacement[:, 1])
    longest = float(np.hypot(*overlay.displacement[found].T).max(initial=0.0))
    room = _ARROW_FRACTION * min(width, _LONGEST_SIDES * height)
    factor = round_down(room / longest) if longest > 0.0 else 1.0

    def draw(canvas: Canvas) -> None:
        canvas.figimage(pixels if pixels.ndim == 3 else np.dstack(3 * [pixels]), zorder=-1)
        axes = canvas.add_axes((0.0, 0.0, 1.0, 1.0), facecolor="none")
        # Pixel centres are integers: the outer edges of the image lie half a pixel outside.
        axes.axis((-0.5, width - 0.5, height - 0.5, -0.5))
        axes.set_axis_off()
        start, step = overlay.points[found], overlay.displacement[found] * factor
        arrows = axes.quiver(
            *start.T,
            *step.T,
            angles="xy",
            scale_units="xy",
            scale=1.0,
            color="#ffd166",
            edgecolor="#00000090",
            linewidth=0.6,
            width=0.0032,
            headwidth=4.5,
            zorder=3,
        )
        axes.plot(*start.T, "o", markersize=5, mfc="none", mec="#56b4e9", mew=1.4, zorder=4)
        axes.plot(*overlay.points[~found].T, "x", color="#ff5a4f", markersize=7, mew=2, zorder=4)
        if longest > 0.0:
            shown, label = _key(overlay, longest)
            key = axes.quiverkey(
                arrows,
                0.98,
                0.07 if np.median(overlay.points[:, 1]) < 0.5 * height else 0.93,
                shown * factor,
                f"{label}, drawn x{factor:g}",
                labelpos="W",
                labelcolor="white",
            )
            key.text.set_bbox({"facecolor": "#000000a0", "edgecolor": "none", "pad": 3})

    draw_png(path, size, draw, None)
    caption = f"{int(found.sum())} of {found.size} points tracked"
    if longest > 0.0:
        caption += f"; displacements drawn {factor:g} times their length, the longest is"
        caption += f" {longest:.2f} px"
        if overlay.units_per_px:
            caption += f" = {longest * abs(overlay.units_per_px):.3g} {overlay.unit}"
    if not found.all():
        caption += "; crosses mark those that were lost"
    return Figure(Path(path), overlay.title, caption + ".", photo=True)


def _key(overlay: Overlay, longest: float) -> tuple[float, str]:
    """Return the length in px of a round reference displacement, and its label."""
    scale, unit = (abs(overlay.units_per_px), overlay.unit) if overlay.units_per_px else (1.0, "px")
    value = round_down(0.6 * longest * scale)
    return value / scale, f"{value:g} {unit}"


def draw_load_path(load_path: LoadPath, path: PathLike) -> Figure:
    """Draw the reaction over the displacement of a node; without one the displacement over the load
    factor."""
    moved = load_path.displacement_mm, "Displacement (mm)"
    load = load_path.reaction_N, "Resultant reaction (N)"
    linear = load_path.linear_mm, load_path.linear_N
    if load_path.support:
        load = load_path.reaction_N, f"Force of {load_path.support} (N)"
    if not load_path.held:
        load = load_path.factors, load_path.word.capitalize()
        linear = load_path.linear_mm, load_path.factors
    over_load = not load_path.held and not load_path.linear_mm
    across, up = (load, moved) if over_load else (moved, load)

    def draw(canvas: Canvas) -> None:
        axes = canvas.subplots()
        axes.plot(across[0], up[0], "o-", color=TRUTH, linewidth=1.8, markersize=5)
        if load_path.linear_mm:
            axes.set_ylim(axes.get_ylim())  # the line leaves them where metal yields
            axes.plot(*linear, "--", color=MUTED, linewidth=1.2)
        axes.set(xlabel=across[1], ylabel=up[1])

    draw_png(path, (_WIDTH, 3.4), draw)
    place = ", ".join(f"{value:.4g}" for value in load_path.position_mm)
    caption = f"Of the point at ({place}) mm of {load_path.body}, which moves most."
    caption += " Dashed: by linear theory." if load_path.linear_mm else ""
    return Figure(Path(path), "Load and displacement", caption)


def draw_errors(measurements: Sequence[Measurement], path: PathLike) -> Figure:
    """Draw the relative error of each measurement as a bar, with its tolerance as two marks."""
    shown = [item for item in measurements if np.isfinite(item.relative_told)]
    require(bool(shown), "measurements", "none with a relative error", "at least one")

    def draw(canvas: Canvas) -> None:
        draw_error_bars(canvas.subplots(), shown)

    draw_png(path, (_WIDTH, 1.1 + 0.42 * len(shown)), draw)
    caption = "Error of each measured number; the grey marks are its tolerance."
    return Figure(Path(path), "Errors", caption)


def draw_error_bars(axes: Axes, shown: Sequence[Measurement]) -> None:
    """Draw the relative errors of what has one, with tolerances."""
    percent = [100.0 * item.error_relative for item in shown]
    limits = [100.0 * (item.tolerance_relative or 0.0) for item in shown]
    span = 1.4 * max(*map(abs, percent), *limits) or 1.0
    colour = {"good": GOOD, "bad": BAD, "unknown": TRUTH}
    places = np.arange(len(shown))
    # one call for all bars: each costs as much as a hundred bars
    axes.barh(places, percent, height=0.5, color=[colour[item.verdict] for item in shown])
    judged = [place for place in places if limits[place] > 0.0]
    ends = np.array([limits[place] for place in judged])
    rows = np.tile(judged, 2)
    axes.vlines(np.concatenate([-ends, ends]), rows - 0.36, rows + 0.36, colors=MUTED)
    for place, (item, value) in enumerate(zip(shown, percent, strict=True)):
        crossed = abs(value) < limits[place] < abs(value) + _LABEL * span
        axes.annotate(
            signed_percent(item.error_relative, 2),
            (np.copysign(limits[place], value) if crossed else value, place),
            xytext=(7 if value >= 0.0 else -7, 0),
            textcoords="offset points",
            ha="left" if value >= 0.0 else "right",
            va="center",
            fontsize=9.5,
            bbox={"facecolor": axes.get_facecolor(), "edgecolor": "none", "pad": 1.5},
        )
    axes.axvline(0.0, color=MUTED, linewidth=1.0)
    axes.set_yticks(range(len(shown)), [item.name for item in shown])
    axes.tick_params(axis="y", length=0)
    axes.set_ylim(len(shown) - 0.4, -0.6)
    axes.grid(visible=False, axis="y")
    axes.set_xlim(-span, span)
    axes.set_xlabel("Error relative to the truth (%)")
