"""Images as PNG and TIFF, 8 and 16 bit, grey or in colour (red, green, blue), without loss.

OpenCV writes PNG, filtered by differences to the row above and deflated with zlib's run-length
strategy: on grey rows as small as a full search, and on noise twice as fast. TIFF is stored
uncompressed, so that every tool can read or memory-map it.

Images written or read lately are kept in memory: taking a 21 Mpx picture, measuring it, drawing
markers on it and putting it on a page would decode the same file five times. A file is known by its
number, size and time of change, whatever it is called.
"""

from __future__ import annotations

import struct
import zlib
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from pathlib import Path
from threading import Lock
from typing import Any, cast

import cv2
import numpy as np
import numpy.typing as npt

from gpusim.errors import GpusimError, InputError
from gpusim.files.atomic_files import PathLike, atomic_path
from gpusim.files.input_file import InputFile, Stamp, file_stamp
from gpusim.files.picture_file import read_picture
from gpusim.validation import require

MOST_BYTES = 256 << 20

_kept: OrderedDict[Stamp, npt.NDArray[Any]] = OrderedDict()
_lock = Lock()


def keep(path: PathLike, image: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Keep what the file ``path`` holds; returns ``image``, which can't be written to any more.

    The images seen longest ago are dropped for it; one of more than `MOST_BYTES` isn't kept.
    """
    image.setflags(write=False)
    stamp = file_stamp(path)
    with _lock:
        if stamp is not None and image.nbytes <= MOST_BYTES:
            _kept[stamp] = image
            _kept.move_to_end(stamp)
            while sum(one.nbytes for one in _kept.values()) > MOST_BYTES:
                _kept.popitem(last=False)
    return image


def recall(path: PathLike) -> npt.NDArray[Any] | None:
    """The image in the file ``path``, read-only, if it is kept and the file is still the same."""
    stamp = file_stamp(path)
    with _lock:
        image = None if stamp is None else _kept.get(stamp)
        if stamp is not None and image is not None:
            _kept.move_to_end(stamp)
        return image


Picture = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]

_PNG_SIDE = 1_000_000  # of libpng, unless it is built otherwise
_HEAD = 33  # bytes of a PNG's signature and its first chunk, which metadata follows
_FILTER, _UP = 19, 32  # IMWRITE_PNG_FILTER, which older ones than OpenCV 4.12 don't name, and skip
_PNG = [cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE,
        _FILTER, _UP]  # fmt: skip


def write_image(
    path: PathLike,
    image: Picture,
    *,
    pixels_per_metre: float | None = None,
    text: Mapping[str, str] | None = None,
) -> Path:
    """Write an image in the format that the suffix of ``path`` names.

    Parameters
    ----------
    path
        Ends in ``.png``, ``.tif`` or ``.tiff``. Written atomically.
    image
        (H, W) or (H, W, 3), red, green and blue, uint8 or uint16.
    pixels_per_metre
        Resolution stored as metadata (on the sensor: 1 / pixel pitch), 1/m.
    text
        Latin-1 key/value pairs stored as metadata (PNG ``tEXt``, TIFF image description).

    Raises
    ------
    InputError
        Wrong suffix, shape, dtype or metadata, or a place that can't be written to.

    Examples
    --------
    >>> gs.export.write_image("grey.tif", np.full((2, 3), 500, np.uint16)).name
    'grey.tif'
    """
    suffix = _format(path)
    with atomic_path(path) as part:
        save_image(part, image, pixels_per_metre=pixels_per_metre, text=text, suffix=suffix)
    return Path(path)


def save_image(
    path: PathLike,
    image: Picture,
    *,
    pixels_per_metre: float | None = None,
    text: Mapping[str, str] | None = None,
    suffix: str = "",
) -> None:
    """As `write_image`, for who sees to it that a file is whole; ``suffix``: in place of that of
    ``path``."""
    _check(image, pixels_per_metre)
    if (suffix or _format(path)) == ".png":
        _save_png(path, image, pixels_per_metre, text)
    else:
        save_tiff(path, image, pixels_per_metre, text)


def _format(path: PathLike) -> str:
    suffix = Path(path).suffix.lower()
    known = suffix in (".png", ".tif", ".tiff")
    require(known, f"image file: {path}", f"suffix {suffix!r}", ".png, .tif or .tiff")
    return suffix


def _save_png(
    path: PathLike,
    image: Picture,
    pixels_per_metre: float | None,
    text: Mapping[str, str] | None,
) -> None:
    """A PNG with the metadata that OpenCV doesn't write (W3C specification, 3rd edition)."""
    expected = f"at most {_PNG_SIDE} px a side in a PNG; .tiff takes more"
    require(max(image.shape[:2]) <= _PNG_SIDE, "image", f"shape {image.shape}", expected)
    metadata = []
    if pixels_per_metre is not None:
        density = max(1, round(pixels_per_metre))
        metadata.append(_chunk(b"pHYs", struct.pack(">IIB", density, density, 1)))
    for key, value in (text or {}).items():
        metadata.append(_chunk(b"tEXt", _latin1(key, 79) + b"\0" + _latin1(value)))
    data = encoded_picture(image, ".png", _PNG)
    with open(path, "wb") as stream:
        stream.writelines([data[:_HEAD], *metadata, data[_HEAD:]])


def encoded_picture(image: npt.NDArray[Any], suffix: str, options: Sequence[int] = ()) -> bytes:
    """A file of a picture (H, W), (H, W, 3) or, with its opacity, (H, W, 4), as OpenCV makes it."""
    order = {3: [2, 1, 0], 4: [2, 1, 0, 3]}
    colours = image if image.ndim == 2 else image[..., order[image.shape[2]]]
    native: Any = np.ascontiguousarray(colours, colours.dtype.newbyteorder("="))
    good, data = cv2.imencode(suffix, native, options)
    if not good:
        raise GpusimError(f"an image of shape {image.shape} can't be encoded as {suffix}")
    return data.tobytes()


def save_tiff(
    path: PathLike,
    image: npt.NDArray[Any],
    pixels_per_metre: float | None = None,
    text: Mapping[str, str] | None = None,
) -> None:
    """An uncompressed TIFF of numbers of any type."""
    import tifffile  # most pictures are PNG

    lines = [f"{key}: {value}" for key, value in (text or {}).items()]
    description = b"\n".join(_latin1(line) for line in lines)
    per_cm = None if pixels_per_metre is None else pixels_per_metre / 100.0
    tifffile.imwrite(
        path,
        image.astype(image.dtype.newbyteorder("="), copy=False),
        photometric="minisblack" if image.ndim == 2 else "rgb",
        metadata=None,
        software="gpusim",
        description=description or None,
        resolution=None if per_cm is None else (per_cm, per_cm),
        resolutionunit=None if per_cm is None else "CENTIMETER",
    )


def read_image(source: PathLike | InputFile) -> Picture:
    """Read an image as it is stored: (H, W) or (H, W, 3), red, green and blue, uint8 or uint16;
    what is transparent isn't.

    One that was read or written lately comes from memory (`gpusim.export.images`), so the array
    can't be written to. Raises InputError if the file is missing, unreadable or of another kind.

    Examples
    --------
    >>> path = gs.export.write_image("grey.png", np.full((2, 3), 128, np.uint8))
    >>> gs.export.read_image(path)
    array([[128, 128, 128],
           [128, 128, 128]], dtype=uint8)
    """
    if isinstance(source, InputFile):
        return _decoded(source)
    known = recall(source)
    if known is not None:
        return cast(Picture, known)
    return cast(Picture, keep(source, _decoded(source)))


def _decoded(source: PathLike | InputFile) -> Picture:
    image = np.ascontiguousarray(read_picture(source))
    path = source.path if isinstance(source, InputFile) else source
    known = _is_picture(image) and image.dtype in (np.uint8, np.uint16)
    got, expected = f"shape {image.shape}, {image.dtype}", "(H, W) or (H, W, 3), uint8 or uint16"
    require(known, f"image file: {path}", got, expected)
    return cast(Picture, image)


def _is_picture(image: npt.NDArray[Any]) -> bool:
    return image.ndim == 2 or (image.ndim == 3 and image.shape[2] == 3)


def _check(image: Picture, pixels_per_metre: float | None) -> None:
    known = _is_picture(image) and image.dtype.kind == "u" and image.itemsize <= 2
    got = f"shape {image.shape}, {image.dtype}"
    expected = "(H, W) or (H, W, 3), uint8 or uint16, not empty"
    require(known and 0 not in image.shape, "image", got, expected)
    storable = pixels_per_metre is None or 0.0 < pixels_per_metre < 2.0**31
    require(storable, "pixels_per_metre", pixels_per_metre, "0 < value < 2^31")


def _latin1(text: str, longest: int | None = None) -> bytes:
    try:
        data = text.encode("latin-1")
    except UnicodeEncodeError as error:
        raise InputError(f"image metadata: got {text!r}; expected Latin-1 text") from error
    fits = b"\0" not in data and (longest is None or 0 < len(data) <= longest)
    require(fits, "image metadata", repr(text), "no NUL, and a key of 1 to 79 characters")
    return data


def _chunk(kind: bytes, data: bytes) -> bytes:
    checksum = zlib.crc32(data, zlib.crc32(kind))
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", checksum)
