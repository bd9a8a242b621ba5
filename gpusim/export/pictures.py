"""Pictures of any kind as grey images, single pages of a stack included."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import tifffile

from gpusim.errors import InputError
from gpusim.export.files import PathLike

__all__ = ["pages_of", "picture_file", "read_grey"]

GREY_WEIGHTS = np.array([0.114, 0.587, 0.299])  # blue, green, red: ITU-R BT.601
TIFF_MAGIC = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
UNREADABLE = (tifffile.TiffFileError, ValueError, KeyError, IndexError, OSError, cv2.error)


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
    if not file.is_file():
        raise InputError(f"image file: {file}: not found")
    count = _pages(file)
    if page is not None or count == 1:
        return [Path(path)]
    return [file.with_name(f"{file.name}#{number}") for number in range(1, count + 1)]


def read_grey(path: PathLike) -> npt.NDArray[Any]:
    """Read any picture as (H, W) grey, at the bit depth that it has.

    Colour becomes luma (ITU-R BT.601) in float32, transparency is dropped. Of a TIFF with several
    pages, ``file.tif#3`` is the third.

    Raises
    ------
    InputError
        A file that is missing or no picture; several pages and none named, or one that isn't there.
    """
    file, page = picture_file(path)
    if not file.is_file():
        raise InputError(f"image file: {file}: not found")
    count = _pages(file)
    if page is None and count > 1:
        raise InputError(
            f"image file: {file}: got {count} pages; expected one: name it, as {file.name}#1 "
            f"(1 to {count})"
        )
    if page is not None and not 1 <= page <= count:
        raise InputError(f"image file: {file}: got page {page}; expected 1 to {count}")
    image = _decoded(file, 0 if page is None else page - 1)
    if image.ndim == 3 and image.shape[2] in (3, 4):
        colour = image[..., :3]
        if (colour == colour[..., :1]).all():
            return np.ascontiguousarray(colour[..., 0])
        return np.asarray(colour @ GREY_WEIGHTS, dtype=np.float32)
    if image.ndim == 3 and image.shape[2] in (1, 2):
        image = image[..., 0]
    if image.ndim != 2 or image.dtype.kind not in "uif":
        raise InputError(
            f"image file: {file}: got shape {image.shape}, {image.dtype}; expected grey or colour"
        )
    return np.ascontiguousarray(image)


def _pages(file: Path) -> int:
    """Number of pictures in a file, without the small copies that some programs add to a TIFF."""
    with file.open("rb") as stream:
        if stream.read(4) not in TIFF_MAGIC:
            return 1
    try:
        with tifffile.TiffFile(file) as tiff:
            full = [page.shape for page in tiff.pages if not _reduced(page)]
    except UNREADABLE as error:
        raise InputError(f"image file: {file}: can't be read as a picture") from error
    return max(1, len(full))


def _reduced(page: Any) -> bool:
    """Whether a page says that it is a smaller copy of another one (tag 254, NewSubfileType)."""
    tag = page.aspage().tags.get(254)
    return tag is not None and bool(int(tag.value) & 1)


def _decoded(file: Path, page: int) -> npt.NDArray[Any]:
    """The picture as stored; colours in the order blue, green, red."""
    image: npt.NDArray[Any] | None
    if page == 0:
        image = cv2.imread(os.fspath(file), cv2.IMREAD_UNCHANGED)
    else:
        read, images = cv2.imreadmulti(os.fspath(file), page, 1, flags=cv2.IMREAD_UNCHANGED)
        image = images[0] if read and images else None
    if image is not None:
        return np.asarray(image)
    try:
        image = np.asarray(tifffile.imread(file, key=page))
    except UNREADABLE as error:
        raise InputError(f"image file: {file}: can't be read as a picture") from error
    if image.ndim == 3 and image.shape[2] == 3:
        image = image[..., ::-1]
    return image
