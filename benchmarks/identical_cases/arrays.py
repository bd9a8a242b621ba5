"""What cases give."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

import gpusim as gs

Arrays = Mapping[str, npt.NDArray[Any]]
Case = Callable[[], Arrays]


def fields(result: Any, *names: str) -> Arrays:
    """Some numbers of a result."""
    return {name: np.asarray(getattr(result, name)) for name in names}


def radiance_of(frame: gs.Frame) -> Arrays:
    """What a frame shows; its device memory is given back."""
    result = fields(frame, "radiance")
    frame.release()
    return result
