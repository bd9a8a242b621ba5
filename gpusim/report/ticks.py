"""Round numbers along an axis, and how they are written."""

from __future__ import annotations

import math
from dataclasses import dataclass

__all__ = ["Ticks", "decades", "round_ticks"]

_STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_PLAIN = range(-3, 5)  # powers of ten that are written out


@dataclass(frozen=True)
class Ticks:
    """``places`` on the axis, their ``labels``, and the power of ten these leave to the axis."""

    places: tuple[float, ...]
    labels: tuple[str, ...]
    power: int = 0

    def on(self, label: str) -> str:
        """The axis's ``label`` with that power."""
        return label if not self.power else f"{label} \u00d7 {_ten(self.power)}"


def round_ticks(low: float, high: float, most: int, whole: bool = False) -> Ticks:
    """At most ``most`` round numbers from ``low`` to ``high``, whole ones if ``whole``."""
    span = high - low
    power = math.floor(math.log10(span / most))
    step = next(
        s * 10.0**power for s in (*_STEPS, 20.0) if span / (s * 10.0**power) <= most
    )  # fmt: skip
    if whole:
        step = max(1.0, math.ceil(step))
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    places = [k * step for k in range(first, last + 1)]
    largest = max((abs(place) for place in places), default=0.0) or 1.0
    scale = math.floor(math.log10(largest))
    scale = 0 if scale in _PLAIN else scale
    unit = step / 10.0**scale
    digits = next(
        (k for k in range(7) if abs(unit * 10**k - round(unit * 10**k)) < 1e-6 * unit * 10**k), 7
    )
    labels = [f"{place / 10.0**scale + 0.0:.{digits}f}".replace("-", "\u2212") for place in places]
    return Ticks(tuple(places), tuple(labels), scale)


def decades(low: float, high: float, most: int) -> Ticks:
    """Powers of ten between the logarithms ``low`` and ``high``."""
    first, last = math.ceil(low - 1e-9), math.floor(high + 1e-9)
    step = max(1, math.ceil((last - first + 1) / most))
    places = range(first, last + 1, step)
    return Ticks(tuple(map(float, places)), tuple(map(_ten, places)))


def _ten(power: int) -> str:
    return "10" + str(power).translate(_SUPERSCRIPT)
