"""Images written or read lately, kept in memory: a run looks at its own pictures several times.

Taking a 21 Mpx picture, measuring it, drawing markers on it and putting it on a page would decode
the same file five times. A file is known by its path, and is read anew once it isn't the same one.
"""

from __future__ import annotations

import os
from collections import OrderedDict
from threading import Lock
from typing import Any

import numpy.typing as npt

from gpusim.files.atomic_files import PathLike

__all__ = ["MOST_BYTES", "keep", "recall"]

MOST_BYTES = 256 << 20

_Stamp = tuple[int, int, int]
_kept: OrderedDict[str, tuple[_Stamp, npt.NDArray[Any]]] = OrderedDict()
_lock = Lock()


def keep(path: PathLike, image: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Keep what the file ``path`` holds; returns ``image``, which can't be written to any more.

    The images seen longest ago are dropped for it; one of more than `MOST_BYTES` isn't kept.
    """
    image.setflags(write=False)
    stamp = _stamp(path)
    with _lock:
        if stamp is not None and image.nbytes <= MOST_BYTES:
            _kept[os.path.abspath(path)] = stamp, image
            _kept.move_to_end(os.path.abspath(path))
            while sum(own.nbytes for _, own in _kept.values()) > MOST_BYTES:
                _kept.popitem(last=False)
    return image


def recall(path: PathLike) -> npt.NDArray[Any] | None:
    """The image in the file ``path``, read-only, if it is kept and the file is still the same."""
    key, stamp = os.path.abspath(path), _stamp(path)
    with _lock:
        stored, image = _kept.get(key, (None, None))
        if image is None:
            return None
        if stored != stamp:
            del _kept[key]
            return None
        _kept.move_to_end(key)
        return image


def _stamp(path: PathLike) -> _Stamp | None:
    """What changes whenever a file is written or replaced."""
    try:
        found = os.stat(path)
    except (OSError, ValueError):
        return None
    return found.st_ino, found.st_size, found.st_mtime_ns
