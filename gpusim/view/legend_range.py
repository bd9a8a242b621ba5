"""Which values the legend of a field reaches over: those of a frame, of all frames, or held."""

from __future__ import annotations

from collections.abc import Callable, Hashable

from gpusim.arrays.array_types import Float
from gpusim.view.content.field_values import FieldValues
from gpusim.visualization.color_scale import ColorScale, scale_of

KINDS = ("frame", "held", "frames")
SAID = {
    "frame": "legend: as far as each frame's values reach",
    "held": "legend: held as it is",
    "frames": "legend: as far as the values of all frames reach",
}
FAR, APART = 1e30, 1e-6
"""Most that limits may be, and how far they are apart, of the larger one: what float32 tells."""


def is_range(low: float, high: float) -> bool:
    """Whether a legend can reach from one value to another.

    Examples
    --------
    >>> from gpusim.view.legend_range import is_range
    >>> is_range(-1.0, 2.5), is_range(2.0, 2.0), is_range(-1e308, 1e308)
    (True, False, False)
    """
    far = max(abs(low), abs(high))
    return far <= FAR and high - low >= max(1.0 / FAR, APART * far)


class LegendRange:
    """The range of a legend; ``kind``: one of `KINDS`.

    Limits are held for all fields of one unit.

    Examples
    --------
    >>> from gpusim.view.legend_range import LegendRange
    >>> LegendRange().step()
    'legend: held as it is'
    """

    def __init__(self) -> None:
        self.kind = "frame"
        self._limits: tuple[float, float] | None = None
        self._of: Hashable = None

    def step(self) -> str:
        """The next kind, in words."""
        self.kind = KINDS[(KINDS.index(self.kind) + 1) % len(KINDS)]
        self._of = None
        return SAID[self.kind]

    def hold(self, unit: str, low: float, high: float) -> None:
        """These limits from now on, of fields of a unit."""
        self.kind, self._limits, self._of = "held", (low, high), unit

    def scale(
        self, field: FieldValues, frames: Callable[[], list[Float]], of: Hashable
    ) -> ColorScale:
        """The colours of a field; ``frames``: its values in all of them, asked for where ``of``,
        what they depend on, has changed."""
        signed, of = field.field.signed, field.field.unit if self.kind == "held" else of
        if self.kind == "frame":
            return scale_of(field.legend, signed)
        if self._of != of:
            every = frames() if self.kind == "frames" else field.legend
            self._of, self._limits = of, scale_of(every, signed).limits
        return scale_of(field.legend, signed, self._limits)
