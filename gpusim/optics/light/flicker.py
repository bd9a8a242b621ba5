"""Light that varies in time: lamps on the mains, and lamps that are switched on and off quickly."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float
from gpusim.validation import Finite, Portion, Positive, Share, checked


@checked
@dataclass(frozen=True)
class Flicker:
    """How a lamp's light varies about its mean, which is the power that the lamp has.

    Without ``duty`` by the factor 1 + ``modulation`` cos(2 pi ``frequency`` t + ``phase``): a lamp
    on mains of 50 Hz has 100 Hz. With it by pulse-width modulation: 1 / duty in the first ``duty``
    of each period, else 0; frequencies are in Hz, phases in rad. What `photograph` sees is the mean
    over the exposure, in closed form, row by row where the shutter rolls; `render` shows the mean
    light.

    Examples
    --------
    >>> lamp = gs.Flicker(frequency=100.0, modulation=0.3)
    >>> print(f"{lamp.mean(0.0, 0.0):.3f} {lamp.mean(0.0, 0.002):.3f} {lamp.mean(0.0, 0.01):.3f}")
    1.300 1.227 1.000
    >>> print(gs.Flicker(frequency=1000.0, duty=0.4).mean(0.0, 0.0002))
    2.5
    """

    frequency: Positive
    modulation: Share = 1.0
    duty: Portion | None = None
    phase: Finite = 0.0

    def mean(self, start: Float | float, stop: Float | float) -> Float:
        """Mean factor between instants (s; arrays broadcast), or at one where both are equal.

        Examples
        --------
        >>> print(f"{gs.Flicker(frequency=100.0).mean(0.0, 0.0025):.4f}")  # 1 + 2 / pi
        1.6366
        """
        first = self._periods(start)
        periods = self.frequency * (np.asarray(stop) - start)
        if self.duty is None:
            middle = np.cos(2.0 * np.pi * (first + 0.5 * periods))
            factor = 1.0 + self.modulation * np.sinc(periods) * middle
        else:
            first, long = first - np.floor(first), periods > 0.0
            lit = self._lit(first + periods, self.duty) - self._lit(first, self.duty)
            share = np.where(long, lit / np.where(long, periods, 1.0), first < self.duty)
            factor = share / self.duty
        return np.asarray(np.maximum(factor, 0.0))  # where it was rounded

    def switches(self, start: float, stop: float) -> Float:
        """Instants (s) in between at which the light is switched on or off."""
        if self.duty is None:
            return np.zeros(0)
        first, last = self._periods(np.array([start, stop]))
        whole = np.arange(np.floor(first), last)
        times = (np.append(whole, whole + self.duty) - self._periods(0.0)) / self.frequency
        return np.asarray(times[(times > start) & (times < stop)])

    def later(self, seconds: float) -> Flicker:
        """The same, by a clock that starts so many s later."""
        turns = self.frequency * seconds % 1.0
        return replace(self, phase=self.phase + 2.0 * np.pi * turns)

    def _periods(self, time: npt.ArrayLike) -> Any:
        """Periods (turns) that have passed at a time."""
        return self.frequency * np.asarray(time) + self.phase / (2.0 * np.pi)

    @staticmethod
    def _lit(periods: Float, duty: float) -> Any:
        """In how many of so many periods, whole ones or not, it was lit."""
        whole = np.floor(periods)
        return whole * duty + np.minimum(periods - whole, duty)
