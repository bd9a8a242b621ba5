"""Colour scales: round limits and ticks for values, and the colours between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from gpusim.arrays.array_types import Float

SEQUENTIAL, DIVERGING = "viridis", "coolwarm"
"""Colour maps of matplotlib: for fields of one sign and of both."""
OUTSIDE = 0.2
"""Per cent of the values that may lie beyond either end of a scale, such as stress in corners."""


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


def scale_of(
    values: Sequence[Float], signed: bool = False, limits: tuple[float, float] | None = None
) -> ColorScale:
    """Round limits and ticks for the values of several bodies.

    All but a few values lie between the limits, which are rounded outwards, from 0 if that is not
    far, and symmetric if values are ``signed`` and of both signs. ``limits``: these and no others.

    Examples
    --------
    >>> from gpusim.visualization.color_scale import scale_of
    >>> scale_of([np.linspace(0.3, 37.0, 50)]).ticks
    (0.0, 10.0, 20.0, 30.0, 40.0)
    """
    from matplotlib.ticker import MaxNLocator

    every = np.concatenate([np.zeros(0), *(v[np.isfinite(v)] for v in values)])
    shares = [0.0, OUTSIDE, 100.0 - OUTSIDE, 100.0]
    least, low, high, most = np.percentile(every if len(every) else [0.0], shares).tolist()
    both = signed and least < 0.0 < most
    if limits is not None:
        low, high = limits
        both = signed and low == -high
    elif both:
        high = max(abs(low), abs(high))
        low = -high
    elif 0.0 <= low < 0.5 * high or (high <= 0.0 and high > 0.5 * low):
        low, high = min(low, 0.0), max(high, 0.0)
    if not high - low > 1e-9 * max(abs(low), abs(high)):
        low, high = min(low, 0.0), max(high, 0.0) if high else 1.0
    locator = MaxNLocator(5, steps=[1, 2, 2.5, 5, 10])
    ticks = np.asarray(locator.tick_values(low, high), np.float64)
    if limits is None:
        low, high = float(ticks[0]), float(ticks[-1])
    slack = 1e-9 * (high - low)
    marks = tuple(float(tick) + 0.0 for tick in ticks if low - slack <= tick <= high + slack)
    name = DIVERGING if both else SEQUENTIAL
    return ColorScale(low, high, marks, name, least < low - slack, most > high + slack)


def format_value(value: float, step: float | None = None) -> str:
    """A number for people: as many digits as ``step`` has, or four.

    Examples
    --------
    >>> from gpusim.visualization.color_scale import format_value
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


def value_text(value: float, unit: str) -> str:
    """A number and its unit, "1" for none, for people.

    Examples
    --------
    >>> from gpusim.visualization.color_scale import value_text
    >>> value_text(0.25, "MPa"), value_text(0.25, "10⁻³"), value_text(0.25, "1")
    ('0.25 MPa', '0.25·10⁻³', '0.25')
    """
    if unit == "1":
        return format_value(value)
    return f"{format_value(value)}{'·' if unit.startswith('10') else ' '}{unit}"
