"""Pictures of one camera as a sequence: a folder, files, pages of a TIFF, a video, or arrays.

Whoever measures a series takes pictures from here one after the other, and need not know where they
lie. A file is read when its picture is asked for and isn't kept, so that a series may be longer
than the memory.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, overload

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float
from gpusim.arrays.grey import grey_of
from gpusim.errors import InputError
from gpusim.files.cine_file import read_cine
from gpusim.files.input_file import open_input
from gpusim.files.photron_file import PHOTRON, read_photron
from gpusim.files.picture_file import pages_of, picture_file, read_grey, read_stored
from gpusim.files.picture_tags import TIFF_MAGIC
from gpusim.files.recording import Image, Recording, read_times
from gpusim.files.video_container import CONTAINERS, read_container
from gpusim.validation import real_numbers, require, unmasked

Frames = str | os.PathLike[str] | Image | Iterable[str | os.PathLike[str] | Image]
"""What `read_frames` takes."""

SUFFIXES = (".png", ".tif", ".tiff", ".jpg", ".jpeg", ".bmp")
"""Files of a folder that are pictures."""
VIDEOS: dict[str, Callable[[Path], Recording]] = {
    **dict.fromkeys(CONTAINERS, read_container),
    **dict.fromkeys(PHOTRON, read_photron),
    ".cine": read_cine,
}
"""Files of many frames with their times, by suffix."""
BOARD_FRAMES = "calib-"
"""How the names of a run's pictures of a board begin."""


class FrameSource(Sequence[Image]):
    """Pictures in the order in which they were taken; made by `read_frames` and `read_video`.

    ``frames[k]`` reads picture k, at the bit depth that it has: (H, W) grey, of `read_video` also
    (H, W, 3) in colour; or the array as it was given. ``frames[1:]`` are others of the same series,
    not read yet.

    Attributes
    ----------
    names : of each picture: its path, ``stack.tif#3`` for the third page of a file, ``film.mkv#3``
        for the third frame of a video; or its number.
    times : (N,) when each was taken, s; NaN if nobody said.
    times_guessed : how they were guessed, of a video that says no more than the rate at which it is
        played; "" if they weren't.
    notes : what else is to be known of the files: that one is cut off.
    line_time : s from one row's exposure to the next's, of a rolling shutter, ``times`` being those
        of the first row; 0 if nobody said.

    Examples
    --------
    >>> frames = gs.read_frames(["before.png", "after.png"], times=[0, 0.5])
    >>> len(frames), frames[1].shape, frames.names[1], frames.times[1]
    (2, (120, 160), 'after.png', np.float64(0.5))
    """

    def __init__(
        self,
        frames: Image | Sequence[Image | Callable[[], Image]],
        names: Sequence[str],
        times: Float,
        times_guessed: str = "",
        notes: Sequence[str] = (),
        line_time: float = 0.0,
    ) -> None:
        self._frames, self.names, self.times, self.line_time = frames, names, times, line_time
        self.times_guessed, self.notes = times_guessed, tuple(notes)

    def __len__(self) -> int:
        return len(self._frames)

    @overload
    def __getitem__(self, number: int) -> Image: ...
    @overload
    def __getitem__(self, number: slice) -> FrameSource: ...
    def __getitem__(self, number: int | slice) -> Image | FrameSource:
        """One picture, read; or part of the series, not read yet."""
        if isinstance(number, slice):
            frames, names, times = self._frames[number], self.names[number], self.times[number]
            known = self.times_guessed, self.notes, self.line_time
            return FrameSource(frames, names, times, *known)
        frame = self._frames[number]
        return frame() if callable(frame) else frame

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
    if isinstance(source, FrameSource):
        frames = source
    elif isinstance(source, np.ndarray):
        got = f"one array of shape {source.shape}"
        require(source.ndim in (3, 4), "frames", got, "(N, H, W), or (N, H, W, 3) in colour")
        names = [f"frame {number}" for number in range(len(source))]
        frames = FrameSource(source, names, np.full(len(source), np.nan))
    else:
        one = isinstance(source, str | os.PathLike) or not isinstance(source, Iterable)
        frames = _joined([source] if one else source)
    if len(frames) == 0:
        raise InputError("frames: got none; expected at least one picture")
    if times is None:
        return frames
    known = real_numbers(times, "read_frames times")
    if known.shape != (len(frames),):
        raise InputError(f"times: got shape {known.shape}; expected ({len(frames)},), one a frame")
    return FrameSource(frames._frames, frames.names, known, "", frames.notes, frames.line_time)


def _joined(parts: Any) -> FrameSource:
    """Files, folders and single pictures, one after the other."""
    frames: list[Image | Callable[[], Image]] = []
    names: list[str] = []
    times: list[float] = []
    guesses: list[str] = []
    notes: list[str] = []
    line_time = 0.0
    for part in parts:
        if isinstance(part, np.ndarray):
            names.append(f"frame {len(frames)}")
            frames.append(part)
            times.append(np.nan)
        elif isinstance(part, str | os.PathLike):
            files = read_video(part)
            frames += [partial(_grey, files, number) for number in range(len(files))]
            names += files.names
            times += list(files.times)
            guesses += [files.times_guessed] * bool(files.times_guessed)
            notes += files.notes
            line_time = files.line_time
        else:
            raise InputError(f"frames: got {part!r}; expected a file, a folder or an array")
    return FrameSource(frames, names, np.array(times), "; ".join(guesses), notes, line_time)


def _grey(frames: FrameSource, number: int) -> Image:
    return np.ascontiguousarray(grey_of(frames[number]))


def read_video(path: str | os.PathLike[str]) -> FrameSource:
    """Frames of a video as they are stored, in grey or in colour; none of them is read yet.

    A frame is decoded when it is asked for and isn't kept. One after the other is fastest; for any
    other, decoding begins at the key frame before it.

    Parameters
    ----------
    path : an AVI, Matroska, MP4 or MOV file; Photron's .cih or .cihx with its .mraw or pictures;
        Vision Research's .cine; a TIFF of many pages; a folder of pictures. ``film.mkv#3`` is its
        third frame alone.

    Returns
    -------
    FrameSource
        Its ``times`` (N,), s, are those of a table that `write_video` wrote beside it; else those
        in the file, which counts from its own beginning or from the trigger; else guessed, which
        ``times_guessed`` says; NaN for pictures without.

    Raises
    ------
    InputError
        A file that isn't there, is no video, or has no frame that is whole. Frames that are missing
        at its end are a note, and a damaged one is an error when it is read.

    Examples
    --------
    >>> video = gs.read_video("film.mkv")
    >>> len(video), video[2].shape, video[2].dtype, video.times[:3], video.times_guessed
    (5, (57, 33), dtype('uint16'), array([0.    , 0.0005, 0.001 ]), '')
    >>> [frame.max() for frame in video[1:3]]
    [np.uint16(1), np.uint16(2)]
    """
    paths = picture_paths(path)
    file, page = picture_file(path)
    read = VIDEOS.get(file.suffix.lower())
    if read is None or file.is_dir():
        table = read_times(file, np.arange(len(paths))) if page is None else None
        times, line_time = table or (np.full(len(paths), np.nan), 0.0)
        names, frames = [str(one) for one in paths], [partial(read_stored, one) for one in paths]
        return FrameSource(frames, names, times, line_time=line_time)
    found = read(file)
    count = len(found.times)
    names = [f"{file}#{number + 1}" for number in range(count)]
    frames = [partial(found.frame, number) for number in range(count)]
    table = read_times(file, np.arange(count) if found.numbers is None else found.numbers)
    times, line_time = table or (found.times, 0.0)
    guess = "" if table else found.times_guessed
    video = FrameSource(frames, names, times, guess, found.notes, line_time)
    if page is None:
        return video
    require(1 <= page <= count, f"video: {file}", f"frame {page}", f"1 to {count}")
    return video[page - 1 : page]


def read_still(path: str | os.PathLike[str]) -> Image:
    """One picture in grey: that of a file, or a page or frame of it by name, as ``film.mkv#3``."""
    file, page = picture_file(path)
    if file.suffix.lower() not in VIDEOS:
        return read_grey(path)
    frames = read_frames(path)
    named = f"one: name it, as {file.name}#1 (1 to {len(frames)})"
    require(page is not None or len(frames) == 1, f"video: {file}", f"{len(frames)} frames", named)
    return frames[0]


def picture_paths(
    path: str | os.PathLike[str], what: str = "frames", boards: bool = False
) -> list[Path]:
    """A video, a file, all its pages by name, or a folder's pictures in the order of their names.

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
    if picture_file(place)[0].suffix.lower() in VIDEOS:
        return [place]
    with open_input(picture_file(place)[0], "a picture") as stream:
        stack = stream.read(4) in TIFF_MAGIC  # others aren't read before they are asked for
    return pages_of(place) if stack else [place]
