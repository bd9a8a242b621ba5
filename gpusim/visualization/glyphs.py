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
    >>> from gpusim.visualization.glyphs import GlyphAtlas
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
        """A letter of a size (px, the font's em); the font's box for one that it hasn't."""
        if (character, size) not in self._glyphs:
            self._glyphs[character, size] = self._drawn(character, size)
        return self._glyphs[character, size]

    def width(self, line: str, size: int) -> float:
        """How far the pen goes, px."""
        return sum(self.glyph(character, size).advance for character in line)

    def ascent(self, size: int) -> int:
        """Height of capital letters above the base line, px."""
        return -self.glyph("H", size).top

    def _drawn(self, character: str, size: int) -> Glyph:
        font = _font(size)
        picture, left, top = _letter(font, character)
        rows, columns = picture.shape
        first = len(self._coverage)
        self._coverage += picture.tobytes()
        return Glyph(first, columns, rows, left, top, font.getlength(character))


def _letter(font: ImageFont.FreeTypeFont, character: str) -> tuple[npt.NDArray[np.uint8], int, int]:
    left, top, right, bottom = (int(side) for side in font.getbbox(character, anchor="ls"))
    if not (right > left and bottom > top):
        return np.zeros((0, 0), np.uint8), left, top
    picture = Image.new("L", (right - left, bottom - top))
    ImageDraw.Draw(picture).text((-left, -top), character, 255, font, anchor="ls")
    return np.asarray(picture), left, top


@cache
def _font(size: int) -> ImageFont.FreeTypeFont:
    # importing matplotlib takes longer than the window's first picture may
    found = find_spec("matplotlib")
    assert found is not None and found.submodule_search_locations
    (folder,) = found.submodule_search_locations
    path = Path(folder) / "mpl-data" / "fonts" / "ttf" / "DejaVuSans.ttf"
    return ImageFont.truetype(str(path), size, layout_engine=ImageFont.Layout.BASIC)
