"""Letters as small grey pictures, drawn by Pillow from the DejaVu Sans that comes with matplotlib.

Each is drawn once for every size that is asked for, in whole pixels and fitted to these (hinted):
at 12 to 24 px that is sharper than one size that is scaled.
"""

from __future__ import annotations

from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont

_RANGES = ((0x20, 0x7F), (0xA0, 0x180), (0x391, 0x3A2), (0x3A3, 0x3CA), (0x2190, 0x2196))
_SIGNS = "–—‘’“”•…′″‰⁰⁴⁵⁶⁷⁸⁹⁺⁻₀₁₂₃₄₅₆₇₈₉∂∆∇∑−√∞∠∥⊥≈≠≤≥▲▶▼◀■□●○✓✗"  # noqa: RUF001
CHARACTERS = "".join(chr(code) for first, stop in _RANGES for code in range(first, stop)) + _SIGNS
"""Those that there are letters for: Latin with its accents, Greek, signs."""

_KNOWN = frozenset(CHARACTERS)
_BOX = ""


class Glyph(NamedTuple):
    """A letter in an atlas: ``first`` byte of its coverage, its size and place, px.

    ``left``, ``top``: of its picture from the pen on the base line; ``advance`` of the pen.
    """

    first: int
    width: int
    height: int
    left: int
    top: int
    advance: float


class GlyphAtlas:
    """Coverage (0 to 255) of letters, one picture after the other, row by row.

    Examples
    --------
    >>> from gpusim.view.glyphs import GlyphAtlas
    >>> atlas = GlyphAtlas()
    >>> glyph = atlas.glyph("g", 14)
    >>> bool(atlas.coverage[: glyph.width * glyph.height].max() > 200), glyph.top < 0
    (True, True)
    """

    def __init__(self) -> None:
        self._coverage = bytearray()
        self._glyphs: dict[tuple[str, int], Glyph] = {}

    @property
    def coverage(self) -> npt.NDArray[np.uint8]:
        """Of all letters that were asked for; it only grows."""
        return np.frombuffer(bytes(self._coverage), np.uint8)

    def glyph(self, character: str, size: int) -> Glyph:
        """A letter of a size (px, the font's em); a box for one that there is none of."""
        known = character if character in _KNOWN else _BOX
        if (known, size) not in self._glyphs:
            self._glyphs[known, size] = self._drawn(known, size)
        return self._glyphs[known, size]

    def width(self, line: str, size: int) -> float:
        """How far the pen goes, px."""
        return sum(self.glyph(character, size).advance for character in line)

    def ascent(self, size: int) -> int:
        """Height of capital letters above the base line, px."""
        return -self.glyph("H", size).top

    def _drawn(self, character: str, size: int) -> Glyph:
        if character == _BOX:
            picture, left, top = _box(size)
            advance = float(picture.shape[1] + 2)
        else:
            font = _font(size)
            picture, left, top = _letter(font, character)
            advance = font.getlength(character)
        rows, columns = picture.shape
        first = len(self._coverage)
        self._coverage += picture.tobytes()
        return Glyph(first, columns, rows, left, top, advance)


def _letter(font: ImageFont.FreeTypeFont, character: str) -> tuple[npt.NDArray[np.uint8], int, int]:
    left, top, right, bottom = (int(side) for side in font.getbbox(character, anchor="ls"))
    if not (right > left and bottom > top):
        return np.zeros((0, 0), np.uint8), left, top
    picture = Image.new("L", (right - left, bottom - top))
    ImageDraw.Draw(picture).text((-left, -top), character, 255, font, anchor="ls")
    return np.asarray(picture), left, top


def _box(size: int) -> tuple[npt.NDArray[np.uint8], int, int]:
    rows, columns = max(round(0.73 * size), 3), max(round(0.5 * size), 3)
    picture = np.full((rows, columns), 255, np.uint8)
    picture[1:-1, 1:-1] = 0
    return picture, 1, -rows


@cache
def _font(size: int) -> ImageFont.FreeTypeFont:
    # importing matplotlib takes longer than the window's first picture may
    found = find_spec("matplotlib")
    assert found is not None and found.submodule_search_locations
    (folder,) = found.submodule_search_locations
    path = Path(folder) / "mpl-data" / "fonts" / "ttf" / "DejaVuSans.ttf"
    return ImageFont.truetype(str(path), size, layout_engine=ImageFont.Layout.BASIC)
