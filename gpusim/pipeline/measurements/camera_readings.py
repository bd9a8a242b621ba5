"""What one camera reads off places that are exactly right, with one effect of its view after the
other: readings that follow each other differ by what this effect does, and the parts add up.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import pairwise
from typing import TypeVar

from gpusim.arrays.array_types import Float
from gpusim.optics.camera.pinhole import Camera

Reading = TypeVar("Reading")


def camera_readings(
    camera: Camera, within: Float, moved: Float, read: Callable[[Camera, Float], Reading]
) -> tuple[Reading, Reading, Reading]:
    """What is ``read``, through a lens, of the motion ``within`` a plane (M, 3) without distortion,
    of the whole motion ``moved`` (M, 3) without it, and of that through ``camera`` as it is."""
    ideal = camera.without_distortion()
    return read(ideal, within), read(ideal, moved), read(camera, moved)


def steps(readings: Mapping[str, Float]) -> dict[str, Float]:
    """What each of the ``readings`` but the first, the truth, has more than the one before."""
    return {
        name: reading - before
        for (_, before), (name, reading) in pairwise(readings.items())
    }  # fmt: skip
