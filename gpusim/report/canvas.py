"""A page of pixels to draw on: smooth lines, marks and text, in points and inches.

Figures of a report are a few curves each. matplotlib takes 0.2 s to draw one and 0.5 s to be
imported; this takes 10 ms (OpenCV's lines, FreeType's letters through Pillow).
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
from PIL import ImageFont

from gpusim.export.files import PathLike
from gpusim.export.images import write_colour_png
from gpusim.report.style import DPI, PAGE, TEXT

__all__ = ["Box", "Canvas", "pixels", "text_size"]

Floats = npt.NDArray[np.float64]
Font = ImageFont.FreeTypeFont | ImageFont.ImageFont
Box = tuple[int, int, int, int]
"""left, top, right, bottom, px"""

_SHIFT = 4  # bits of a pixel's fraction that OpenCV's lines take
_FARTHEST = 30000.0  # px
_SIDES = {"^": (3, -90.0), "v": (3, 90.0), "s": (4, 45.0), "D": (4, 0.0)}
FONT_SIZE = 10.5


def pixels(points: float) -> float:
    """Printer's points (1/72 inch) in px."""
    return points * DPI / 72.0


@cache
def _rgb(colour: str) -> tuple[int, int, int]:
    """``"#rrggbb"`` as numbers."""
    red, green, blue = (int(colour[k : k + 2], 16) for k in (1, 3, 5))
    return red, green, blue


@cache
def _font(size: float, bold: bool) -> Font:
    """DejaVu Sans as it comes with matplotlib: the same letters everywhere."""
    found = find_spec("matplotlib")
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    for folder in (found.submodule_search_locations or []) if found else []:
        file = Path(folder) / "mpl-data" / "fonts" / "ttf" / name
        if file.is_file():
            return ImageFont.truetype(str(file), round(pixels(size)))
    return ImageFont.load_default(round(pixels(size)))


def _letters(font: Font) -> tuple[int, int]:
    """Where the tallest and the lowest letters of a font end, px below the line's top."""
    box = font.getbbox("Hgj")
    return int(box[1]), int(np.ceil(box[3]))


def text_size(text: str, size: float = FONT_SIZE, bold: bool = False) -> tuple[float, float]:
    """Width of a line of text and height of its font's letters, px."""
    font = _font(size, bold)
    top, bottom = _letters(font)
    return float(font.getlength(text)), float(bottom - top)


class Canvas:
    """A white page of ``size`` inches at 200 dpi, or a picture (H, W, 3) uint8, RGB, to draw on."""

    def __init__(self, size: tuple[float, float] | npt.NDArray[np.uint8]) -> None:
        if isinstance(size, tuple):
            width, height = (round(side * DPI) for side in size)
            self.image = np.empty((height, width, 3), np.uint8)
            cv2.rectangle(self.image, (0, 0), (width, height), _rgb(PAGE), cv2.FILLED)
        else:
            self.image = size

    @property
    def box(self) -> Box:
        """All of it."""
        return 0, 0, self.image.shape[1], self.image.shape[0]

    def text(
        self,
        x: float,
        y: float,
        text: str,
        *,
        size: float = FONT_SIZE,
        colour: str = TEXT,
        bold: bool = False,
        across: float = 0.0,
        down: float = 0.0,
        upright: bool = False,
    ) -> None:
        """Write a line at (x, y) px, which lies ``across`` and ``down`` (0 to 1) of its box.

        ``upright``: turned a quarter, to be read from the right.
        """
        if not text:
            return
        font = _font(size, bold)
        left, _, right, _ = font.getbbox(text)
        top, bottom = _letters(font)
        mask = font.getmask(text, mode="L")
        ink = np.array(mask, np.uint8).reshape(mask.size[::-1])
        high = int(font.getbbox(text)[1]) - int(top)
        full = np.zeros((max(int(bottom - top), high + ink.shape[0]), int(right - left) + 1))
        first = max(high, 0)
        ink = ink[: full.shape[0] - first, : full.shape[1]]
        full[first : first + ink.shape[0], : ink.shape[1]] = ink / 255.0
        if upright:
            full = np.rot90(full)
        x0, y0 = round(x - across * full.shape[1]), round(y - down * full.shape[0])
        height, width = self.image.shape[:2]
        rows = slice(max(y0, 0), min(y0 + full.shape[0], height))
        columns = slice(max(x0, 0), min(x0 + full.shape[1], width))
        share = full[rows.start - y0 : rows.stop - y0, columns.start - x0 : columns.stop - x0]
        if not share.size:
            return
        part = self.image[rows, columns]
        part[:] = np.rint(part + share[..., None] * (np.array(_rgb(colour)) - part))

    def lines(
        self, paths: Iterable[Floats], colour: str, width: float, box: Box | None = None
    ) -> None:
        """Draw paths (n, 2) px, ``width`` points wide; only inside ``box``. NaN breaks a path."""
        part, corner = self._part(box)
        pieces = [piece for path in paths for piece in _unbroken(path)]
        if pieces and part.size:
            cv2.polylines(
                part, [_fixed(piece - corner) for piece in pieces], False, _rgb(colour),
                max(1, round(pixels(width))), cv2.LINE_AA, _SHIFT,
            )  # fmt: skip

    def fill(
        self, corners: Floats, colour: str, box: Box | None = None, opacity: float = 1.0
    ) -> None:
        """Fill a polygon (n, 2) px."""
        part, corner = self._part(box)
        if not part.size or not np.isfinite(corners).all():
            return
        below = part.copy() if opacity < 1.0 else part
        cv2.fillPoly(part, [_fixed(corners - corner)], _rgb(colour), cv2.LINE_AA, _SHIFT)
        if opacity < 1.0:
            cv2.addWeighted(part, opacity, below, 1.0 - opacity, 0.0, dst=part)

    def marks(
        self,
        at: Floats,
        shape: str,
        size: float,
        colour: str,
        *,
        inside: str | None = None,
        edge: float = 1.0,
        box: Box | None = None,
    ) -> None:
        """Marks at (n, 2) px: circle ``o``, square ``s``, ``^``, ``v``, ``D``, ``x``, ``|``, ``.``

        ``size`` and the outline ``edge`` in points; ``inside``: colour within, None for none.
        """
        radius = 0.5 * pixels(size)
        for point in at[np.isfinite(at).all(axis=1)]:
            if shape in ("x", "|"):
                ends = [[(-1, -1), (1, 1)], [(-1, 1), (1, -1)]] if shape == "x" else [
                    [(0, -1), (0, 1)]]  # fmt: skip
                self.lines([point + radius * np.array(e, float) for e in ends], colour, edge, box)
                continue
            outline = point + radius * _outline(shape)
            if shape == ".":
                self.fill(outline, colour, box)
                continue
            if inside is not None:
                self.fill(outline, inside, box)
            self.lines([np.concatenate([outline, outline[:1]])], colour, edge, box)

    def save(self, path: PathLike) -> None:
        """Write a PNG, whole or not at all. Raises as `write_colour_png` does."""
        write_colour_png(path, self.image)

    def _part(self, box: Box | None) -> tuple[npt.NDArray[np.uint8], Floats]:
        left, top, right, bottom = box or self.box
        return self.image[max(top, 0) : bottom, max(left, 0) : right], np.array(
            [max(left, 0), max(top, 0)], np.float64
        )


@cache
def _outline(shape: str) -> Floats:
    """A mark's corners (n, 2) around 0, of radius about 1."""
    sides, first = _SIDES.get(shape, (24, 0.0))
    turn = np.radians(first + 360.0 * np.arange(sides) / sides)
    return np.stack([np.cos(turn), np.sin(turn)], axis=1) * (1.2 if sides < 24 else 1.0)


def _unbroken(path: Floats) -> list[Floats]:
    """The pieces of a path between points that aren't finite."""
    fine = np.isfinite(path).all(axis=1)
    if fine.all():
        return [path] if len(path) > 1 else []
    borders = np.flatnonzero(np.diff(fine.astype(np.int8))) + 1
    pieces = np.split(path, borders)
    return [piece for piece in pieces if len(piece) > 1 and np.isfinite(piece).all()]


def _fixed(points: Floats) -> npt.NDArray[np.int32]:
    """OpenCV's fixed-point coordinates; far points stay on their side."""
    near = np.clip(points, -_FARTHEST, _FARTHEST)
    return np.rint(near * (1 << _SHIFT)).astype(np.int32).reshape(-1, 1, 2)
