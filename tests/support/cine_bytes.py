"""A recording of Vision Research, byte by byte after the description of the format."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

TRIGGER = (1_700_000_000 << 32) + (1 << 31)
SETTINGS = 1000
"""Bytes of the settings; those of a camera are longer, and mean the same here."""


def packed(numbers: npt.NDArray[Any], bits: int) -> bytes:
    """Numbers of so many bits one after the other, the highest bit first, by Python's integers."""
    text = "".join(f"{number:0{bits}b}" for number in numbers.ravel().tolist())
    text += "0" * (-len(text) % 8)
    return int(text, 2).to_bytes(len(text) // 8, "big")


def cine_bytes(
    frames: Sequence[npt.NDArray[Any]],
    *,
    bits: int = 8,
    times: Sequence[float] | None = None,
    rate: int = 4000,
    first: int = -2,
    note: bytes = b"",
) -> bytes:
    """A file of frames (H, W) or (H, W, 3); ``bits`` 10 and 12 are packed.

    ``times`` are s after the trigger, ``note`` is what a camera writes before each frame.
    """
    height, width = frames[0].shape[:2]
    color = frames[0].ndim == 3
    packing = {10: 256, 12: 1024}.get(bits, 0)
    pixel_bits = (16 if packing else bits) * (3 if color else 1)
    settings = bytearray(SETTINGS)
    struct.pack_into("<HH", settings, 140, 0x5453, SETTINGS)
    struct.pack_into("<I", settings, 768, rate)
    blocks = struct.pack("<IHH", 12, 1000, 0) + b"text"
    if times is not None:
        clock = [TRIGGER + round(time * 2**32) for time in times]
        blocks += struct.pack(f"<IHH{len(clock)}Q", 8 + 8 * len(clock), 1002, 0, *clock)
    table = 44 + 40 + SETTINGS + len(blocks)
    pixels = []
    for frame in frames:
        if packing:
            pixels.append(packed(frame, bits))
        else:
            turned = frame[::-1, :, ::-1] if color else frame[::-1]  # rows from below, BGR
            pixels.append(turned.astype(f"<u{bits // 8}").tobytes())
    before = struct.pack("<I", 8 + len(note)) + note
    bodies = [before + struct.pack("<I", len(data)) + data for data in pixels]
    starts = np.cumsum([table + 8 * len(frames), *map(len, bodies[:-1])])
    head = struct.pack("<2s3HiIiI3IQ", b"CI", 44, 0, 1, first, len(frames), first, len(frames),
                       44, 84, table, TRIGGER)  # fmt: skip
    bitmap = struct.pack("<IiiHHIIiiII", 40, width, height, 1, pixel_bits, packing,
                         len(pixels[0]), 0, 0, 0, 0)  # fmt: skip
    return b"".join([head, bitmap, settings, blocks, starts.astype("<i8").tobytes(), *bodies])
