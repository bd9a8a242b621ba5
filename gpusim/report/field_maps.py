"""Maps of fields over a picture; measured fields beside true ones, and their differences."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float, Single
from gpusim.arrays.grey import grey_of
from gpusim.export.field_catalogue import FieldMap
from gpusim.export.images import read_image
from gpusim.files.atomic_files import PathLike
from gpusim.report.html import fitting
from gpusim.report.model import Figure
from gpusim.report.style import MEASURED, TRUTH, axis_title, draw_png
from gpusim.validation import require

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure as Canvas

Frame = tuple[float, float, float, float]
"""Left, right, lower and upper border, px."""
Backdrop = tuple[Single, Frame]
"""A grey picture from 0 to 1, and where it lies."""

_PANEL = 2.3  # inches
_PICTURE_PX = 900  # width of the picture below a map
_AROUND = 0.1  # of a picture's longer side that maps show at least, of few points, too
_SHOWN = 0.01  # share of the values beyond either end of a colour bar
_BINS = 81


@dataclass(frozen=True)
class ComparedField:
    """A field at M points, with its unit in its ``title``: as it was ``measured``, as it is, and as
    subsets and windows see it."""

    title: str
    measured: Float
    true: Float
    levelled: Float


def draw_compared_fields(
    picture: PathLike, points: Float, fields: Sequence[ComparedField], title: str, path: PathLike
) -> Figure:
    """Each field measured, true, their difference, and how much of it the settings' smoothing is;
    at ``points`` (M, 2) px over a ``picture``, of which the part around them is shown.

    The first two share a scale, the last two another one with zero in its middle.
    """
    maps = []
    for one in fields:
        known = np.isfinite(one.measured)
        own = _range(np.concatenate([one.measured[known], one.true[known]]))
        off = one.measured - one.true
        most = max(np.abs(_range(off)))
        maps += [
            FieldMap(one.measured, f"{one.title}: measured", scale=own),
            FieldMap(np.where(known, one.true, np.nan), "true", scale=own),
            FieldMap(off, "measured less true", centred=True, scale=(-most, most)),
            FieldMap(np.where(known, one.levelled - one.true, np.nan), "smoothing", centred=True,
                     scale=(-most, most)),
        ]  # fmt: skip
    draw_panels(read_image(picture), points, maps, 4, path)
    caption = (
        "Measured and true at the same material points, in one scale; their difference, and beside "
        "it, in the same scale, how far subsets and strain windows smooth the truth."
    )
    return Figure(Path(path), title, caption, photo=True)


def draw_error_parts(
    picture: PathLike,
    points: Float,
    parts: Mapping[str, Float],
    quantities: Sequence[str],
    title: str,
    path: PathLike,
) -> Figure:
    """A row of maps for each part (M, Q) of an error, a column for each of the ``quantities``."""
    maps = [
        FieldMap(column, f"{name}: {quantity}", centred=True)
        for name, values in parts.items()
        for column, quantity in zip(values.T, quantities, strict=True)
    ]
    draw_panels(read_image(picture), points, maps, len(quantities), path)
    caption = (
        "Every map has a scale of its own, red and blue about zero where it has both signs; parts "
        "add up to the whole."
    )
    return Figure(Path(path), title, caption, photo=True)


def draw_panels(
    image: npt.NDArray[Any],
    points: Float,
    maps: Sequence[FieldMap],
    columns: int,
    path: PathLike,
    last: Callable[[Axes], None] | None = None,
) -> None:
    """Maps in rows of so many ``columns``, over the part of a picture (H, W) or (H, W, 3) around
    their ``points`` (M, 2) px; a ``last`` panel draws something else there."""
    backdrop, frame = grey_picture(image), _frame_of(points, _AROUND * max(image.shape[:2]))
    tall, wide = frame[2] - frame[3], frame[1] - frame[0]
    inches = float(np.clip(_PANEL * tall / wide, 0.9, 2.8))
    rows = -(-(len(maps) + (last is not None)) // columns)

    def draw(canvas: Canvas) -> None:
        panels = np.ravel(canvas.subplots(rows, columns, squeeze=False))
        for axes in panels:
            axes.set_axis_off()
        for axes, one in zip(panels, maps, strict=False):
            draw_map(axes, backdrop, points, one, alpha=1.0)
            axes.axis(frame)
        if last is not None:
            _draw_backdrop(panels[len(maps)], backdrop)
            last(panels[len(maps)])
            panels[len(maps)].axis(frame)

    draw_png(path, (columns * (_PANEL + 0.8), rows * (inches + 0.5)), draw)


def grey_picture(image: npt.NDArray[Any]) -> Backdrop:
    """A small grey copy from 0 to 1 of a picture (H, W) or (H, W, 3), and its frame: pixel centres
    are integers."""
    image = grey_of(image)
    height, width = image.shape
    low, high = np.nanquantile(image.astype(np.float64), [0.005, 0.995])
    grey = (image.astype(np.float32) - low) / ((high - low) or 1.0)
    size = fitting(image.shape, _PICTURE_PX)
    small = cv2.resize(np.nan_to_num(grey), size, interpolation=cv2.INTER_AREA)
    clipped = np.clip(small, 0, 1).astype(np.float32)
    return clipped, (-0.5, width - 0.5, height - 0.5, -0.5)


def draw_map(
    axes: Axes, backdrop: Backdrop | None, points: Float, one: FieldMap, **style: Any
) -> None:
    """Draw values at ``points`` (M, 2) px as a map with a colour bar, over a picture if there is
    one; ``style`` goes to what draws them. Limits of colours are those of the values."""
    from matplotlib.ticker import ScalarFormatter

    if backdrop is not None:
        _draw_backdrop(axes, backdrop)
    limited = {"norm", "vmin", "vmax"} & style.keys()
    one = one if limited else _readable(one)
    known = np.isfinite(one.values)
    if known.any():
        low, high = one.scale or _range(one.values)
        colours = "viridis"
        if one.centred and low < 0 < high:
            high = max(-low, high)
            low, colours = -high, "RdBu_r"
        norm = style.pop("norm", None) or _limits(style, low, high)
        style = {"cmap": colours, "norm": norm} | style
        shown = _lattice(points, one.values)
        if shown is not None:
            grid, extent = shown
            alpha = 0.85 if backdrop is not None else 1.0
            cells: dict[str, Any] = {"alpha": alpha, "interpolation": "nearest", "extent": extent}
            drawn: Any = axes.imshow(grid, **(cells | style))
        else:
            dots: dict[str, Any] = {"s": 14, "linewidths": 0} | style
            drawn = axes.scatter(points[known, 0], points[known, 1], c=one.values[known], **dots)
        bar = axes.figure.colorbar(drawn, ax=axes, shrink=0.9, pad=0.02, extend="both")
        bar.outline.set_visible(False)
        bar.ax.yaxis.set_major_formatter(ScalarFormatter(useOffset=False))
    axes.axis(backdrop[1] if backdrop is not None else _frame_of(points))
    axis_title(axes, one.title)


def _limits(style: dict[str, Any], low: float, high: float) -> Normalize:
    """Those of ``style``, which loses them, else ``low`` and ``high``. Raises InputError."""
    from matplotlib.colors import Normalize

    given = style.pop("vmin", None), style.pop("vmax", None)
    low, high = (
        one if one is not None else usual for one, usual in zip(given, (low, high), strict=True)
    )
    require(low < high, "plot: vmin, vmax", f"{low} and {high}", "growing numbers")
    return Normalize(low, high)


def _frame_of(points: Float, least: float = 0.0) -> Frame:
    """Around all points, with a margin, along either axis as much as is the ``least``; y down."""
    low, high = points.min(axis=0), points.max(axis=0)
    margin = 0.05 * float((high - low).max()) or 1.0
    x, y = np.maximum(margin, 0.5 * (least - (high - low)))
    return low[0] - x, high[0] + x, high[1] + y, low[1] - y


def _readable(one: FieldMap) -> FieldMap:
    """Small or large values with their power of ten in the title, not beside the colour bar."""
    known = np.abs(one.values[np.isfinite(one.values)])
    ends = one.scale or (np.quantile(known, 1.0 - _SHOWN) if known.size else 0.0,)
    most = float(max(map(abs, ends)))
    power = int(np.floor(np.log10(most))) if most > 0 else 0
    if -3 < power < 4:
        return one
    name, bracket, unit = one.title.partition(" (")
    raised = f"10$^{{{power}}}$"
    title = f"{name} ({raised} {unit}" if bracket else f"{name} ({raised})"
    scale = one.scale and (one.scale[0] / 10.0**power, one.scale[1] / 10.0**power)
    return replace(one, values=one.values / 10.0**power, title=title, scale=scale)


def _range(values: Float) -> tuple[float, float]:
    """Quantiles that colours span, so that rough borders hide nothing; wider than nothing."""
    known = values[np.isfinite(values)]
    ends = np.quantile(known, [_SHOWN, 1.0 - _SHOWN]) if known.size else (0.0, 0.0)
    low, high = map(float, ends)
    most = max(abs(low), abs(high))
    half = 0.0 if high - low > 1e-12 * max(most, 1e-12) else 0.5 * most or 0.5
    return low - half, high + half


def _draw_backdrop(axes: Axes, backdrop: Backdrop) -> None:
    picture, frame = backdrop
    axes.imshow(picture, cmap="gray", vmin=-0.15, vmax=1.1, extent=frame, aspect="equal")


def _lattice(points: Float, values: Float) -> tuple[Float, Frame] | None:
    """Values on a regular grid with its frame; None if the points don't lie on one."""
    x, column = np.unique(points[:, 0], return_inverse=True)
    y, row = np.unique(points[:, 1], return_inverse=True)
    if len(x) < 2 or len(y) < 2 or len(x) * len(y) > 4 * len(points):
        return None
    steps = np.concatenate([np.diff(x), np.diff(y)])
    if not np.ptp(steps) <= 1e-6 * steps.mean():
        return None
    grid = np.full((len(y), len(x)), np.nan)
    grid[row, column] = values
    half = 0.5 * float(steps.mean())
    return grid, (x[0] - half, x[-1] + half, y[-1] + half, y[0] - half)


def draw_differences(raw: Float, rest: Float, title: str, path: PathLike) -> Figure:
    """Histograms of errors (N,) px, and of what the settings' smoothing doesn't explain of them."""
    raw, rest = raw[np.isfinite(raw)], rest[np.isfinite(rest)]
    low, high = _range(np.concatenate([raw, rest]))
    edges = np.linspace(low, high, _BINS).tolist()

    def draw(canvas: Canvas) -> None:
        plot = canvas.subplots()
        plot.hist(raw, edges, histtype="stepfilled", alpha=0.35, color=MEASURED,
                  label="measured less true")  # fmt: skip
        plot.hist(rest, edges, histtype="step", linewidth=1.5, color=TRUTH,
                  label="beyond the settings' smoothing")  # fmt: skip
        plot.set(xlabel="Difference (px)", ylabel="Values")
        plot.legend(loc="best")
        axis_title(plot, "Differences of displacements in the pictures")

    draw_png(path, (7.2, 3.6), draw)
    spread = [float(np.sqrt(np.mean(one**2))) if one.size else float("nan") for one in (raw, rest)]
    caption = f"RMS {spread[0]:.2g} px, of which {spread[1]:.2g} px aren't the settings' smoothing."
    return Figure(Path(path), title, caption)
