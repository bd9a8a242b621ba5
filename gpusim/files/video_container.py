"""Videos in containers: AVI, Matroska, MP4 and MOV, read by FFmpeg's libraries.

The packets of a file are gone through once, without decoding them: that gives the number of
frames, their times and where decoding may begin (key frames). A frame is decoded when it is asked
for: one after the other goes on where the decoder stands, any other begins at its key frame.
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import InputError, require
from gpusim.files.input_file import open_input
from gpusim.files.picture_file import BYTES, LARGEST
from gpusim.files.recording import Image, Recording
from gpusim.parallel.machine import memory_limit

CONTAINERS = (".avi", ".mkv", ".mp4", ".mov", ".m4v", ".webm")
RATE_TAG = "FRAME_RATE_HZ"
"""In the metadata: the rate at which frames were taken, where the file is played slower."""
START_TAG = "START_TIME_S"
_FORMATS = "avi,matroska,webm,mov,mp4,m4a,3gp,3g2,mj2"
"""No list of other files or addresses (HLS, concat) is followed, whatever a file's bytes say."""
_MOST_BOXES = 1_000_000
_COUNTS = re.compile(rb"(?:stsz|stz2).{8}(.{4})|trun.{4}(.{4})", re.DOTALL)
"""The number of samples in an MP4, and in a fragment of it."""
_END = 1.5  # frames: what the last one may end before the file
_FEW, _ONES = 10, 0xFFFFFFFF
_MIRRORED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))


def read_container(path: Path) -> Recording:
    """The recording in a container. Raises InputError for no video, a damaged or too large one."""
    _check_samples(path)
    return _Decoder(path).recording()


def _check_samples(path: Path) -> None:
    """Refuse an MP4 whose tables claim more frames than it has bytes: 20 bytes may claim a
    milliard, of each of which FFmpeg keeps 24."""
    with open_input(path, "a video") as stream:
        end, at = stream.seek(0, 2), 0
        for _ in range(_MOST_BOXES):
            stream.seek(at)
            head = stream.read(16)
            size = int.from_bytes(head[:4], "big")
            size = int.from_bytes(head[8:], "big") if size == 1 else size or end
            if head[4:8] in (b"moov", b"moof"):
                stream.seek(at)
                for found in _COUNTS.finditer(stream.read(min(size, end))):
                    count = int.from_bytes(found[1] or found[2], "big")
                    require(count <= end, f"video: {path}", f"{count} frames", "fewer than bytes")
            at += max(size, 8)
            if at >= end:
                return
    raise InputError(f"video: {path}: got over {_MOST_BOXES} parts; expected fewer")


class _Decoder:
    """A file that is open, and where its decoder stands."""

    def __init__(self, path: Path) -> None:
        import av  # a fifteenth of a second

        self.path = path
        limits = {"max_pixels": str(min(LARGEST, memory_limit() // BYTES))}
        with self._reading("can't be read as a video"):
            options = {"format_whitelist": _FORMATS, "protocol_whitelist": "file", **limits}
            self.container: Any = av.open(
                f"file:{path}", options=options, metadata_errors="replace"
            )
        streams = self.container.streams.video
        require(len(streams) > 0, f"video: {path}", "no pictures", "a video")
        self.stream: Any = streams[0]
        codec = self.stream.codec_context
        require(codec is not None, f"video: {path}", "a codec that isn't known", "another one")
        codec.options = limits
        codec.thread_type = "SLICE"  # frame threads would decode ahead of what is asked for
        self.lock = Lock()
        self.frames: Iterator[Any] = iter(())
        self.next = -1  # number of the frame that `frames` gives next; -1: none
        self._index()

    @contextmanager
    def _reading(self, problem: str) -> Iterator[None]:
        """What goes wrong meanwhile is the file's fault."""
        try:
            yield
        except InputError:
            raise
        except Exception as error:
            reason = " ".join(str(getattr(error, "strerror", "") or error).split())[:200]
            raise InputError(
                f"video: {self.path}: {problem}; got {type(error).__name__}: {reason}; expected a "
                "file that isn't damaged"
            ) from None

    def _index(self) -> None:
        """Stamps of all frames, in the order in which they are shown, and which are key frames."""
        rows, self.broken = [], False
        sums = self.stream.codec_context.name == "ffv1"
        try:
            for packet in self.container.demux(self.stream):
                if packet.size and not packet.is_discard and not packet.is_corrupt:
                    good = sums and checksums_agree(bytes(packet))
                    rows.append((packet.pts, packet.is_keyframe, good))
        except Exception:  # what was read so far is whole
            self.broken = True
        require(len(rows) > 0, f"video: {self.path}", "no frame that is whole", "at least one")
        stamps, keys, good = zip(*rows, strict=True)
        self.stamped = None not in stamps and len(set(stamps)) == len(stamps)
        order = np.argsort(stamps) if self.stamped else np.arange(len(stamps))
        self.stamps = np.array(stamps if self.stamped else order, np.int64)[order]
        self.keys = np.flatnonzero(np.array(keys)[order])
        self.damaged = ~np.array(good)[order] & any(good)  # where none agrees, there are none

    def recording(self) -> Recording:
        """Times as the file has them, and what is to be said of it."""
        count, notes, guess = len(self.stamps), [], ""
        tags = self.container.metadata
        rate = float(self.stream.average_rate or 25)
        unit = float(self.stream.time_base) if self.stamped else 1.0 / rate
        times: Float = self.stamps.astype(np.float64) * unit
        even = times[0] + np.arange(count) / rate
        if (np.abs(times - even) <= min(unit, 0.5 / rate)).all():  # Matroska has milliseconds
            times = even
        span = times[-1] - times[0] + _END / rate
        due = round(self._duration() * rate)
        if self.broken or span < self._duration() or (RATE_TAG in tags and count < due):
            notes.append(f"{self.path}: is damaged or cut off: {count} frames of {due}")
        if self.damaged.any():
            few = ", ".join(map(str, 1 + np.flatnonzero(self.damaged)[:_FEW]))
            notes.append(f"{self.path}: {self.damaged.sum()} frames are damaged: {few}")
        numbers = None
        if RATE_TAG in tags:
            with self._reading(f"tags {RATE_TAG} and {START_TAG}"):
                taken, start = float(tags[RATE_TAG]), float(tags.get(START_TAG, 0.0))
                if not (0.0 < taken < np.inf and np.isfinite(start)):
                    raise ValueError(f"{taken} and {start}")
            numbers = np.rint(times * rate).astype(np.int64)
            times = start + numbers / taken
        elif not self.stamped or "avi" in self.container.format.name:
            times -= times[0]
            guess = f"{self.path}: times are guessed: {rate:.6g} frames a second"
        return Recording(self.frame, times, guess, tuple(notes), numbers)

    def _duration(self) -> float:
        """Of the pictures, s, as the file says; 0 if it doesn't, or of sound and pictures alike."""
        if self.stream.duration:
            return float(self.stream.duration * self.stream.time_base)
        alone = len(self.container.streams) == 1
        return (self.container.duration or 0) / 1e6 if alone else 0.0

    def frame(self, number: int) -> Image:
        """Frame ``number``, decoded. Raises InputError for one that is damaged."""
        with self.lock, self._reading(f"frame {number + 1}: damaged"):
            if self.damaged[number]:
                raise ValueError("another checksum")
            before = int(np.searchsorted(self.keys, number, "right")) - 1
            key = int(self.keys[max(0, before)])
            if not 0 <= self.next <= number or (self.stamped and key > self.next):
                self._begin(key)
            try:
                return _image(self._decoded(number))
            except BaseException:
                self.next = -1
                raise

    def _begin(self, key: int) -> None:
        """Have `frames` begin at a key frame; without stamps, where the file begins."""
        at = int(self.stamps[key]) if self.stamped else 0
        self.container.seek(at, stream=self.stream)
        self.frames, self.next = self.container.decode(self.stream), 0

    def _decoded(self, number: int) -> Any:
        for frame in self.frames:
            if self.stamped:
                self.next = int(np.searchsorted(self.stamps, frame.pts or 0))
            self.next += 1
            if self.next > number:
                break
        else:
            raise EOFError("no such frame")
        if self.next > number + 1 or frame.is_corrupt:
            raise ValueError("what can't be decoded")
        return frame


def checksums_agree(packet: bytes) -> bool:
    """Whether all slices of an FFV1 frame are as they were written, if they have checksums.

    A slice ends with its length (3 bytes), a status and what makes the CRC-32 of all of it 0 (RFC
    9043, 4.9), which zlib counts from the other end of each byte. FFmpeg shows other pixels where
    it doesn't agree, and says nothing.
    """
    end = len(packet)
    while end > 0:
        start = end - 8 - int.from_bytes(packet[max(0, end - 8) : max(0, end - 5)], "big")
        if start < 0 or zlib.crc32(packet[start:end].translate(_MIRRORED), _ONES) != _ONES:
            return False
        end = start
    return True


def _image(frame: Any) -> Image:
    """Grey and RGB as they are stored, whatever their bits; anything else as RGB."""
    name = frame.format.name
    deep = max(part.bits for part in frame.format.components) > 8
    if name.startswith(("gray", "gbrp")) and "f" not in name[4:]:
        image = frame.to_ndarray()
    elif name.startswith(("ya", "mono")):
        image = frame.to_ndarray(format="gray16le" if deep else "gray")
    else:
        image = frame.to_ndarray(format="rgb48le" if deep else "rgb24")
    return np.ascontiguousarray(image)
