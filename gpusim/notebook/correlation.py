"""What was measured in pictures: maps of displacement and strain."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float
from gpusim.errors import nearest_name, require
from gpusim.export.field_catalogue import field_maps
from gpusim.measure import DicResult, MappedResult, StereoResult, StrainResult
from gpusim.notebook.axes import flat_axes
from gpusim.notebook.page import Picture, page, quantity, span
from gpusim.report.style import drawn

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Result = DicResult | StereoResult | MappedResult | StrainResult
_DPI = 110
_INCHES = 5.4


def html(result: Result) -> str:
    """How many points were measured, why not the others, extremes; a map."""
    known = int(result.ok.sum())
    rows = [("points measured", f"{known:,} of {result.ok.size:,}")]
    if not isinstance(result, StrainResult):
        lost = {name: count for name, count in result.counts().items() if name != "OK"}
        if lost:
            text = ", ".join(f"{n:,} {name.lower().replace('_', ' ')}" for name, n in lost.items())
            rows.append(("not measured", text))
        rows.append(("width of subsets", quantity(result.subset, "px", 3)))
    else:
        rows.append(("strain", result.kind))
        rows.append(("virtual strain gauge", quantity(result.gauge_px, "px", 3)))
    for component in field_maps(result).values():
        rows.append((component.title, span(component.values)))
    title = type(result).__name__
    return page(title, rows, [partial(_picture, result)] if known else [])


def plot(
    result: Result,
    ax: Axes | None,
    *,
    component: str | None = None,
    image: npt.NDArray[Any] | None = None,
    **style: Any,
) -> Axes:
    """A map of one component, over the reference ``image`` where one is given."""
    from gpusim.report.field_maps import draw_map, grey_picture

    known, where = field_maps(result), f"{type(result).__name__}.plot"
    name = next(iter(known)) if component is None else component
    expected = f"one of {list(known)}{nearest_name(name, known)}"
    require(name in known, f"{where}: component", repr(name), expected)
    mapped = isinstance(result, MappedResult)
    if image is not None:
        _check_picture(f"{where}: image", image, result.points, mapped)
    ax = flat_axes(ax)
    backdrop = None if image is None else grey_picture(image)
    draw_map(ax, backdrop, result.points, known[name], **style)
    unit = "unit of the mapping" if mapped else "px"
    ax.set(xlabel=f"x ({unit})", ylabel=f"y ({unit})", aspect="equal")
    ax.grid(visible=False)
    return ax


def _check_picture(what: str, image: npt.NDArray[Any], points: Float, mapped: bool) -> None:
    """Refuse a picture that the points can't have been measured in."""
    require(not mapped, what, "one beside points in the mapping's unit", "None")
    picture = np.asarray(image)
    grey_or_color = picture.ndim == 2 or (picture.ndim == 3 and picture.shape[2] == 3)
    known, got = picture.dtype.kind in "buif", f"shape {picture.shape}, {picture.dtype}"
    require(grey_or_color and known, what, got, "(H, W) or (H, W, 3)")
    (height, width), (right, low) = picture.shape[:2], points.max(axis=0)
    inside = right <= width - 1 and low <= height - 1
    expected = f"the reference picture: points reach x = {right:g}, y = {low:g}"
    require(inside, what, f"{width} x {height} px", expected)


def _picture(result: Result) -> Picture:
    names = list(field_maps(result))[:2]
    low, high = result.points.min(axis=0), result.points.max(axis=0)
    wide, tall = np.maximum(high - low, 1e-9)
    # side by side, or one above the other where they are wide
    across = 1 if wide > 1.7 * tall else 2
    inches = _INCHES if across == 1 else 0.62 * _INCHES
    height = float(np.clip(inches * 0.8 * tall / wide, 1.0, 4.5)) + 0.7

    def draw(canvas: Any) -> None:
        panels = canvas.subplots(2 // across, across, squeeze=False).ravel()
        for ax, name in zip(panels, names, strict=True):
            plot(result, ax, component=name)

    size = inches * across, height * (2 // across)
    pixels = drawn(size, draw, dpi=_DPI)
    return Picture("maps of what was measured", pixels, shown_width=pixels.shape[1] * 9 // 10)
