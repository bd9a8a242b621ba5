"""A recording: the frames of a file, read when they are asked for, and when each was taken.

The times of frames stand in the file, or in a table beside it, which `write_video` writes:
``film.times.csv`` beside ``film.mkv``, ``times.csv`` in a folder of pictures.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float
from gpusim.errors import InputError, require
from gpusim.files.atomic_files import write_text
from gpusim.files.input_file import read_input

Image = npt.NDArray[Any]
COLUMNS = ("frame", "time_s", "line_time_s")
"""Of a table of times: mid exposure of the first row, and from each row to the next."""


@dataclass(frozen=True)
class Recording:
    """What a reader of one kind of file returns.

    Attributes
    ----------
    frame : frame k as it is stored, (H, W) grey or (H, W, 3) red, green and blue.
    times : (N,) when each was taken, s.
    times_guessed : how times were guessed; "" if the file says when frames were taken.
    notes : what else a user has to know of the file: that it is cut off.
    numbers : (N,) of each frame when it was written, where some in between may be lost.
    """

    frame: Callable[[int], Image]
    times: Float
    times_guessed: str = ""
    notes: tuple[str, ...] = ()
    numbers: npt.NDArray[np.int64] | None = None


def times_file(path: Path) -> Path:
    """Where the times of a video or of a folder's pictures are written to."""
    return path / "times.csv" if path.is_dir() else path.with_suffix(".times.csv")


def write_times(path: Path, times: Sequence[float], line_time: float = 0.0) -> Path:
    """Write the table of the times of a video at ``path``, to the last digit."""
    rows = [f"{number},{time!r},{line_time!r}" for number, time in enumerate(map(float, times))]
    return write_text(times_file(path), "\n".join([",".join(COLUMNS), *rows]) + "\n")


def read_times(path: Path, numbers: npt.NDArray[np.int64]) -> tuple[Float, float] | None:
    """The times of frames that a table beside ``path`` gives, and from row to row; None without
    such a table.

    Raises InputError for a damaged table, or one of fewer frames; of a video that was cut off it
    has more.
    """
    file = times_file(path)
    if not file.is_file():
        return None
    table = list(csv.reader(read_input(file, "a table of times").text().splitlines()))
    if not table or tuple(table[0]) != COLUMNS:
        return None  # somebody else's
    got = f"{len(table) - 1} rows"
    count = int(numbers.max()) + 1
    require(len(table) > count, f"{file}", got, f"{count}, one a frame of {path.name}")
    try:
        times = np.array([float(table[1 + number][1]) for number in numbers.tolist()])
        line_time = float(table[1][2])
        if np.isfinite([*times, line_time]).all() and (np.diff(times) > 0).all():
            return times, line_time
    except (ValueError, IndexError):
        pass
    raise InputError(f"{file}: damaged; got times that aren't numbers, or don't grow")
