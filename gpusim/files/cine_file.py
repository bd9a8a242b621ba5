"""Vision Research's recordings (.cine): frames as they are stored, with the time of each.

After the file's header come a Windows bitmap header, the camera's settings, tagged blocks, of which
one has the times, and a table of where each frame stands. All numbers are little-endian.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError, require
from gpusim.files.input_file import open_input
from gpusim.files.packed_pixels import packed_size, pixels_of
from gpusim.files.picture_file import LARGEST
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
_NOTE = 8  # bytes at least, before a frame's pixels


@dataclass(frozen=True)
class _Frames:
    """Where frames stand, and how their pixels are stored."""

    path: Path
    offsets: npt.NDArray[np.int64]
    shape: tuple[int, ...]
    bits: int
    bottom_up: bool

    @property
    def size(self) -> int:
        """Bytes of the pixels of a frame."""
        return packed_size(int(np.prod(self.shape)), self.bits)

    def __getitem__(self, number: int) -> Image:
        offset = int(self.offsets[number])
        with open_input(self.path, "a recording") as stream:
            (before,) = _numbers(stream, offset, "I")  # notes, which say their own length
            stream.seek(offset + before)
            data = np.frombuffer(stream.read(self.size), np.uint8)
        got = f"{len(data)} bytes"
        where = f"video: {self.path}: frame {number + 1}: damaged"
        require(len(data) == self.size, where, got, f"{self.size}")
        image = pixels_of(data, self.bits)[: int(np.prod(self.shape))].reshape(self.shape)
        image = image[::-1] if self.bottom_up else image
        return np.ascontiguousarray(image[..., ::-1] if image.ndim == 3 else image)


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
    end = stream.seek(0, 2)
    stream.seek(table)
    offsets = np.frombuffer(stream.read(8 * min(count, (end - min(table, end)) // 8)), "<i8")
    frames = _Frames(path, offsets, shape, bits, height > 0 == packing)
    whole = np.append((offsets > 0) & (offsets <= end - frames.size - _NOTE), False)
    there = int(np.argmin(whole))
    require(there > 0, where, f"no whole frame of {count}", "at least one")
    notes = [f"{path}: is cut off: {there} frames of {count}"] if there < count else []
    (mosaic,) = _numbers(stream, settings + _MOSAIC, "I")
    if mosaic and not color:
        notes.append(f"{path}: shows the mosaic of a colour filter, as the sensor has it")
    if bits == 10:
        notes.append(f"{path}: its 10 bits are codes of a curve, not proportional to light")
    clock, guess = _clock(stream, settings, table, there), ""
    if clock is not None:
        times = (clock - np.uint64(trigger)).view(np.int64) / _SECOND
    else:
        (rate,) = _numbers(stream, settings + _FRAME_RATE, "I")
        require(rate > 0, where, "neither times nor a frame rate", "one of them")
        times = (first + np.arange(there)) / rate
        guess = f"{path}: times are guessed: {rate} frames a second"
    return Recording(frames.__getitem__, times, guess, tuple(notes))


def _clock(stream: BinaryIO, settings: int, end: int, count: int) -> npt.NDArray[np.uint64] | None:
    """When each frame was taken, in 2^-32 s; None if it doesn't stand in the file."""
    (length,) = _numbers(stream, settings + _LENGTH, "H")
    at = settings + length
    for _ in range(_MOST_BLOCKS):
        if not at < end:
            return None
        size, tag = _numbers(stream, at, "IH")
        if tag == _TIMES:
            stream.seek(at + 8)
            data = stream.read(8 * count)
            return np.frombuffer(data, "<u8") if len(data) == 8 * count else None
        at += max(size, 8)
    return None


def _numbers(stream: BinaryIO, at: int, form: str) -> tuple[Any, ...]:
    """Little-endian numbers at a place. Raises struct.error behind the end of the file."""
    stream.seek(at)
    return struct.unpack(f"<{form}", stream.read(struct.calcsize(f"<{form}")))
