"""Pictures of one camera as a sequence: a folder, files, the pages of a TIFF, or arrays.

Whoever measures a series takes pictures from here one after the other, and need not know where they
lie. A file is read when its picture is asked for and isn't kept, so that a series may be longer
than the memory.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, overload

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float
from gpusim.errors import InputError
from gpusim.files.input_file import open_input
from gpusim.files.picture_file import pages_of, picture_file, read_grey
from gpusim.files.picture_tags import TIFF_MAGIC
from gpusim.validation import real_numbers, require, unmasked

Image = npt.NDArray[Any]
Frames = str | os.PathLike[str] | Image | Iterable[str | os.PathLike[str] | Image]
"""What `read_frames` takes."""

SUFFIXES = (".png", ".tif", ".tiff", ".jpg", ".jpeg", ".bmp")
"""Files of a folder that are pictures."""
BOARD_FRAMES = "calib-"
"""How the names of a run's pictures of a board begin."""


class FrameSource(Sequence[Image]):
    """Pictures in the order in which they were taken; made by `read_frames`.

    ``frames[k]`` reads picture k: (H, W) grey of a file, at the bit depth that it has, or the array
    as it was given. ``frames[1:]`` are others of the same series, not read yet.

    Attributes
    ----------
    names : of each picture: its path, ``stack.tif#3`` for the third page of a file; or its number.
    times : (N,) when each was taken, s; NaN if nobody said.

    Examples
    --------
    >>> frames = gs.read_frames(["before.png", "after.png"], times=[0, 0.5])
    >>> len(frames), frames[1].shape, frames.names[1], frames.times[1]
    (2, (120, 160), 'after.png', np.float64(0.5))
    """

    def __init__(
        self,
        frames: Image | Sequence[Path | Image],
        names: Sequence[str],
        times: Float,
    ) -> None:
        self._frames, self.names, self.times = frames, names, times

    def __len__(self) -> int:
        return len(self._frames)

    @overload
    def __getitem__(self, number: int) -> Image: ...
    @overload
    def __getitem__(self, number: slice) -> FrameSource: ...
    def __getitem__(self, number: int | slice) -> Image | FrameSource:
        """One picture, read; or part of the series, not read yet."""
        if isinstance(number, slice):
            return FrameSource(self._frames[number], self.names[number], self.times[number])
        frame = self._frames[number]
        return read_grey(frame) if isinstance(frame, Path) else frame

    def __repr__(self) -> str:
        ends = dict.fromkeys(self.names[k] for k in (0, -1) if len(self))
        return f"FrameSource({len(self)} frames: {' … '.join(ends)})"


@unmasked("source")
def read_frames(source: Frames | FrameSource, times: npt.ArrayLike | None = None) -> FrameSource:
    """Pictures as one sequence; none of them is read yet.

    Parameters
    ----------
    source : a folder, whose pictures are taken by name (PNG, TIFF, JPEG, BMP); a file, of a TIFF
        with all its pages; an array (N, H, W), or (N, H, W, 3) in colour; or several files, folders
        and single pictures (H, W), one after the other.
    times : (N,) when each was taken, s.

    Raises
    ------
    InputError
        A file that isn't there, a folder without pictures, or not as many ``times`` as pictures.

    Examples
    --------
    >>> frames = gs.read_frames(np.zeros((20, 57, 33)))
    >>> frames, frames[3:5].names
    (FrameSource(20 frames: frame 0 … frame 19), ['frame 3', 'frame 4'])
    """
    frames: Any
    if isinstance(source, FrameSource):
        frames, names = source._frames, source.names
    elif isinstance(source, np.ndarray):
        got = f"one array of shape {source.shape}"
        require(source.ndim in (3, 4), "frames", got, "(N, H, W), or (N, H, W, 3) in colour")
        frames = source
        names = [f"frame {number}" for number in range(len(source))]
    else:
        one = isinstance(source, str | os.PathLike) or not isinstance(source, Iterable)
        parts: Any = [source] if one else source
        frames = []
        for part in parts:
            if not isinstance(part, str | os.PathLike | np.ndarray):
                raise InputError(f"frames: got {part!r}; expected a file, a folder or an array")
            frames += [part] if isinstance(part, np.ndarray) else picture_paths(part)
        names = [str(frame) if isinstance(frame, Path) else f"frame {number}"
                 for number, frame in enumerate(frames)]  # fmt: skip
    if len(frames) == 0:
        raise InputError("frames: got none; expected at least one picture")
    if times is None:
        known = source.times if isinstance(source, FrameSource) else np.full(len(frames), np.nan)
    else:
        known = real_numbers(times, "read_frames times")
    if known.shape != (len(frames),):
        raise InputError(f"times: got shape {known.shape}; expected ({len(frames)},), one a frame")
    return FrameSource(frames, names, known)


def picture_paths(
    path: str | os.PathLike[str], what: str = "frames", boards: bool = False
) -> list[Path]:
    """A file, all its pages by name, or the pictures in a folder in the order of their names.

    Of a run's own folder of images those are taken that show a calibration board, or the others.
    ``what`` begins the message of an InputError.
    """
    place = Path(path)
    if place.is_dir():
        files = sorted(one for one in place.glob("*.*") if one.suffix.lower() in SUFFIXES)
        files = [one for one in files if one.name.startswith(BOARD_FRAMES) == boards] or files
        if not files:
            raise InputError(f"{what}: {path}: no pictures ({', '.join(SUFFIXES)})")
        return [page for one in files for page in picture_paths(one, what)]
    if not picture_file(place)[0].exists():
        raise InputError(f"{what}: {path}: not found")
    with open_input(picture_file(place)[0], "a picture") as stream:
        stack = stream.read(4) in TIFF_MAGIC  # others aren't read before they are asked for
    return pages_of(place) if stack else [place]
