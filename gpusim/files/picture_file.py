"""Pictures in files, decoded by one function: whatever is wrong with one is an error that names it.

The size that a file claims is read from its header first, so that a few bytes can't ask for all
of the memory; kinds of files of which it isn't known are refused. Nobody else calls a decoder.
"""

from __future__ import annotations

import io
import logging
import os
import re
import struct
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from gpusim.arrays.grey import grey_of
from gpusim.errors import InputError
from gpusim.files.atomic_files import PathLike
from gpusim.files.input_file import InputFile, Stamp, file_stamp, read_input
from gpusim.files.picture_tags import TIFF_MAGIC, Page, exif_orientation, plain_tiff, tiff_pages
from gpusim.files.radiance_file import RadianceHeader, to_srgb
from gpusim.files.silence import silence
from gpusim.parallel.machine import memory_limit
from gpusim.validation import require

LARGEST = 1 << 28  # pixels: 16384 x 16384, beyond any camera
BYTES = 32  # of memory for a pixel, with all that is made of a picture

# without a handler, Python prints what tifffile logs
logging.getLogger("tifffile").addHandler(logging.NullHandler())

Source = str | os.PathLike[str] | InputFile
Size = tuple[int, int]
_DENSEST = {b"\x89PNG": 8300, b"\xff\xd8": 1000, b"BM": 130, b"#?": 16, b"P": 8}
"""Pixels that a byte of a file may hold, by the file's beginning."""
_OPENEXR = b"\x76\x2f\x31\x01"


def decode(source: Source, page: int = 0) -> npt.NDArray[Any]:
    """The picture in a file as it is stored, (H, W) or (H, W, C), colours blue, green, red.

    It isn't turned or mirrored, whatever the file says of its orientation: that is a warning. Where
    white is zero (TIFF), integers are inverted within the range of their type.

    Parameters
    ----------
    source : a PNG, TIFF, JPEG, BMP, PBM, PGM, PPM, PAM, Radiance or OpenEXR file.
    page : of a TIFF with several, from 0.

    Raises
    ------
    InputError
        Naming the file: absent, no picture, damaged, of another page, or larger than `LARGEST`
        pixels or than the memory allows.
    """
    file = read_input(source, "a picture")
    turned, image = 1, None
    with decoding(file):
        if file.data[:4] in TIFF_MAGIC:
            tiff = tiff_pages(file)[page]
            turned, image = tiff.orientation, _tiff(file, tiff)
        elif file.data[:4] == _OPENEXR:
            image = _openexr(file)
        elif size := _claimed(file.data):
            densest = next(n for begin, n in _DENSEST.items() if file.data.startswith(begin))
            _check_size(file, size, densest * len(file.data))
            radiance = RadianceHeader.of(file.data)
            data = _plain_pam(file.data) if radiance is None else radiance.plain()
            image = _by_opencv(data, 0)
            if radiance is not None and image is not None:
                image = radiance.radiances(image[..., ::-1])[..., ::-1]
            turned = exif_orientation(file.data)
    if image is None or 0 in image.shape:
        what = f"image file: {file.path}: damaged, or no picture: it can't be read"
        expected = "a PNG, TIFF, JPEG, BMP, PBM, PGM, PPM, PAM, Radiance or OpenEXR picture"
        raise InputError(f"{what}; got {_begins(file.data)}; expected {expected}")
    if turned != 1:
        warnings.warn(
            f"image file: {file.path}: got orientation {turned}, by which viewers turn or mirror "
            "it; its pixels are taken as they are stored",
            UserWarning,
            stacklevel=2,
        )
    return image


def read_picture(source: Source, page: int = 0) -> npt.NDArray[Any]:
    """What `decode` gives without what says how opaque it is: (H, W) if that is grey, or (H, W, 3)
    of red, green and blue; pictures of other channels keep them."""
    image = decode(source, page)
    if image.ndim == 3 and image.shape[2] in (3, 4):
        return image[..., 2::-1]
    return image[..., 0] if image.ndim == 3 and image.shape[2] in (1, 2) else image


def page_count(source: Source) -> int:
    """Number of pictures in a file, without the small copies that some programs add to a TIFF."""
    file = read_input(source, "a picture")
    if file.data[:4] not in TIFF_MAGIC:
        return 1
    with decoding(file):
        return max(1, len(tiff_pages(file)))


@contextmanager
def decoding(file: InputFile) -> Iterator[None]:
    """What goes wrong meanwhile is the file's fault: decoders raise errors of every kind."""
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        reason = " ".join(str(getattr(error, "err", "") or error).split())[:200]
        raise InputError(
            f"image file: {file.path}: can't be read as a picture; got {type(error).__name__}"
            f"{reason and ': ' + reason}; expected a file that isn't damaged"
        ) from None


def _by_opencv(data: bytes, page: int) -> npt.NDArray[Any] | None:
    buffer = np.frombuffer(data, np.uint8)
    flags = cv2.IMREAD_UNCHANGED  # never turned by EXIF, which OpenCV's other flags do
    with silence():  # what is wrong is said once, by the error
        if page == 0:
            image = cv2.imdecode(buffer, flags)
        else:
            read, images = cv2.imdecodemulti(buffer, flags, range=(page, page + 1))
            image = images[0] if read and images else None
    return None if image is None else np.asarray(image)


def _tiff(file: InputFile, page: Page) -> npt.NDArray[Any]:
    """A page, by tifffile where OpenCV reads other numbers than are stored, or none: grey beside
    opacity, channels apart, more than four of them, floats of 16 bits."""
    _check_size(file, page.size)
    data = plain_tiff(file, page)
    image = _by_opencv(data, page.index) if page.plain else None
    if image is None:
        import tifffile

        image = np.asarray(tifffile.imread(io.BytesIO(data), key=page.index))
        image = np.moveaxis(image, 0, -1) if page.apart else image
        image = image[..., : page.colors] if image.ndim == 3 else image
        colors = image.ndim == 3 and image.shape[2] in (3, 4)
        image = image[..., [2, 1, 0, 3][: image.shape[2]]] if colors else image
    return ~image if page.white_is_zero else image


def openexr(path: PathLike) -> Any:
    """The package that reads and writes ``path``. Raises InputError where it isn't installed."""
    try:
        import OpenEXR
    except ImportError:
        expected = "expected it for .exr files: pip install 'gpusim[exr]'"
        raise InputError(f"image file: {path}: got no package OpenEXR; {expected}") from None
    return OpenEXR


def _openexr(file: InputFile) -> npt.NDArray[Any]:
    OpenEXR = openexr(file.path)
    with file.on_disk() as path, redirect_stdout(io.StringIO()), silence():
        (part,) = OpenEXR.File(str(path), header_only=True).parts
        low, high = part.header["dataWindow"]
        _check_size(file, (int(high[0]) - int(low[0]) + 1, int(high[1]) - int(low[1]) + 1))
        channels = OpenEXR.File(str(path)).channels()
    names = [name for name in ("RGBA", "RGB", "Y") if name in channels]
    if not names or {channels[names[0]].xSampling, channels[names[0]].ySampling} != {1}:
        raise ValueError(f"channels {', '.join(channels)}: R, G and B or Y are due")
    pixels = np.asarray(channels[names[0]].pixels)
    if pixels.ndim == 2:
        return pixels
    if "chromaticities" in part.header:
        matrix = to_srgb(part.header["chromaticities"])
        pixels = np.maximum(pixels[..., :3] @ matrix.T, 0.0).astype(pixels.dtype)
    return pixels[..., [2, 1, 0, 3][: pixels.shape[2]]]


def _check_size(file: InputFile, size: Size, most: int = LARGEST) -> None:
    width, height = size
    most = min(most, LARGEST, memory_limit() // BYTES)
    got = f"{width} x {height} pixels in {len(file.data)} bytes"
    expected = f"at most {most / 1e6:.3g} million pixels"
    require(width * height <= most, f"image file: {file.path}: too large", got, expected)


def claimed_pixels(source: Source) -> int:
    """How many pixels a picture's head says that it has; 0 for a kind whose head isn't known."""
    file = read_input(source, "a picture")
    with decoding(file):
        tiff = file.data[:4] in TIFF_MAGIC
        width, height = (tiff_pages(file)[0].size if tiff else _claimed(file.data)) or (0, 0)
    return width * height


def _claimed(data: bytes) -> Size | None:
    """Width and height that a file claims; None for a kind that isn't known, or is cut."""
    if data[:8] == b"\x89PNG\r\n\x1a\n" and len(data) >= 24:
        return struct.unpack(">II", data[16:24])
    if data[:2] == b"BM" and len(data) >= 26:
        width, height = struct.unpack("<ii", data[18:26])
        return abs(width), abs(height)
    if data[:2] == b"\xff\xd8":
        return _jpeg_size(data)
    if radiance := RadianceHeader.of(data):
        return radiance.size
    if found := re.match(rb"P[1-6]\s+(?:#.*\s+)*(\d+)\s+(?:#.*\s+)*(\d+)", data[:4096]):
        return int(found[1][:12]), int(found[2][:12])
    if data[:3] == b"P7\n":
        pam = _pam_header(data)[0]
        return pam["WIDTH"], pam["HEIGHT"]
    return None


def _pam_header(data: bytes) -> tuple[dict[str, int], bytes]:
    """WIDTH, HEIGHT, DEPTH and MAXVAL of a PAM, and what follows its header."""
    head, _, pixels = data.partition(b"\nENDHDR\n")
    entries = re.findall(
        r"^(WIDTH|HEIGHT|DEPTH|MAXVAL)\s+(\d{1,9})\s*$", head.decode("latin-1"), re.M
    )
    values = {key: int(number) for key, number in entries}
    if len(values) != 4 or not (0 < values["DEPTH"] <= 4 and 0 < values["MAXVAL"] < 65536):
        raise ValueError(f"the header {values}")
    return values, pixels


def _plain_pam(data: bytes) -> bytes:
    """A PAM as the PGM or PPM of its colours, which OpenCV doesn't mix up; others as they are."""
    if data[:3] != b"P7\n":
        return data
    pam, pixels = _pam_header(data)
    width, height, depth, most = (pam[key] for key in ("WIDTH", "HEIGHT", "DEPTH", "MAXVAL"))
    kind, colors = np.dtype("u1" if most < 256 else ">u2"), 1 if depth < 3 else 3
    raster = np.frombuffer(pixels, kind, width * height * depth).reshape(-1, depth)
    return (
        b"P%d %d %d %d\n" % (5 if colors == 1 else 6, width, height, most)
        + raster[:, :colors].tobytes()
    )


def _jpeg_size(data: bytes) -> Size | None:
    """Of the first frame header: markers are 0xFF and a kind, then the length of what follows."""
    at = 2
    while at + 9 <= len(data) and data[at] == 0xFF:
        kind, length = data[at + 1], int.from_bytes(data[at + 2 : at + 4], "big")
        if 0xC0 <= kind <= 0xCF and kind not in (0xC4, 0xC8, 0xCC):
            height, width = struct.unpack(">HH", data[at + 5 : at + 9])
            return width, height
        at += 1 if kind == 0xFF else 2 + length
    return None


def _begins(data: bytes) -> str:
    return f"{len(data)} bytes" + (f" that begin with {data[:8]!r}" if data else "")


def picture_file(path: PathLike) -> tuple[Path, int | None]:
    """The file and the page, from 1, that ``path`` names: ``stack.tif#3`` is page 3 of stack.tif.

    None for a path without a page. A file that has such a name itself is taken as it is.
    """
    file = Path(path)
    found = re.fullmatch(r"(.+)#(\d+)", os.fspath(path))
    if found is None or file.is_file():
        return file, None
    return Path(found[1]), int(found[2])


def pages_of(path: PathLike) -> list[Path]:
    """``path`` itself, or every page of it by name if it is a file of several pages.

    Raises InputError for a file that is missing or damaged.
    """
    file, page = picture_file(path)
    count = page_count(_read(file))
    if page is not None or count == 1:
        return [Path(path)]
    return [file.with_name(f"{file.name}#{number}") for number in range(1, count + 1)]


def read_grey(source: PathLike | InputFile) -> npt.NDArray[Any]:
    """As `read_stored`, in grey: of colour the luminance is taken (`gpusim.arrays.grey`)."""
    return np.ascontiguousarray(grey_of(read_stored(source)))


def read_stored(source: PathLike | InputFile) -> npt.NDArray[Any]:
    """Read any picture as (H, W) grey or (H, W, 3) in colour, at the bit depth that it has.

    Transparency is dropped. Of a TIFF with several pages, ``file.tif#3`` is the third.

    Raises
    ------
    InputError
        A file that is missing or no picture; several pages and none named, or one that isn't there.
    """
    page: int | None
    if isinstance(source, InputFile):
        file, page, data = source.path, None, source
    else:
        file, page = picture_file(source)
        data = _read(file)
    count = page_count(data)
    where, named = f"image file: {file}", f"one: name it, as {file.name}#1 (1 to {count})"
    require(page is not None or count <= 1, where, f"{count} pages", named)
    require(page is None or 1 <= page <= count, where, f"page {page}", f"1 to {count}")
    image = read_picture(data, 0 if page is None else page - 1)
    fits = image.dtype.kind in "uif" and (image.ndim == 2 or image.shape[2:] == (3,))
    require(fits, where, f"shape {image.shape}, {image.dtype}", "grey or colour")
    return np.ascontiguousarray(image)


def _read(file: Path) -> InputFile:
    """The file, read once for all of its pages."""
    return _last(file, file_stamp(file))


@lru_cache(maxsize=1)
def _last(file: Path, stamp: Stamp | None) -> InputFile:
    del stamp  # of another file, or another time, it is read anew
    return read_input(file, "a picture")
