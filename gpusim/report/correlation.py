"""The summary of a correlation: numbers per image, maps over the picture, and a page with both."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import ScalarFormatter

from gpusim._version import __version__
from gpusim.arrays.array_types import Float, Single
from gpusim.arrays.grey import grey_of
from gpusim.export.field_catalogue import FieldMap, field_maps
from gpusim.files.atomic_files import PathLike
from gpusim.measure import DicResult, Status, StereoResult, StrainResult
from gpusim.report.html import fitting, page_template
from gpusim.report.model import Figure
from gpusim.report.style import BAD, axis_title, draw_png
from gpusim.report.text import number
from gpusim.validation import require

Frame = tuple[float, float, float, float]
"""Left, right, lower and upper border, px."""
Backdrop = tuple[Single, Frame]
"""A grey picture from 0 to 1, and where it lies."""

_COLUMNS = {
    "image": "image",
    "time_s": "taken at (s)",
    "measured": "measured",
    "points": "points",
    "u_mean": "mean u (px)",
    "v_mean": "mean v (px)",
    "motion_max": "most motion (px)",
    "sigma_median": "sigma, median (px)",
    "U_mean": "mean U (mm)",
    "V_mean": "mean V (mm)",
    "W_mean": "mean W (mm)",
    "motion_max_mm": "most motion (mm)",
    "sigma_median_mm": "sigma, median (mm)",
    "residual_median": "epipolar residual, median (px)",
    "zncc_median": "correlation, median",
    "e1_max": "most strain",
    "e2_min": "least strain",
    "seconds": "time (s)",
}

_PICTURE = "Displacements in pixels of the reference image, x right, y down."
_SPACE = (
    "Places and displacements in mm in the frame of the left camera: x right, y down, z forward."
)
DIGITS = 4


def summary(
    image: str, result: DicResult | StereoResult, strain: StrainResult | None, seconds: float
) -> dict[str, Any]:
    """What one image, or pair, gave, in numbers that JSON can hold; None where nothing was
    measured. Lengths in space are in mm, and sigma is that along the worst axis."""
    ok = result.ok
    moved, sigma = result.displacement[ok], result.sigma[ok]
    if isinstance(result, StereoResult):
        axes, unit, quality, sigma = "UVW", "_mm", "residual", sigma.max(axis=1)
    else:
        axes, unit, quality = "uv", "", "zncc"
    values: dict[str, Any] = {
        "image": image,
        "points": len(ok),
        "measured": int(ok.sum()),
        "counts": result.counts(),
    }
    values |= {f"{axis}_mean": _known(np.mean, moved[:, k]) for k, axis in enumerate(axes)}
    values |= {
        f"motion_max{unit}": _known(np.max, np.linalg.norm(moved, axis=1)),
        f"sigma_median{unit}": _known(np.median, sigma),
        f"{quality}_median": _known(np.median, getattr(result, quality)[ok]),
    }
    if strain is not None:
        e1, e2 = strain.principal[strain.ok].T
        # quantiles: a single point at a rough border isn't the strain of the piece
        values |= {
            "e1_max": _known(np.quantile, e1, 0.995),
            "e2_min": _known(np.quantile, e2, 0.005),
            "strain_gauge_px": strain.gauge_px,
        }
    return values | {"seconds": round(seconds, 3)}


def correlation_page(
    title: str,
    rows: Sequence[Mapping[str, Any]],
    figures: Sequence[tuple[str, Figure]],
    settings: Mapping[str, Any],
    warnings: Sequence[str] = (),
) -> str:
    """One self-contained page of all images; raises InputError if a figure can't be read."""
    keys = [key for key in _COLUMNS if any(key in row for row in rows)]
    count = sum(row["measured"] for row in rows)
    total = sum(row["points"] for row in rows)
    return page_template("correlation.html.j2").render(
        title=title,
        version=__version__,
        lead=f"{len(rows)} image{'s' if len(rows) != 1 else ''}, "
        f"{count} of {total} points measured.",
        names=[_COLUMNS[key] for key in keys],
        rows=[[_cell(row.get(key)) for key in keys] for row in rows],
        figures=figures,
        warnings=warnings,
        footer=_SPACE if any("W_mean" in row for row in rows) else _PICTURE,
        settings=[
            (key, f"{value:g}" if isinstance(value, float) else _cell(value))
            for key, value in settings.items()
        ],
    )


def _cell(value: Any) -> str:
    if value is None:
        return "-"
    return number(value, DIGITS) if isinstance(value, float) else str(value)


def _known(statistic: Callable[..., Any], values: Float, *options: float) -> float | None:
    """A statistic of values; None where there are none."""
    return float(statistic(values, *options)) if values.size else None


_PICTURE_PX = 900  # width of the picture below a map
SHOWN = 0.02  # share of the values beyond the ends of a colour bar, at each end
_PANEL = 3.6  # inches
_STATUS = {
    Status.OUTSIDE: "#9aa5b1",
    Status.NO_TEXTURE: "#e69f00",
    Status.NOT_CONVERGED: "#cc79a7",
    Status.LOW_CORRELATION: BAD,
    Status.NO_GUESS: "#7a5195",
    Status.MASKED: "#56b4e9",
    Status.SATURATED: "#f0e442",
    Status.EPIPOLAR: "#009e73",
    Status.INCOHERENT: "#8c564b",
}


def draw_maps(
    image: npt.NDArray[Any],
    result: DicResult | StereoResult,
    strain: StrainResult | None,
    path: PathLike,
) -> Figure:
    """Draw displacements, in space with the shape, the strains if any, and what is missing over
    the reference, the left one of a pair.

    Colours span the 2 to 98 % quantiles, so that rough borders don't hide the rest.
    """
    names = ("Z", "U", "V", "W") if isinstance(result, StereoResult) else ("u", "v")
    if strain is None and not isinstance(result, StereoResult):
        names = (*names, "sigma")
    maps = list(field_maps(result, names).values())
    if strain is not None:
        strains = field_maps(strain, ("exx", "eyy", "exy")).items()
        maps += [replace(one, title=f"{name}, {strain.kind}") for name, one in strains]
    backdrop = grey_picture(image)
    columns = 2 if len(maps) < 4 else 3 if len(maps) < 6 else 4
    rows = -(-(len(maps) + 1) // columns)
    height, width = image.shape
    tall = float(np.clip(_PANEL * height / width, 1.2, 6.0))

    def draw(canvas: Canvas) -> None:
        panels = np.ravel(canvas.subplots(rows, columns, squeeze=False))
        for axes in panels:
            axes.set_axis_off()
        for axes, one in zip(panels, maps, strict=False):
            draw_map(axes, backdrop, result.points, one)
        _draw_missing(panels[len(maps)], backdrop, result)

    draw_png(path, (columns * (_PANEL + 0.9), rows * (tall + 0.55)), draw)
    counts = ", ".join(f"{number} {_said(name)}" for name, number in result.counts().items())
    caption = f"Over the reference image; {counts}."
    if strain is not None:
        caption += f" Virtual strain gauge {strain.gauge_px:.0f} px."
    return Figure(Path(path), "Measured fields", caption, photo=True)


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
    axes: Axes,
    backdrop: Backdrop | None,
    points: Float,
    one: FieldMap,
    **style: Any,
) -> None:
    """Draw values at ``points`` (M, 2) px as a map with a colour bar, over a picture if there is
    one; ``style`` goes to what draws them. Limits of colours are those of the values."""
    if backdrop is not None:
        _draw_backdrop(axes, backdrop)
    limited = {"norm", "vmin", "vmax"} & style.keys()
    one = one if limited else _readable(one)
    known = np.isfinite(one.values)
    if known.any():
        low, high = (float(v) for v in np.quantile(one.values[known], [SHOWN, 1 - SHOWN]))
        if not high - low > 1e-12 * max(abs(low), abs(high), 1e-12):
            low, high = low - 0.5e-6, high + 0.5e-6
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
    given = style.pop("vmin", None), style.pop("vmax", None)
    low, high = (
        one if one is not None else usual for one, usual in zip(given, (low, high), strict=True)
    )
    require(low < high, "plot: vmin, vmax", f"{low} and {high}", "growing numbers")
    return Normalize(low, high)


def _frame_of(points: Float) -> Frame:
    """Around all points, with a margin; y down."""
    low, high = points.min(axis=0), points.max(axis=0)
    margin = 0.05 * float((high - low).max()) or 1.0
    return low[0] - margin, high[0] + margin, high[1] + margin, low[1] - margin


def _readable(one: FieldMap) -> FieldMap:
    """Small or large values with their power of ten in the title, not beside the colour bar."""
    known = np.abs(one.values[np.isfinite(one.values)])
    most = float(np.quantile(known, 1 - SHOWN)) if known.size else 0.0
    power = int(np.floor(np.log10(most))) if most > 0 else 0
    if -3 < power < 4:
        return one
    name, bracket, unit = one.title.partition(" (")
    raised = f"10$^{{{power}}}$"
    title = f"{name} ({raised} {unit}" if bracket else f"{name} ({raised})"
    return replace(one, values=one.values / 10.0**power, title=title)


def _draw_missing(
    axes: Axes,
    backdrop: Backdrop,
    result: DicResult | StereoResult,
) -> None:
    _draw_backdrop(axes, backdrop)
    for status, colour in _STATUS.items():
        there = result.status == status
        if there.any():
            label = f"{_said(status.name)} ({int(there.sum())})"
            axes.plot(*result.points[there].T, "s", color=colour, markersize=3, label=label)
    if (~result.ok).any():
        axes.legend(loc="upper right", fontsize=7, frameon=True, framealpha=0.85, markerscale=2)
    axes.axis(backdrop[1])
    axis_title(axes, f"not measured: {int((~result.ok).sum())} of {result.ok.size}")


def _said(status: str) -> str:
    return "measured" if status == "OK" else status.lower().replace("_", " ")


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
