"""What measurements are given: pictures, and what was found in them already."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy.typing as npt

from gpusim.measure.targets.boards import Sighting
from gpusim.pipeline.measurements.marker_cache import MarkerCache

__all__ = ["Sources"]


@dataclass(frozen=True)
class Sources:
    """``image`` gives a camera's picture in a frame, ``corners`` what was found of the board in a
    calibration pose, ``markers`` tracks those of a rig."""

    image: Callable[[str, int], npt.NDArray[Any]]
    corners: Callable[[str, int], Sighting]
    markers: MarkerCache
