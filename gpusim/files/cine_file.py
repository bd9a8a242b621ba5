"""Vision Research's recordings (.cine): frames as they are stored, with the time of each.

After the file's header come a Windows bitmap header, the camera's settings, tagged blocks, of which
one has the times, and a table of where each frame stands. All numbers are little-endian.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError, require
from gpusim.files.input_file import open_input
from gpusim.files.picture_file import LARGEST
from gpusim.files.raw_frames import RawFrames, frame_bytes
from gpusim.files.recording import Image, Recording

_PACKED = {256: 10, 1024: 12}
"""Bits of a packed pixel, by the bitmap's "compression"."""
_JPEG = 1
_LENGTH, _FRAME_RATE, _MOSAIC = 142, 768, 808
"""Where it stands in the settings: their length, frames a second, the colour filter."""
_TIMES = 1002
"""The tag of their block."""
_SECOND = 2.0**32
_MOST_BLOCKS = 1000


def read_cine(path: Path) -> Recording:
    """The recording in a .cine. Raises InputError for a damaged file, and for JPEG inside."""
    with open_input(path, "a recording of Vision Research") as stream:
        try:
            return _recording(path, stream)
        except struct.error as error:
            raise InputError(f"video: {path}: cut off; got {error}; expected a .cine") from None


def _recording(path: Path, stream: BinaryIO) -> Recording:
    head = _numbers(stream, 0, "2s3HiIiI3IQ")
    magic, compression, first, count = head[0], head[2], head[6], head[7]
    bitmap, settings, table, trigger = head[8:]
    where = f"video: {path}"
    require(magic == b"CI", where, f"a file that begins with {magic!r}", "a .cine")
    require(compression != _JPEG, where, "frames in JPEG", "uncompressed or packed ones")
    _, width, height, _, pixel_bits, packing = _numbers(stream, bitmap, "IiiHHI")
    known = pixel_bits in (8, 16, 24, 48) and packing in (0, *_PACKED)
    fits = width > 0 and height != 0 and width * abs(height) <= LARGEST
    got = f"{width} x {height} px of {pixel_bits} bits, packed as {packing}"
    require(known and fits, where, got, "8, 10, 12 or 16 bits, in grey or colour")
    color = pixel_bits >= 24
    bits = _PACKED.get(packing, pixel_bits // 3 if color else pixel_bits)
    shape = (abs(height), width, 3) if color else (abs(height), width)
    starts = _starts(stream, table, count, frame_bytes(shape, bits))
    there = len(starts)
    require(there > 0, where, f"no whole frame of {count}", "at least one")
    notes = [f"{path}: is cut off: {there} frames of {count}"] if there < count else []
    (mosaic,) = _numbers(stream, settings + _MOSAIC, "I")
    if mosaic and not color:
        notes.append(f"{path}: shows the mosaic of a colour filter, as the sensor has it")
    if bits == 10:
        notes.append(f"{path}: its 10 bits are codes of a curve, not proportional to light")
    clock, guess = _clock(stream, settings, table, there), ""
    times = (clock - np.uint64(trigger)).view(np.int64) / _SECOND
    if len(times) < there or not (np.diff(times) > 0).all():
        (rate,) = _numbers(stream, settings + _FRAME_RATE, "I")
        require(rate > 0, where, "neither times nor a frame rate", "one of them")
        times = (first + np.arange(there)) / rate
        guess = f"{path}: times are guessed: {rate} frames a second"
    read = RawFrames(path, shape, bits, starts).frame
    rows, channels = slice(None, None, -1 if height > 0 == packing else 1), slice(None, None, -1)

    def frame(number: int) -> Image:
        image = read(number)[rows]  # a bitmap's begin at the bottom, with blue first
        return np.ascontiguousarray(image[..., channels] if color else image)

    return Recording(frame, times, guess, tuple(notes))


def _starts(stream: BinaryIO, table: int, count: int, size: int) -> npt.NDArray[np.int64]:
    """Where the pixels of frames begin, after notes that say their own length; of those before the
    first that isn't in the file as a whole."""
    end = stream.seek(0, 2)
    starts: list[int] = []
    for number in range(min(count, end // 8)):
        try:
            (offset,) = _numbers(stream, table + 8 * number, "Q")
            (before,) = _numbers(stream, min(offset, end), "I")
        except struct.error:
            break
        if offset + before + size > end:
            break
        starts.append(offset + before)
    return np.array(starts, np.int64)


def _clock(stream: BinaryIO, settings: int, end: int, count: int) -> npt.NDArray[np.uint64]:
    """When each frame was taken, in 2^-32 s, if it stands in the file."""
    (length,) = _numbers(stream, settings + _LENGTH, "H")
    at = settings + length
    for _ in range(_MOST_BLOCKS):
        if not at < end:
            break
        size, tag = _numbers(stream, at, "IH")
        if tag == _TIMES:
            stream.seek(at + 8)
            data = stream.read(8 * count)
            return np.frombuffer(data[: len(data) // 8 * 8], "<u8")
        at += max(size, 8)
    return np.empty(0, np.uint64)


def _numbers(stream: BinaryIO, at: int, form: str) -> tuple[Any, ...]:
    """Little-endian numbers at a place. Raises struct.error behind the end of the file."""
    stream.seek(at)
    return struct.unpack(f"<{form}", stream.read(struct.calcsize(f"<{form}")))
