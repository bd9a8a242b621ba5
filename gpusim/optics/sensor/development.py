"""From a sensor's raw numbers to the picture: white balance, demosaicing, gamma.

The raw numbers have 16 bits, whatever the picture has, as those of cameras have more than their
pictures; what is made of them is rounded once.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Bool, Single
from gpusim.arrays.srgb import encoded
from gpusim.optics.sensor.demosaicing import TILES, demosaiced
from gpusim.validation import real_numbers, require

RAW_BITS = 16
RAW_FULL = 2**RAW_BITS - 1
_ROWS = 64  # at a time: what a curve needs meanwhile isn't held for a whole picture


@dataclass(frozen=True)
class Development:
    """``black``: the black level as a share of full scale; ``gains`` of red, green and blue above
    it; the others as of `gpusim.optics.sensor.sensor.Sensor`."""

    bits: int
    black: float
    gains: tuple[float, float, float]
    bayer: str | None
    demosaic: str | None
    gamma: float | str

    def picture(self, raw: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """The picture, uint8 or uint16, of raw numbers (H, W) or (H, W, 3): (H, W, 3) where a
        mosaic is demosaiced, else of their shape."""
        share = raw * np.float32(1.0 / RAW_FULL)
        if self.gains != (1.0, 1.0, 1.0):
            share -= np.float32(self.black)
            for part, gain in self._channels(share):
                part *= np.float32(gain)
            share += np.float32(self.black)
            np.clip(share, 0.0, 1.0, out=share)
        if self.bayer is not None and self.demosaic is not None:
            share = demosaiced(share, self.bayer, self.demosaic)
            np.clip(share, 0.0, 1.0, out=share)
        full = np.float32(2**self.bits - 1)
        result = np.empty(share.shape, np.uint8 if self.bits <= 8 else np.uint16)
        for row in range(0, len(share), _ROWS):
            rows = slice(row, row + _ROWS)
            result[rows] = np.rint(stored(share[rows], self.gamma) * full)
        return result

    def _channels(self, share: Single) -> Iterator[tuple[Single, float]]:
        """What belongs to a channel, and its gain."""
        if share.ndim == 3:
            for channel, gain in enumerate(self.gains):
                yield share[..., channel], gain
        else:
            for place, channel in enumerate(TILES[self.bayer or ""]):
                yield share[place // 2 :: 2, place % 2 :: 2], self.gains[channel]


def at_least(image: npt.NDArray[Any], tops: npt.NDArray[Any]) -> Bool:
    """Which pixels of an image reach those of a tile ``tops``, (2, 2) or (2, 2, 3)."""
    if (tops == tops.flat[0]).all():
        return np.asarray(image >= tops.flat[0])
    result = np.empty(image.shape, np.bool_)
    for row, column in np.ndindex(2, 2):
        at = np.s_[row::2, column::2]
        result[at] = image[at] >= tops[row, column]
    return result


def check_gains(given: object, filtered: bool) -> tuple[float, float, float]:
    """Gains of a white balance; ``filtered``: whether pixels see colours. Raises InputError."""
    gains = real_numbers(given, "Sensor white_balance")
    fits = gains.shape == (3,) and np.isfinite(gains).all() and (gains > 0.0).all()
    require(fits, "Sensor white_balance", given, "gains of red, green and blue above 0")
    got = f"{given} with channels 'mono'"
    require(filtered, "Sensor white_balance", got, "channels 'rgb' or a bayer pattern")
    red, green, blue = gains.tolist()
    return red, green, blue


def stored(share: Single, gamma: float | str) -> Single:
    """Shares of full scale, 0 to 1, as they are stored: share^(1 / gamma), or by the curve of sRGB
    (IEC 61966-2-1)."""
    if gamma == "srgb":
        return encoded(share)
    return share if gamma == 1.0 else share ** np.float32(1.0 / float(gamma))
