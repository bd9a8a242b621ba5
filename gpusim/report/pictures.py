"""Pictures for the page: down-scaled frames, full-resolution crops, data URIs."""

from __future__ import annotations

import base64
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from gpusim.errors import GpusimError, InputError
from gpusim.export.images import GreyImage, read_image
from gpusim.files.input_file import read_input
from gpusim.files.picture_file import decode
from gpusim.report.model import FramePair

__all__ = ["PagePair", "file_uri", "page_pair", "photo_uri", "reduced"]

_PHOTO_WIDTH = 1800  # px
_PAGE_WIDTH = 1600  # px of a down-scaled frame: sharp on a wide screen, ~100 kB
_CROP = 72  # px of a full-resolution crop per side
_CROP_ZOOM = 4
_MAX_CROPS = 4

Bytes = npt.NDArray[np.uint8]


@dataclass(frozen=True)
class PagePair:
    """A frame pair as data URIs, ready for the page; crops are (label, reference, deformed)."""

    source: FramePair
    width: int
    height: int
    bits: int
    reference: str
    deformed: str
    crops: tuple[tuple[str, str, str], ...]


def page_pair(pair: FramePair) -> PagePair:
    """Read both images and return what the page embeds.

    Raises InputError if an image can't be read or the two differ in size.
    """
    reference, deformed = read_image(pair.reference), read_image(pair.deformed)
    if reference.shape != deformed.shape:
        raise InputError(
            f"frame pair of camera {pair.camera!r}: got {reference.shape} and {deformed.shape};"
            " expected two images of one size"
        )
    height, width = reference.shape
    bits = pair.bits or max(_bits_of(reference), _bits_of(deformed))
    crops = tuple(
        (label, _crop_uri(reference, x0, y0, bits), _crop_uri(deformed, x1, y1, bits))
        for label, x0, y0, x1, y1 in pair.crops[:_MAX_CROPS]
        if np.isfinite([x0, y0, x1, y1]).all()
    )
    return PagePair(
        pair,
        width,
        height,
        bits,
        _frame_uri(reference, bits),
        _frame_uri(deformed, bits),
        crops,
    )


def file_uri(path: Path) -> str:
    """Return a PNG file as a data URI."""
    try:
        return _uri("image/png", read_input(path, "a figure").data)
    except InputError as error:
        raise InputError(f"figure: {path}: can't be read ({error})") from None


def photo_uri(path: Path) -> str:
    """Return a picture file as the data URI of a JPEG no wider than the page shows it sharply."""
    image = decode(path, flags=cv2.IMREAD_COLOR)
    height, width = image.shape[:2]
    scale = min(1.0, _PHOTO_WIDTH / width)
    size = max(1, round(width * scale)), max(1, round(height * scale))
    small = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    return _encoded(small, ".jpg", "image/jpeg", [cv2.IMWRITE_JPEG_QUALITY, 88])


def _frame_uri(image: GreyImage, bits: int) -> str:
    """Down-scale by area average and encode as JPEG; grey levels of ``bits`` become 8."""
    height, width = image.shape
    scale = min(1.0, _PAGE_WIDTH / width)
    small = reduced(image, (max(1, round(width * scale)), max(1, round(height * scale))), bits)
    return _encoded(small, ".jpg", "image/jpeg", [cv2.IMWRITE_JPEG_QUALITY, 86])


def reduced(image: GreyImage, size: tuple[int, int], bits: int = 0) -> Bytes:
    """``image`` as 8 bit of ``size`` (width, height), by area average; of ``bits`` (0: as few as
    hold its grey levels).

    Whole pixels first: ten times faster than any other share of them, and nearly as good.
    """
    bits = bits or _bits_of(image)
    whole = max(1, image.shape[1] // size[0])
    part: npt.NDArray[Any] = image
    if whole > 1:
        inner = image.shape[1] // whole, image.shape[0] // whole
        part = image[: inner[1] * whole, : inner[0] * whole]
        part = cv2.resize(part, inner, interpolation=cv2.INTER_AREA)
    return _eight_bit(cv2.resize(part, size, interpolation=cv2.INTER_AREA), bits)


def _crop_uri(image: GreyImage, x: float, y: float, bits: int) -> str:
    """Cut a square around (x, y) and enlarge each pixel to a square, so that pixels can be seen."""
    height, width = image.shape
    side = min(_CROP, height, width)
    left = min(max(round(x) - side // 2, 0), width - side)
    top = min(max(round(y) - side // 2, 0), height - side)
    part = _eight_bit(image[top : top + side, left : left + side], bits)
    large = part.repeat(_CROP_ZOOM, axis=0).repeat(_CROP_ZOOM, axis=1)
    return _encoded(large, ".png", "image/png", [])


def _bits_of(image: GreyImage) -> int:
    """8 to 16: as few as hold its grey levels, which cameras with 10, 12 or 14 don't shift up."""
    return max(8, int(image.max(initial=0)).bit_length())


def _eight_bit(image: npt.NDArray[Any], bits: int) -> Bytes:
    if image.dtype == np.uint8:
        return image.astype(np.uint8, copy=False)
    return np.asarray(np.minimum(image.astype(np.uint16) >> (bits - 8), 255), dtype=np.uint8)


def _encoded(image: Bytes, suffix: str, media: str, options: list[int]) -> str:
    good, data = cv2.imencode(suffix, image, options)
    if not good:
        raise GpusimError(f"report: an image of shape {image.shape} can't be encoded as {suffix}")
    return _uri(media, data.tobytes())


def _uri(media: str, data: bytes) -> str:
    return f"data:{media};base64,{base64.b64encode(data).decode('ascii')}"
