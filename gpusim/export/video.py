"""Video out: frames go to a sink one by one, and are in a file when the sink is closed."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from functools import partial
from itertools import zip_longest
from pathlib import Path
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from gpusim.errors import GpusimError, InputError, require
from gpusim.export.frame_writers import (
    FFV1,
    GIF,
    MP4,
    ContainerWriter,
    PhotronWriter,
    PictureWriter,
    Take,
    Writer,
)  # fmt: skip
from gpusim.files.atomic_files import PathLike
from gpusim.files.frame_source import FrameSource, read_video
from gpusim.files.output_folder import delete
from gpusim.files.recording import Image, times_file, write_times
from gpusim.validation import Finite, Positive, checked, real_numbers, unmasked

WRITERS: dict[str, Callable[[Path, Take, ExitStack], Writer]] = {
    ".mkv": partial(ContainerWriter, FFV1),
    ".mp4": partial(ContainerWriter, MP4),
    ".gif": partial(ContainerWriter, GIF),
    ".cih": PhotronWriter,
    ".png": PictureWriter,
    ".tif": PictureWriter,
}
DEPTHS = (8, 10, 12, 14, 16)


@unmasked()
class VideoSink:
    """A video that is written while its frames are made; memory holds one of them.

    Closed, as by the end of ``with``, it has its name, and its times stand in a table beside it;
    where an error ends the block, nothing is left of it (of pictures in a folder, those written).

    Parameters
    ----------
    path : ``.mkv`` (FFV1: without loss, 8 and 16 bits, grey and colour), ``.cih`` (Photron's, with
        a .mraw), ``folder/*.png`` or ``folder/*.tif`` (pictures), or a preview with loss: ``.mp4``
        (H.264), ``.gif``.
    frame_rate : Hz, at which frames are taken. A container plays a video slower whose rate it can't
        hold (above 500 Hz in .mkv, 60 in .mp4, 50 in .gif), and says the true one in its metadata.
    bits : that the numbers have, if fewer than their type: 8, 10, 12, 14 or 16.
    line_time : s from one row's exposure to the next's, of a rolling shutter; for the table.
    verify : read the file back when it is closed and compare all frames bit for bit; not previews.

    Examples
    --------
    >>> with gs.export.VideoSink("wave.mkv", frame_rate=2000.0, bits=12) as sink:
    ...     for number in range(3):
    ...         sink.append(np.full((57, 33), 100 * number, np.uint16), number / 2000)
    >>> gs.read_video("wave.mkv").times
    array([0.    , 0.0005, 0.001 ])
    """

    @checked
    def __init__(
        self,
        path: str | PathLike,
        frame_rate: Positive,
        *,
        bits: int | None = None,
        line_time: Finite = 0.0,
        verify: bool = True,
    ) -> None:
        self.path, self.frame_rate, self.bits = Path(path), float(frame_rate), bits
        self.line_time, self.verify = line_time, verify
        suffix = self.path.suffix.lower()
        known = suffix in WRITERS
        require(known, f"video: {path}", f"suffix {suffix!r}", ", ".join(WRITERS))
        require(bits is None or bits in DEPTHS, "bits", bits, f"one of {DEPTHS}")
        self._stack = ExitStack()
        self._writer: Writer | None = None
        self._times: list[float] = []
        self._hashes: list[bytes] = []
        self._closed = False

    def append(self, image: Image, time: float) -> None:
        """Add a frame. Raises InputError for one of another size or type than the first, numbers
        of more ``bits``, or a time that isn't after the last one's."""
        image, number = np.asarray(image), len(self._times)
        where = f"video: {self.path}: frame {number}"
        require(not self._closed, where, "a sink that is closed", "an open one")
        writer = self._writer = self._writer or self._begun(image, time)
        first = self._take.image
        got, expected = (f"shape {one.shape}, {one.dtype}" for one in (image, first))
        require(got == expected, where, got, f"{expected} as the first frame")
        most = (1 << self._take.bits) - 1
        require(int(image.max()) <= most, where, f"{image.max()}", f"at most {most}")
        after = np.isfinite(time) and (number == 0 or time > self._times[-1])
        require(bool(after), where, f"time {time} s", "a later one than of the frame before")
        writer.write(image)
        self._times.append(float(time))
        if self.verify and writer.lossless:
            self._hashes.append(_hash(image))

    def close(self) -> None:
        """Raises InputError without a frame, GpusimError if one doesn't come back as it was, of
        which no film is left. A second time it does nothing."""
        if self._closed:
            return
        self._closed = True
        with self._stack:
            if self._writer is None:
                raise InputError(f"video: {self.path}: got no frame; expected at least one")
            self._writer.finish(self._times)
        place = self._writer.place
        times = times_file(place)
        delete(times.parent, times.name)  # those of the film which was there
        write_times(place, self._times, self.line_time)
        stored = map(_hash, read_video(place)) if self._hashes else ()
        for number, (back, given) in enumerate(zip_longest(stored, self._hashes)):
            if back != given:
                if place.is_file():
                    delete(times.parent, times.name)
                    delete(place.parent, place.name)
                raise GpusimError(f"video: {self.path}: frame {number} isn't as it was given")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: Any) -> None:
        if any(error):
            self._closed = True
            self._stack.__exit__(*error)
        else:
            self.close()

    def _begun(self, image: Image, time: float) -> Writer:
        picture = image.ndim == 2 or image.shape[2:] == (3,)
        known = picture and image.size > 0 and image.dtype in (np.uint8, np.uint16)
        got = f"shape {image.shape}, {image.dtype}"
        require(known, f"video: {self.path}", got, "(H, W) or (H, W, 3), uint8 or uint16")
        self._take = Take(image, float(time), self.frame_rate, self.bits or 8 * image.itemsize)
        return WRITERS[self.path.suffix.lower()](self.path, self._take, self._stack)


def _hash(image: Image) -> bytes:
    return hashlib.sha256(image.tobytes()).digest()


@unmasked("frames")
def write_video(
    path: PathLike,
    frames: FrameSource | Iterable[Image],
    *,
    times: npt.ArrayLike | None = None,
    frame_rate: float | None = None,
    bits: int | None = None,
    line_time: float = 0.0,
    verify: bool = True,
) -> Path:
    """Write a video frame by frame, with a table of its times beside it; memory holds one frame.

    Parameters
    ----------
    path, bits, line_time, verify : as of `export.VideoSink`, which takes frames one by one.
    frames : (H, W) or (H, W, 3), uint8 or uint16: of `read_video`, an array, or made as they are
        asked for.
    times : (N,) mid exposure of each, s.
    frame_rate : Hz; in place of ``times`` for frames taken regularly, from 0 on. Without both,
        times are those of ``frames``.

    Returns
    -------
    Path
        ``path``.

    Raises
    ------
    InputError
        Frames of different sizes or of other types, times that don't grow or aren't as many, a
        place that can't be written to.

    Examples
    --------
    >>> ramp = np.arange(57 * 33, dtype=np.uint16).reshape(57, 33)
    >>> path = gs.write_video("ramp.mkv", [ramp, ramp + 5], frame_rate=2000.0, bits=12)
    >>> (gs.read_video(path)[1] == ramp + 5).all()
    np.True_
    """
    if times is None and frame_rate is None and isinstance(frames, FrameSource):
        times = frames.times
    taken = None if times is None else real_numbers(times, "write_video times")
    if taken is not None:
        grow = taken.ndim == 1 and np.isfinite(taken).all() and (np.diff(taken) > 0).all()
        require(bool(grow), "times", "some that aren't after others", "growing times, s")
        frame_rate = frame_rate or (1.0 / float(np.diff(taken).mean()) if len(taken) > 1 else 1.0)
    if frame_rate is None:
        raise InputError("write_video: got neither; expected `times` or `frame_rate`")
    number = -1
    with VideoSink(path, frame_rate, bits=bits, line_time=line_time, verify=verify) as sink:
        for number, image in enumerate(frames):
            if taken is None:
                sink.append(image, number / frame_rate)
            elif number < len(taken):
                sink.append(image, float(taken[number]))
        if taken is not None and number + 1 != len(taken):
            raise InputError(f"times: got {len(taken)}; expected {number + 1}, one a frame")
    return Path(path)
