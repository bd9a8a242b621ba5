"""Frames that cameras store as the sensor gave them: uncompressed, 10 and 12 bits often packed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.errors import require
from gpusim.files.recording import Image

WHOLE = {8: "u1", 16: "<u2"}
BITS = (8, 10, 12, 16)


@dataclass(frozen=True)
class RawFrames:
    """Where frames of a ``shape`` begin in a file, and how many bits a number has."""

    path: Path
    shape: tuple[int, ...]
    bits: int
    starts: npt.NDArray[np.int64]

    def frame(self, number: int) -> Image:
        """Frame ``number``. Raises InputError if the file has become shorter."""
        size = frame_bytes(self.shape, self.bits)
        data = np.fromfile(self.path, np.uint8, size, offset=int(self.starts[number]))
        where = f"video: {self.path}: frame {number + 1}"
        require(len(data) == size, where, f"{len(data)} bytes", f"{size}: the file was changed")
        return pixels_of(data, self.bits)[: math.prod(self.shape)].reshape(self.shape)


def frame_bytes(shape: tuple[int, ...], bits: int) -> int:
    """Bytes of a frame whose numbers have so many bits."""
    return -(-math.prod(shape) * bits // 8)


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
