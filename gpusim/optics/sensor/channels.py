"""What the channels of a sensor see: a frame's planes, weighted by sensitivities in their bands."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.optics.frame import Band, Frame
from gpusim.optics.lens.convolution import Target, accumulate, accumulate_twin
from gpusim.optics.sensor.demosaicing import TILES
from gpusim.validation import real_numbers

Weights = tuple[float, ...]
"""Of the planes of a frame."""
_ONE = (1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0)
_THREE = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def check_sensitivities(given: object, several: bool) -> tuple[Weights, ...]:
    """Sensitivities in the bands, of one channel or of three; what is usual for None.

    Raises InputError.
    """
    if given is None:
        return _THREE if several else (_ONE,)
    values = real_numbers(given, "Sensor sensitivities")
    shape = (3, 3) if several else (3,)
    good = np.isfinite(values).all() and (values >= 0.0).all()
    if not (good and values.shape == shape and (values.max(axis=-1, initial=0.0) > 0.0).all()):
        expected = (
            "3 rows (red, green, blue channel) of 3 numbers (bands) from 0, none of them all zero"
            if several
            else "3 numbers (bands) from 0, not all zero; (3, 3) is for colour"
        )
        raise InputError(f"Sensor sensitivities; got {values.tolist()}; expected {expected}")
    return tuple(tuple(float(v) for v in row) for row in values.reshape(-1, 3))


def weights_of(sensitivities: Weights, frame: Frame) -> Weights:
    """Of the frame's planes: a grey one stands for all three bands."""
    return sensitivities if frame.coloured else (sum(sensitivities),)


@contextmanager
def seen(frame: Frame, weights: Weights) -> Iterator[Frame]:
    """The grey frame that a channel of these weights sees; a sum of planes is there inside the
    ``with`` block only."""
    used = [(plane, w) for plane, w in zip(frame.planes, weights, strict=True) if w]
    device = frame.device
    if len(used) == 1 and used[0][1] == 1.0:
        yield used[0][0]
        return
    if device is None or not all(plane.bands for plane, _ in used):  # by the twin, or released
        sums = np.zeros((frame.height, frame.width))
        for plane, weight in used:
            sums = accumulate_twin(sums, plane.radiance, weight)
        yield Frame(frame.view, None, radiance=sums.astype(np.float32))
        return
    bands = tuple(Band.of(device, b.row0, b.rows, b.stride) for b in used[0][0].bands)
    with device.recording("optics.channels") as recording:
        for band in bands:
            recording.clear(band.buffer)
    for plane, weight in used:
        for source, band in zip(plane.bands, bands, strict=True):
            accumulate(device, source.buffer, source.stride, (band.rows, frame.width),
                       Target(band.buffer, 0, band.stride), weight=weight)  # fmt: skip
    sum_frame = Frame(frame.view, device, bands)
    try:
        yield sum_frame
    finally:
        sum_frame.release()


def picked(images: Sequence[npt.NDArray[Any]], bayer: str) -> npt.NDArray[Any]:
    """A mosaic: of the images (H, W) of red, green and blue, each pixel that of its filter."""
    if images[0] is images[1] is images[2]:
        return images[0]
    result = np.empty_like(images[0])
    for place, channel in enumerate(TILES[bayer]):
        at = np.s_[place // 2 :: 2, place % 2 :: 2]
        result[at] = images[channel][at]
    return result
