"""What the header of a picture's file says: its size, pages of a TIFF, white as zero, orientation.

Cameras and programs that measure have to see the pixels as the sensor read them, so no decoder is
left to turn a picture or to invert it by rules of its own: see `plain_tiff`.
"""

from __future__ import annotations

import io
import math
import re
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from gpusim.errors import InputError
from gpusim.files.input_file import InputFile

TIFF_MAGIC = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
_ORIENTATION, _PHOTOMETRIC, _REDUCED, _PLANAR, _EXTRA = 274, 262, 254, 284, 338
_PHOTOMETRICS = (0, 1, 2, 3, 6, 32803, 34892)
"""White is zero, black is zero, RGB, a palette, YCbCr, a mosaic, linear RGB."""
_LETTERS = {1: "B", 3: "H", 4: "I"}  # TIFF's BYTE, SHORT, LONG
_EXIF = re.compile(rb"(?:Exif\0\0|eXIf|EXIF....)(?=II\*\0|MM\0\*)", re.DOTALL)


@dataclass(frozen=True)
class Page:
    """A full picture of a TIFF; ``index`` counts its small copies, too."""

    index: int
    size: tuple[int, int]
    """Width and height, as it claims."""
    orientation: int
    """1: as stored; 2 to 8: to be mirrored or turned for display."""
    white_is_zero: bool
    apart: bool
    """Whether its channels lie one after the other, each a whole picture."""
    colors: int
    """How many of its channels, the first ones, aren't said to be something else, as opacity is."""
    plain: bool
    """Whether OpenCV reads its numbers as they are stored, if it reads them."""
    edits: Sequence[tuple[int, bytes]]
    """Where in the file it is said, and what would say: as stored, black is zero, colours are
    already multiplied by their opacity."""


@lru_cache(maxsize=1)  # all pages are looked through to find one of them
def tiff_pages(file: InputFile) -> list[Page]:
    """Every page of a TIFF but the smaller copies that some programs add."""
    import tifffile

    pages, seen = [], set()
    with tifffile.TiffFile(file.stream()) as tiff:
        for index, each in enumerate(tiff.pages):
            page = each.aspage()
            if page.offset in seen:  # tifffile would go round for ever
                raise ValueError("a page that names an earlier one as the next")
            seen.add(page.offset)
            if _number(page, _REDUCED, 0) & 1:
                continue
            photometric = _number(page, _PHOTOMETRIC, 1)
            orientation = _number(page, _ORIENTATION, 1)
            white = photometric == 0
            opacity = tuple(page.extrasamples) == (2,)
            wrong = [_ORIENTATION] * (orientation != 1) + [_PHOTOMETRIC] * white
            wrong += [_EXTRA] * opacity
            pages.append(
                Page(
                    index,
                    (page.imagewidth, page.imagelength),
                    orientation,
                    white,
                    apart := page.samplesperpixel > 1 and _number(page, _PLANAR, 1) == 2,
                    page.samplesperpixel - len(page.extrasamples),
                    not apart and page.samplesperpixel <= (1 if photometric < 2 else 4),
                    [_says_one(page.tags[tag], tiff.byteorder) for tag in wrong],
                )
            )
    return pages


def plain_tiff(file: InputFile, page: Page) -> bytes:
    """The file's bytes, but that decoders give the page's numbers as they are stored.

    Raises InputError for a page that isn't there as a whole, of colours that OpenCV turns into
    others, of bits that nobody unpacks, and of floats of which white is zero: there is no white to
    count from.
    """
    import tifffile

    with tifffile.TiffFile(file.stream()) as tiff:
        whole = tiff.pages[page.index].aspage()
        problem = _unread(whole) or _lacking(whole, len(file.data))
    if problem:
        raise InputError(f"image file: {file.path}: got {problem}")
    if not page.edits:
        return file.data
    data = bytearray(file.data)
    for at, value in page.edits:
        data[at : at + len(value)] = value
    return bytes(data)


def _unread(page: Any) -> str:
    """Why a page isn't read; "" if it is."""
    photometric = _number(page, _PHOTOMETRIC, 1)
    if photometric not in _PHOTOMETRICS:
        return (
            f"colours of photometric interpretation {photometric} (CMYK is 5, CIELAB 8); expected "
            "grey, RGB, a palette or YCbCr"
        )
    if photometric == 0 and page.dtype is not None and page.dtype.kind == "f":
        return (
            "floats of which white is zero (photometric interpretation 0); expected black as zero, "
            "or integers"
        )
    if photometric != 3 and page.bitspersample in (2, 4):
        return f"numbers of {page.bitspersample} bits; expected 1, or 8 and more"
    return ""


def _lacking(page: Any, length: int) -> str:
    """What a page lacks in a file of ``length`` bytes; "" if all tiles or strips are there."""
    count = math.prod(page.chunked)
    if 2 * count > length:
        return f"{count} tiles or strips in {length} bytes; expected fewer"
    parts = list(zip(page.dataoffsets, page.databytecounts, strict=False))
    there = sum(at > 0 and size > 0 and at + size <= length for at, size in parts)
    if there < count:
        return f"{there} of {count} tiles or strips; expected all: the file is cut off"
    row = -(-page.imagewidth * page.bitspersample * page.samplesperpixel // 8)
    stored = sum(size for _, size in parts)
    if page.compression == 1 and page.photometric != 6 and stored < page.imagelength * row:
        return f"{stored} bytes; expected {page.imagelength} rows of {row}: the file is cut off"
    return ""


def exif_orientation(data: bytes) -> int:
    """The orientation that the EXIF part of a JPEG, PNG or WebP states; 1 without any."""
    found = _EXIF.search(data)
    if found is None:
        return 1
    import tifffile

    try:  # the part is a TIFF without a picture
        with tifffile.TiffFile(io.BytesIO(data[found.end() :])) as tiff:
            return _number(tiff.pages[0].aspage(), _ORIENTATION, 1)
    except Exception:  # it is cut or damaged
        return 1


def _number(page: Any, code: int, usual: int) -> int:
    tag = page.tags.get(code)
    value: Any = usual if tag is None else tag.value
    return int(value[0] if isinstance(value, tuple) and len(value) == 1 else value)


def _says_one(tag: Any, order: str) -> tuple[int, bytes]:
    letter = _LETTERS.get(int(tag.dtype))
    if letter is None or tag.count != 1:
        raise ValueError(f"tag {tag.code} of type {tag.dtype}")
    return tag.valueoffset, struct.pack(f"{order}{letter}", 1)
