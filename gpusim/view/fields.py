"""Fields of a solution by name: their values, unit and range, and the legend of their colours."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.surface import Skin
from gpusim.validation import require_one_of
from gpusim.view.content.body_state import BodyState
from gpusim.view.field_colors import SurfaceField
from gpusim.view.overlay import INK, PAPER, Overlay

SEQUENTIAL, DIVERGING = "viridis", "coolwarm"
"""Colour maps of matplotlib: for fields of one sign and of both."""
OUTSIDE = 0.2
"""Per cent of the values that may lie beyond either end of a scale, such as stress in corners."""


def _fem() -> Any:
    """The solver: half a second to import, which a window without fields doesn't need."""
    from gpusim import fem

    return fem


UNITS = {"mm": 1e3, "MPa": 1e-6, "10⁻³": 1e3, "%": 1e2}
"""Of fields: how many there are in one of SI."""


@dataclass(frozen=True, eq=False)
class FieldKind:
    """A field that can be shown.

    ``title`` and ``unit`` for the legend; ``of``: in SI, (N,) of nodes, or of elements (M,) where
    it is ``by_cell``, or ``component`` k of (N, K).
    """

    title: str
    unit: str
    of: Callable[[BodyState], Float]
    component: int | None = None
    by_cell: bool = False

    def values(self, state: BodyState) -> Float:
        """(N,) or (M,) in ``unit``. Raises InputError where the body hasn't this field."""
        values = self.of(state)
        return UNITS[self.unit] * (values if self.component is None else values[:, self.component])

    @property
    def signed(self) -> bool:
        """Whether both signs occur: zero is in the middle of the colours then."""
        return self.component is not None

    @property
    def label(self) -> str:
        """What stands over the legend."""
        return f"{self.title} ({self.unit})"


def _components(
    name: str, title: str, unit: str, of: Callable[[BodyState], Float], components: str
) -> dict[str, FieldKind]:
    """A field for each component of a vector or tensor."""
    return {
        f"{name}_{component}": FieldKind(f"{title} {component}", unit, of, k)
        for k, component in enumerate(components.split())
    }


_AXES = "xx yy zz xy yz zx"
FIELDS = {
    "displacement": FieldKind("Displacement", "mm", lambda state: state.length),
    **_components("displacement", "Displacement", "mm", lambda state: state.u, "x y z"),
    "von_mises": FieldKind("von Mises stress", "MPa", lambda s: _fem().von_mises(s.stress)),
    **_components("principal_stress", "Principal stress", "MPa",
                  lambda state: _fem().principal(state.stress), "1 2 3"),
    **_components("stress", "Stress", "MPa", lambda state: state.stress, _AXES),
    **_components("principal_strain", "Principal strain", "10⁻³",
                  lambda state: _fem().principal(state.strain), "1 2 3"),
    **_components("strain", "Strain", "10⁻³", lambda state: state.strain, _AXES),
    "element_von_mises": FieldKind("von Mises stress of elements", "MPa",
                                   lambda state: state.recovered.cell_von_mises, by_cell=True),
    "error_share": FieldKind("Share of the stress error", "%",
                             lambda state: state.recovered.error_share, by_cell=True),
}  # fmt: skip
"""By the name that users write."""


def field_kind(name: str) -> FieldKind:
    """The field of a name.

    Raises
    ------
    InputError
        There is none; all are listed.

    Examples
    --------
    >>> from gpusim.view.fields import field_kind
    >>> field_kind("von_mises").unit
    'MPa'
    """
    require_one_of("field", name, FIELDS)
    return FIELDS[name]


def surface_field(skin: Skin, kind: FieldKind, values: Float) -> SurfaceField:
    """A field's ``values`` of nodes or elements, on the body's surface."""
    if kind.by_cell:
        return SurfaceField(values[skin.cell_of_piece], by_face=True)
    return SurfaceField(skin.at_vertices(values))


@dataclass(frozen=True)
class ColorScale:
    """From ``low`` to ``high`` in colours of ``colormap`` (matplotlib's name), with ``ticks``.

    ``below``, ``above``: whether there are values beyond the ends.
    """

    low: float
    high: float
    ticks: tuple[float, ...]
    colormap: str = SEQUENTIAL
    below: bool = False
    above: bool = False

    @property
    def limits(self) -> tuple[float, float]:
        """Both ends."""
        return self.low, self.high

    @property
    def colors(self) -> Float:
        """(256, 3), as sRGB has them."""
        return color_map(self.colormap)


@cache
def color_map(name: str) -> Float:
    """(256, 3) colours of one of matplotlib's maps, 0 to 1 as sRGB has them."""
    from matplotlib import colormaps  # a second's work, which a window without fields needs not

    return np.asarray(colormaps[name](np.linspace(0.0, 1.0, 256)), np.float64)[:, :3]


def scale_of(values: Sequence[Float], signed: bool = False) -> ColorScale:
    """Round limits and ticks for the values of several bodies.

    All but a few values lie between the limits, which are rounded outwards, from 0 if that is not
    far, and symmetric if values are ``signed`` and of both signs.

    Examples
    --------
    >>> from gpusim.view.fields import scale_of
    >>> scale_of([np.linspace(0.3, 37.0, 50)]).ticks
    (0.0, 10.0, 20.0, 30.0, 40.0)
    """
    from matplotlib.ticker import MaxNLocator

    every = np.concatenate([np.zeros(0), *(v[np.isfinite(v)] for v in values)])
    shares = [0.0, OUTSIDE, 100.0 - OUTSIDE, 100.0]
    least, low, high, most = np.percentile(every if len(every) else [0.0], shares).tolist()
    both = signed and least < 0.0 < most
    if both:
        high = max(abs(low), abs(high))
        low = -high
    elif 0.0 <= low < 0.5 * high or (high <= 0.0 and high > 0.5 * low):
        low, high = min(low, 0.0), max(high, 0.0)
    if not high - low > 1e-9 * max(abs(low), abs(high)):
        low, high = min(low, 0.0), max(high, 0.0) if high else 1.0
    locator = MaxNLocator(5, steps=[1, 2, 2.5, 5, 10])
    ticks = np.asarray(locator.tick_values(low, high), np.float64)
    low, high = float(ticks[0]), float(ticks[-1])
    slack = 1e-9 * (high - low)
    marks = tuple(float(tick) + 0.0 for tick in ticks)
    name = DIVERGING if both else SEQUENTIAL
    return ColorScale(low, high, marks, name, least < low - slack, most > high + slack)


def format_value(value: float, step: float | None = None) -> str:
    """A number for people: as many digits as ``step`` has, or four.

    Examples
    --------
    >>> from gpusim.view.fields import format_value
    >>> format_value(2.5, 0.5), format_value(12.3456)
    ('2.5', '12.35')
    """
    size = max(abs(value), step or 0.0)
    if size and not 1e-3 <= size < 1e5:
        mantissa, _, power = f"{value:.3e}".partition("e")
        digits = str(int(power)).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
        text = f"{mantissa.rstrip('0').rstrip('.')}×10{digits}" if value else "0"  # noqa: RUF001
    elif step is None:
        text = f"{value:.4g}"
    else:
        text = f"{value:.{max(0, min(6, -int(np.floor(np.log10(step) + 1e-9)) + 1))}f}"
        text = text.rstrip("0").rstrip(".") if "." in text else text
    return text.replace("-", "−")  # noqa: RUF001


def _labels(scale: ColorScale) -> list[str]:
    """What stands at the ticks."""
    step = float(np.diff(scale.ticks).min()) if len(scale.ticks) > 1 else None
    return [format_value(tick, step) for tick in scale.ticks]


def legend_width(overlay: Overlay, scale: ColorScale, title: str, size: float) -> float:
    """Of what `draw_legend` draws, px."""
    beside = max((overlay.text_width(label, size) for label in _labels(scale)), default=0.0)
    bar = round(1.2 * size) + round(0.45 * size) + 6 + beside
    return float(round(2 * round(0.8 * size) + max(overlay.text_width(title, size), bar)))


def draw_legend(
    overlay: Overlay,
    scale: ColorScale,
    title: str,
    right: float,
    y: float,
    height: float,
    size: float,
) -> tuple[float, float]:
    """The bar of colours with its ticks and title; returns the width and height it takes, px.

    (right, y): top right corner; ``height``: of the bar; ``size``: of the letters. Values beyond
    an end are told by a tip there.
    """
    wide = legend_width(overlay, scale, title, size)
    x, y, height = round(right - wide), round(y), round(height)
    pad, bar, tip = round(0.8 * size), round(1.2 * size), round(0.7 * size)
    mark = round(0.45 * size)
    tall = 2 * pad + round(1.8 * size) + height + 2 * tip
    overlay.rectangle(x, y, wide, tall, PAPER)
    overlay.text(x + pad, y + pad, title, size, INK)
    left, top = x + pad, y + pad + round(1.8 * size) + tip
    colors = scale.colors
    rows = (np.arange(height)[::-1] + 0.5) / height * (len(colors) - 1)
    corners = np.array([[left, 0.0], [left + bar, 0.0], [left + bar, 1.0], [left, 1.0]])
    strips = corners + np.stack([np.zeros(height), top + np.arange(height)], axis=1)[:, None]
    shades = np.ones((height, 4))
    shades[:, :3] = colors[np.rint(rows).astype(int)]
    overlay.polygons(strips.astype(np.float64), shades)
    middle = left + 0.5 * bar
    if scale.above:
        overlay.polygon([(left, top), (middle, top - tip), (left + bar, top)], tuple(colors[-1]))
    if scale.below:
        end = top + height
        overlay.polygon([(left, end), (left + bar, end), (middle, end + tip)], tuple(colors[0]))
    for tick, label in zip(scale.ticks, _labels(scale), strict=True):
        share = (scale.high - tick) / (scale.high - scale.low)
        at = top + min(max(round(share * height - 0.5), 0), height - 1)
        overlay.rectangle(left + bar, at, mark, 1, INK)
        overlay.text(left + bar + mark + 5, at + 0.5, label, size, INK, anchor="lm")
    return wide, float(tall)
