"""Round numbers, for scales that people read."""

from __future__ import annotations

import numpy as np


def round_down(value: float) -> float:
    """The largest of …, 0.5, 1, 2, 5, 10, 20, … that isn't above ``value`` > 0.

    Examples
    --------
    >>> from gpusim.arrays.round_numbers import round_down
    >>> round_down(0.3), round_down(87.0)
    (0.2, 50.0)
    """
    power = 10.0 ** np.floor(np.log10(value))
    return float(max(step * power for step in (1.0, 2.0, 5.0) if step * power <= value * 1.000001))
