"""What was measured in pictures: maps of displacement and strain."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float
from gpusim.errors import InputError, nearest_name
from gpusim.export.measured_fields import field_maps
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
    from gpusim.report.correlation import draw_map, grey_picture

    known = field_maps(result)
    name = next(iter(known)) if component is None else component
    if name not in known:
        hint = nearest_name(name, known)
        raise InputError(
            f"{type(result).__name__}.plot: component; got {name!r}; expected one of "
            f"{list(known)}{hint}"
        )
    mapped = isinstance(result, MappedResult)
    if image is not None:
        _check_picture(f"{type(result).__name__}.plot: image", image, result.points, mapped)
    ax = flat_axes(ax)
    backdrop = None if image is None else grey_picture(image)
    draw_map(ax, backdrop, result.points, known[name], **style)
    unit = "unit of the mapping" if mapped else "px"
    ax.set(xlabel=f"x ({unit})", ylabel=f"y ({unit})", aspect="equal")
    ax.grid(visible=False)
    return ax


def _check_picture(what: str, image: npt.NDArray[Any], points: Float, mapped: bool) -> None:
    """Refuse a picture that the points can't have been measured in."""
    if mapped:
        raise InputError(f"{what}; got one beside points in the mapping's unit; expected None")
    picture = np.asarray(image)
    colored = picture.ndim == 3 and picture.shape[2] == 3
    if not (picture.ndim == 2 or colored) or picture.dtype.kind not in "buif":
        raise InputError(
            f"{what}; got shape {picture.shape}, {picture.dtype}; expected (H, W) or (H, W, 3)"
        )
    (height, width), (right, low) = picture.shape[:2], points.max(axis=0)
    if not (right <= width - 1 and low <= height - 1):
        raise InputError(
            f"{what}; got {width} x {height} px; expected the reference picture: points reach "
            f"x = {right:g}, y = {low:g}"
        )


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
