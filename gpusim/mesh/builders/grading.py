"""Node coordinates along one axis: exact at every break, fine where asked, growing in between."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt

__all__ = ["graded_axis", "stepped_axis"]

Float = npt.NDArray[np.float64]

_GROWTH = 0.25  # the size grows by a quarter of the distance: neighbours differ by about 1.28
_SAMPLES = 4000


def stepped_axis(breaks: Sequence[float], size: float, fixed: Mapping[int, int]) -> Float:
    """Coordinates (K,) that meet every break exactly; about ``size`` apart in each piece, or with
    the count of steps that ``fixed`` gives for the piece's number."""
    parts: list[Float] = []
    for number, (start, end) in enumerate(pairwise(breaks)):
        count = fixed.get(number) or max(1, round((end - start) / size))
        # start + i*step keeps neighbouring elements congruent; the end comes from the next piece
        parts.append(start + (end - start) * np.arange(count) / count)
    return np.concatenate([*parts, [breaks[-1]]])


def graded_axis(breaks: Sequence[float], sizes: Sequence[float], size: float) -> Float:
    """Coordinates (K,) that meet every break exactly, fine near the breaks with a small size.

    Parameters
    ----------
    breaks
        Growing coordinates, both ends included.
    sizes
        The wanted step at each break, any number up to infinity; steps grow from there by 28 % a
        step up to ``size``.
    """
    wanted = np.minimum(np.asarray(sizes, dtype=np.float64), size)
    parts: list[Float] = []
    for (start, end), (first, last) in zip(pairwise(breaks), pairwise(wanted), strict=True):
        length = end - start
        place = np.linspace(0.0, 1.0, _SAMPLES + 1)
        step = np.minimum(first + _GROWTH * length * place, last + _GROWTH * length * place[::-1])
        rate = length / np.minimum(step, size)  # steps per unit of place
        total = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]))]) / _SAMPLES
        # a rounding above a whole number must not cost another step
        count = max(1, int(np.ceil(total[-1] - 1e-9)))
        steps = np.arange(count) / count
        if min(first, last) < size:
            steps = np.interp(steps * total[-1], total, place)
        parts.append(start + length * steps)
    return np.concatenate([*parts, [breaks[-1]]])
