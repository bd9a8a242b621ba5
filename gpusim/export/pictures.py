"""Pictures of any kind as grey images, single pages of a stack included."""

from __future__ import annotations

import os
import re
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.files.atomic_files import PathLike
from gpusim.files.input_file import InputFile, read_input
from gpusim.files.picture_file import decode, page_count

__all__ = ["pages_of", "picture_file", "read_grey"]

GREY_WEIGHTS = np.array([0.114, 0.587, 0.299])  # blue, green, red: ITU-R BT.601


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
    """Read any picture as (H, W) grey, at the bit depth that it has.

    Colour becomes luma (ITU-R BT.601) in float32, transparency is dropped. Of a TIFF with several
    pages, ``file.tif#3`` is the third.

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
    if page is None and count > 1:
        raise InputError(
            f"image file: {file}: got {count} pages; expected one: name it, as {file.name}#1 "
            f"(1 to {count})"
        )
    if page is not None and not 1 <= page <= count:
        raise InputError(f"image file: {file}: got page {page}; expected 1 to {count}")
    image = decode(data, 0 if page is None else page - 1)
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


def _read(file: Path) -> InputFile:
    """The file, read once for all of its pages."""
    try:
        found = file.stat()
    except (OSError, ValueError):
        return read_input(file, "a picture")  # which says what is wrong
    return _last(file, (found.st_ino, found.st_size, found.st_mtime_ns))


@lru_cache(maxsize=1)
def _last(file: Path, stamp: tuple[int, int, int]) -> InputFile:
    del stamp  # what changes whenever a file is written or replaced
    return read_input(file, "a picture")
