"""The figures of a report: deflection line, convergence, tracked markers, errors.

Each function draws one PNG, writes it atomically and returns a `Figure` with its caption.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.export.files import PathLike
from gpusim.export.images import read_image
from gpusim.report.canvas import Canvas, pixels, text_size
from gpusim.report.chart import draw_chart
from gpusim.report.model import Figure, Measurement, Overlay, Series
from gpusim.report.panel import Panel
from gpusim.report.style import BAD, DPI, GOOD, MEASURED, MUTED, TRUTH
from gpusim.report.text import number, signed_percent

__all__ = ["draw_convergence", "draw_errors", "draw_overlay", "draw_series"]

_WIDTH = 7.2  # inches
_ARROW_FRACTION = 0.12  # the longest arrow covers about this part of the image's width
_ARROW, _FOUND, _LOST, _BEHIND = "#ffd166", "#56b4e9", "#ff5a4f", "#000000"


def draw_series(series: Series, path: PathLike) -> Figure:
    """Draw measured points on the true curve, and below it their difference in units and pixels."""
    residual = series.y_measured - series.y_truth
    order = np.argsort(series.x, kind="stable")
    line = series.x[order], series.y_truth[order]
    if series.truth_x.size:
        line = series.truth_x, series.truth_y
    upper = Panel(series.name, y_label=f"{series.y_label} ({series.y_unit})")
    upper.line(*line, TRUTH, 2.2, label="Finite elements (truth)")
    upper.marks(series.x, series.y_measured, MEASURED, size=6.5, edge=1.8,
                label="Measured from the images")  # fmt: skip
    lower = _residual(series, residual)
    upper.x_range = lower.x_range = upper.ranges()[0]
    draw_chart(path, (_WIDTH, 5.2), [[upper], [lower]], [2.2, 1.0])
    finite = np.abs(residual[np.isfinite(residual)])
    caption = f"{finite.size} of {residual.size} points measured"
    if finite.size:
        rms, largest = float(np.sqrt(np.mean(finite**2))), float(finite.max())
        caption += f"; difference to the truth {number(rms, 2)} {series.y_unit} RMS"
        caption += f", at most {number(largest, 2)} {series.y_unit}"
        if series.units_per_px:
            caption += f" ({number(largest / abs(series.units_per_px), 2)} px)"
    return Figure(Path(path), series.name, caption + ".")


def _residual(series: Series, residual: npt.NDArray[np.float64]) -> Panel:
    # Zero in the middle: a bias shows as points on one side.
    finite = np.abs(residual[np.isfinite(residual)])
    span = 1.25 * float(finite.max(initial=0.0)) or 1.0
    panel = Panel(
        "Measured minus truth", series.x_label, f"Residual ({series.y_unit})",
        y_range=(-span, span), rows=5,
    )  # fmt: skip
    if series.units_per_px:
        panel.right, panel.right_label = abs(series.units_per_px), "(px)"
    panel.rule(0.0, TRUTH, width=1.4)
    ends = np.stack([np.zeros_like(residual), residual], axis=1)
    panel.segments(np.stack([series.x, series.x], axis=1), ends, MEASURED, 1.6)
    panel.marks(series.x, residual, MEASURED, size=4.5, inside=MEASURED, edge=0.5)
    return panel


def draw_convergence(residuals: Sequence[float], path: PathLike) -> Figure:
    """Draw the solver's residuals, log scale; ``residuals[k]`` is that before iteration k + 1."""
    values = np.asarray(residuals, np.float64)
    if values.ndim != 1 or values.size == 0:
        raise InputError(f"residuals: got shape {values.shape}; expected (iterations,), not empty")
    with np.errstate(divide="ignore", invalid="ignore"):
        shown = np.log10(np.where(values > 0.0, values, np.nan))
    shown = np.where(np.isfinite(shown), shown, np.nan)
    count = np.arange(values.size)
    panel = Panel("Conjugate gradients", "Iteration", "Residual / first one", log=True, whole=True)
    panel.line(count, shown, TRUTH, 2.0)
    panel.marks(count[-1:], shown[-1:], TRUTH, size=6.0, inside=TRUTH)
    draw_chart(path, (_WIDTH, 3.1), [[panel]])
    last = number(values[-1], 2) if np.isfinite(values[-1]) else "not finite"
    caption = (
        f"Norm of the preconditioned residual before each of {values.size} "
        f"iteration{'s' if values.size != 1 else ''}, the last one {last}. The solver stops by its "
        "estimate of the displacement error, not by this."
    )
    return Figure(Path(path), "Convergence of the solver", caption)


def draw_overlay(overlay: Overlay, path: PathLike) -> Figure:
    """Draw tracked points with magnified displacement arrows on the down-scaled image."""
    image = read_image(overlay.image)
    width = image.shape[1]
    found = np.isfinite(overlay.displacement[:, 0] + overlay.displacement[:, 1])
    longest = float(np.hypot(*overlay.displacement[found].T).max(initial=0.0))
    factor = _round_down(_ARROW_FRACTION * width / longest) if longest > 0.0 else 1.0
    canvas = _backdrop(image)
    scale = canvas.box[2] / width
    # pixel centres are integers: the outer edges of the image lie half a pixel outside
    start = (overlay.points + 0.5) * scale
    step = overlay.displacement * (factor * scale)
    for at, arrow in zip(start[found], step[found], strict=True):
        _arrow(canvas, at, arrow)
    canvas.marks(start[found], "o", 5.0, _FOUND, edge=1.4)
    canvas.marks(start[~found], "x", 7.0, _LOST, edge=2.0)
    if longest > 0.0:
        shown, label = _key(overlay, longest)
        _draw_key(canvas, shown * factor * scale, f"{label}, drawn x{factor:g}")
    canvas.save(path)
    caption = f"{int(found.sum())} of {found.size} markers tracked"
    if longest > 0.0:
        caption += f"; displacements drawn {factor:g} times their length, the longest is"
        caption += f" {longest:.2f} px"
        if overlay.units_per_px:
            caption += f" = {longest * abs(overlay.units_per_px):.3g} {overlay.unit}"
    if not found.all():
        caption += "; crosses mark lost markers"
    return Figure(Path(path), overlay.title, caption + ".", photo=True)


def _backdrop(image: npt.NDArray[Any]) -> Canvas:
    """The picture as wide as a page, grey."""
    height, width = image.shape
    wide = round(_WIDTH * DPI)
    whole = max(1, width // wide)  # whole pixels are put together many times faster than others
    if whole > 1:
        size = width // whole, height // whole
        image = cv2.resize(image[: size[1] * whole, : size[0] * whole], size,
                           interpolation=cv2.INTER_AREA)  # fmt: skip
    size = wide, max(1, round(wide * height / width))
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    grey = np.asarray(small if image.dtype == np.uint8 else small // 256, dtype=np.uint8)
    return Canvas(np.ascontiguousarray(np.repeat(grey[:, :, None], 3, axis=2)))


def _arrow(canvas: Canvas, start: npt.NDArray[np.float64], step: npt.NDArray[np.float64]) -> None:
    """An arrow with a dark rim."""
    length = float(np.hypot(*step))
    if not length > 1.0:
        return
    along = step / length
    across = np.array([-along[1], along[0]])
    half, head = pixels(0.8), min(pixels(7.0), 0.6 * length)
    end, neck = start + step, start + step - head * along
    side, tip = half * across, 0.45 * head * across
    outline = np.array([start + side, neck + side, neck + tip, end, neck - tip, neck - side,
                        start - side])  # fmt: skip
    canvas.lines([np.concatenate([outline, outline[:1]])], _BEHIND, 1.0)
    canvas.fill(outline, _ARROW)


def _draw_key(canvas: Canvas, length: float, text: str) -> None:
    """An arrow of known length and what it stands for, lower right."""
    width, height = canvas.box[2:]
    wide, letters = text_size(text)
    gap = pixels(4.0)
    right, low = width - 2.0 * gap, height - 2.0 * gap
    high = low - letters - 2.0 * gap
    label = np.array([[right - wide - 2 * gap, high], [right, high], [right, low],
                      [right - wide - 2 * gap, low]])  # fmt: skip
    canvas.fill(label, _BEHIND, opacity=0.63)
    canvas.text(right - gap, 0.5 * (high + low), text, colour="#ffffff", across=1.0, down=0.5)
    _arrow(canvas, np.array([max(right - wide - 4.0 * gap - length, gap), 0.5 * (high + low)]),
           np.array([length, 0.0]))  # fmt: skip


def _key(overlay: Overlay, longest: float) -> tuple[float, str]:
    """Return the length in px of a round reference displacement, and its label."""
    if overlay.units_per_px:
        scale = abs(overlay.units_per_px)
        value = _round_down(0.6 * longest * scale)
        return value / scale, f"{value:g} {overlay.unit}"
    value = _round_down(0.6 * longest)
    return value, f"{value:g} px"


def draw_errors(measurements: Sequence[Measurement], path: PathLike) -> Figure:
    """Draw the relative error of each measurement as a bar, with its tolerance as two marks."""
    shown = [item for item in measurements if np.isfinite(item.error_relative)]
    if not shown:
        raise InputError("measurements: got none with a relative error; expected at least one")
    percent = [100.0 * item.error_relative for item in shown]
    limits = [100.0 * (item.tolerance_relative or 0.0) for item in shown]
    span = 1.4 * max(*map(abs, percent), *limits) or 1.0

    colour = {"good": GOOD, "bad": BAD, "unknown": TRUTH}
    panel = Panel(
        x_label="Error relative to the truth (%)", x_range=(-span, span),
        y_range=(-0.6, len(shown) - 0.4), downwards=True, names=[item.name for item in shown],
    )  # fmt: skip
    for place, (item, value, limit) in enumerate(zip(shown, percent, limits, strict=True)):
        corners = np.array([[0.0, place - 0.25, value, place + 0.25]])
        panel.bars(corners, colour[item.verdict])
        if limit > 0.0:
            ends = np.array([[place - 0.36, place + 0.36]] * 2)
            panel.segments([[-limit, -limit], [limit, limit]], ends, MUTED, 1.4)
        panel.note(value, place, signed_percent(item.error_relative, 2), right=value < 0.0,
                   ahead=7.0)  # fmt: skip
    panel.rule(0.0, MUTED, upright=True)
    draw_chart(path, (_WIDTH, 1.1 + 0.42 * len(shown)), [[panel]])
    caption = "Error of each measured number; the grey marks are its tolerance."
    return Figure(Path(path), "Errors", caption)


def _round_down(value: float) -> float:
    """Return the largest of …, 0.5, 1, 2, 5, 10, 20, … that isn't above ``value`` > 0."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(max(step * power for step in (1.0, 2.0, 5.0) if step * power <= value * 1.000001))
