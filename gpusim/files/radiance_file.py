"""Radiance pictures (.hdr, .pic): the radiances, whatever their header says was done to them.

Their numbers were multiplied by every EXPOSURE and COLORCORR of the header. CIE XYZ, and colours of
other PRIMARIES, become those of sRGB: white stays white, and luminances stay the same. Rows and
columns may lie in any of eight orders.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float, Single

_LINES = re.compile(
    rb"#\?[^\n]*\n(?P<lines>(?:[^\n]+\n)*)[ \t\r]*\n"
    rb"(?P<first>[-+][XY]) +(?P<major>\d{1,9}) +(?P<second>[-+][XY]) +(?P<minor>\d{1,9})\r?\n"
)
_LONGEST = 1 << 16
_SRGB = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)
_XYZ = (1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1 / 3, 1 / 3)
"""x and y of red, green, blue and white."""


@dataclass(frozen=True)
class RadianceHeader:
    """What it says; ``first`` and ``second`` axis have their signs, as ``-Y`` and ``+X``."""

    values: tuple[tuple[str, str], ...]
    first: str
    second: str
    scan_lines: int
    line_length: int
    pixels: bytes
    """All behind the header."""

    @classmethod
    def of(cls, data: bytes) -> RadianceHeader | None:
        """None for other files. Raises ValueError for axes that aren't two."""
        found = _LINES.match(data[:_LONGEST])
        if found is None:
            return None
        first, second = found["first"].decode(), found["second"].decode()
        if first[1] == second[1]:
            raise ValueError(f"axes {first} and {second}")
        lines = found["lines"].decode("latin-1").splitlines()
        values = tuple((key.strip(), value.strip()) for key, _, value in
                       (line.partition("=") for line in lines))  # fmt: skip
        return cls(values, first, second, int(found["major"]), int(found["minor"]),
                   data[found.end() :])  # fmt: skip

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, as it claims."""
        sizes = self.scan_lines, self.line_length
        return sizes if self.first[1] == "X" else sizes[::-1]

    def plain(self) -> bytes:
        """A file of the same numbers that says nothing of them, its rows from the top."""
        size = f"-Y {self.scan_lines} +X {self.line_length}\n"
        return b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n" + size.encode() + self.pixels

    def radiances(self, numbers: Single) -> Single:
        """Of the ``numbers`` (H, W, 3) in `plain`, red, green and blue as in the file.

        Raises ValueError for entries that are no such numbers, or another format.
        """
        divisor = np.ones(3)
        for entry in self._entries("EXPOSURE", 1) + self._entries("COLORCORR", 3):
            divisor = divisor * entry
        if not (divisor > 0.0).all():
            raise ValueError(f"EXPOSURE and COLORCORR of {divisor}")
        formats = {value for key, value in self.values if key == "FORMAT"} or {"32-bit_rle_rgbe"}
        primaries = [_XYZ] if formats == {"32-bit_rle_xyze"} else self._entries("PRIMARIES", 8)
        if not formats <= {"32-bit_rle_rgbe", "32-bit_rle_xyze"} or len(formats) > 1:
            raise ValueError(f"FORMAT={', '.join(sorted(formats))[:60]}")
        picture = np.divide(numbers, divisor, dtype=np.float32)
        if primaries:  # what sRGB hasn't got would be below 0
            picture = np.maximum(picture @ to_srgb(primaries[-1]).T.astype(np.float32), 0.0)
        if self.first[1] == "X":
            picture = picture.transpose(1, 0, 2)
        axes = self.first, self.second
        return picture[:: -1 if "+Y" in axes else 1, :: -1 if "-X" in axes else 1]

    def _entries(self, key: str, count: int) -> list[Float]:
        entries = [np.array(value.split(), float) for name, value in self.values if name == key]
        for entry in entries:
            if len(entry) != count or not math.isfinite(float(np.abs(entry).sum())):
                raise ValueError(f"{key} of {entry}; {count} numbers are due")
        return entries


def to_srgb(primaries: npt.ArrayLike) -> Float:
    """(3, 3): to linear red, green and blue of sRGB from those of other ``primaries``, x and y of
    red, green, blue and white; white becomes white."""
    matrix: Float = np.linalg.inv(_over_white(_SRGB)) @ _over_white(primaries)
    return matrix


def _over_white(primaries: npt.ArrayLike) -> Float:
    """(3, 3) from red, green and blue to X, Y and Z, each in parts of white's."""
    x, y = np.asarray(primaries, float).reshape(4, 2).T
    columns = np.stack([x, y, 1.0 - x - y])
    over_white: Float = columns[:, :3] / columns[:, 3:]
    result: Float = over_white * np.linalg.solve(over_white, np.ones(3))
    return result
