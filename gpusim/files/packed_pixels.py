"""Pixels of 10 and 12 bits, of which high-speed cameras store several in a few bytes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

WHOLE = {8: "u1", 16: "<u2"}
PACKED = (10, 12)


def pixels_of(data: npt.NDArray[np.uint8], bits: int) -> npt.NDArray[Any]:
    """The numbers of ``bits`` bits each in bytes, the highest bit first; of 16 the low byte.

    Examples
    --------
    >>> pixels_of(np.array([0x12, 0x34, 0x56], np.uint8), 12)
    array([ 291, 1110], dtype=uint16)
    """
    if bits in WHOLE:
        return data.view(WHOLE[bits])
    width = math.lcm(bits, 8) // 8
    padded = np.append(data, np.zeros(-len(data) % width, np.uint8))
    groups = padded.reshape(-1, width).astype(np.uint16)
    numbers = np.empty((len(groups), 8 * width // bits), np.uint16)
    for k in range(numbers.shape[1]):
        byte, bit = divmod(k * bits, 8)  # 10 and 12 bits never reach into a third byte
        pair = groups[:, byte] << 8 | groups[:, byte + 1]
        numbers[:, k] = (pair >> (16 - bits - bit)) & ((1 << bits) - 1)
    return numbers.ravel()


def packed_size(count: int, bits: int) -> int:
    """Bytes of ``count`` pixels."""
    return -(-count * bits // 8)
