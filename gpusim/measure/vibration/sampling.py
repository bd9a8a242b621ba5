"""Pictures of one size, and the rate that their times keep."""

from __future__ import annotations

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import InputError
from gpusim.files.frame_source import FrameSource
from gpusim.measure.images import Image, check_image

JITTER = 0.05  # of an interval by which a picture may be early or late


def sampling_rate(times: Float) -> float:
    """Pictures a second, Hz. Raises InputError if times (T,) are unknown or uneven."""
    if len(times) < 2 or not np.isfinite(times).all():
        raise InputError(
            "times: not known of every picture; expected them from the file, --rate-hz, or "
            "read_frames(frames, times=...), s"
        )
    interval = (times[-1] - times[0]) / (len(times) - 1)
    even = times[0] + interval * np.arange(len(times))
    late = np.abs(times - even).max()
    if not (interval > 0 and late <= JITTER * interval):
        raise InputError(
            f"times: got intervals of {np.diff(times).min():.6g} to {np.diff(times).max():.6g} s; "
            "expected even ones"
        )
    return float(1.0 / interval)


def picture_alike(source: FrameSource, number: int, first: Image) -> Image:
    """A picture of the size of the first. Raises InputError for another."""
    picture, name = check_image(source[number], source.names[number]), source.names[number]
    if picture.shape != first.shape:
        raise InputError(f"{name}: got shape {picture.shape}; expected {first.shape} as before")
    return picture
