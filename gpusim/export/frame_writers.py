"""What writes the frames of each kind of file: FFV1 and previews, Photron's .mraw, pictures.

A writer is made for its first frame, whose size and type all others share. It writes to a temporary
name, which the stack that it is given renames, or removes after an error.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from gpusim.errors import require
from gpusim.export.images import write_image
from gpusim.files.atomic_files import atomic_path, atomic_stream
from gpusim.files.frame_source import SUFFIXES
from gpusim.files.output_folder import inside
from gpusim.files.recording import Image
from gpusim.files.video_container import RATE_TAG, START_TAG

SLOWED = 25  # frames a second at which a video is played whose own rate its container can't hold


class Writer(Protocol):
    """Of one kind of file, which `read_video` finds at ``place``."""

    place: Path
    lossless: bool

    def write(self, image: Image) -> None:
        """Add a frame."""

    def finish(self, times: Sequence[float]) -> None:
        """All frames are written, which were taken at these times, s."""


@dataclass(frozen=True)
class Take:
    """How frames were taken: the first of them, when, at which rate (Hz) and depth."""

    image: Image
    time: float
    rate: float
    bits: int


@dataclass(frozen=True)
class Codec:
    """How a container is written.

    ``options`` and ``container_options`` are FFmpeg's. Up to the rate ``fastest``, Hz, its clock
    tells frames apart, or a screen shows them. ``formats`` are those in which pictures are stored
    that it doesn't take as they are; their sides are multiples of ``sides``.
    """

    container: str
    name: str
    options: Mapping[str, str]
    fastest: float
    formats: Mapping[str, str]
    container_options: Mapping[str, str] = field(default_factory=dict)
    lossless: bool = False
    sides: int = 1


FFV1 = Codec("matroska", "ffv1", {"level": "3", "slicecrc": "1", "g": "1"}, 500.0,
             {"rgb24": "bgr0"}, {"fflags": "bitexact"}, lossless=True)  # fmt: skip
"""Key frames alone, with checksums, and no random numbers: the same film is the same bytes.
Matroska's clock has 1 ms. Of 8 bits, a range coder in place of Golomb codes would save 0.3 % of the
bytes and take 2.3 times the time."""
MP4 = Codec("mp4", "libx264", {"crf": "18", "preset": "veryfast"}, 60.0,
            {"gray": "yuv420p", "rgb24": "yuv420p"},
            {"movflags": "faststart+use_metadata_tags"}, sides=2)  # fmt: skip
GIF = Codec("gif", "gif", {}, 50.0, {"rgb24": "rgb8"})
_FORMATS = {(2, 1): "gray", (2, 2): "gray16le", (3, 1): "rgb24", (3, 2): "rgb48le"}
"""By an image's dimensions and bytes."""


class ContainerWriter:
    """A video."""

    def __init__(self, codec: Codec, path: Path, take: Take, stack: ExitStack) -> None:
        import av

        self.codec, self.take, self.place, self.count = codec, take, path, 0
        self.lossless = codec.lossless
        part, options = stack.enter_context(atomic_path(path)), dict(codec.container_options)
        self.container: Any = av.open(str(part), "w", codec.container, options)
        stack.callback(self.container.close)
        self.container.metadata.update({RATE_TAG: repr(take.rate), START_TAG: repr(take.time)})
        played = take.rate if take.rate <= codec.fastest else SLOWED
        rate, options = Fraction(played).limit_denominator(10_000), dict(codec.options)
        stream: Any = self.container.add_stream(codec.name, rate=rate, options=options)
        image = self._prepared(take.image)
        self.format = _FORMATS[image.ndim, image.itemsize]
        stream.height, stream.width = image.shape[:2]
        stream.pix_fmt = codec.formats.get(self.format, self.format)
        if codec is FFV1:  # its slices are independent; H.264 has threads of its own
            stream.codec_context.thread_type = "SLICE"
        self.stream = stream

    def write(self, image: Image) -> None:
        import av

        frame = av.VideoFrame.from_ndarray(self._prepared(image), format=self.format)
        frame = frame.reformat(format=self.stream.pix_fmt)
        frame.pts, self.count = self.count, self.count + 1
        self.container.mux(self.stream.encode(frame))

    def finish(self, times: Sequence[float]) -> None:
        self.container.mux(self.stream.encode())

    def _prepared(self, image: Image) -> Image:
        """As it is stored; of previews the upper 8 bits, with edges repeated."""
        if self.lossless:
            return np.ascontiguousarray(image)
        if image.itemsize > 1:
            image = (image >> max(self.take.bits - 8, 0)).astype(np.uint8)
        more = [(0, -size % self.codec.sides) for size in image.shape[:2]]
        more += [(0, 0)] * (image.ndim - 2)
        return np.ascontiguousarray(np.pad(image, more, mode="edge"))


class PhotronWriter:
    """A .cih, and the .mraw of which it tells."""

    lossless = True

    def __init__(self, path: Path, take: Take, stack: ExitStack) -> None:
        self.place, self.take = path, take
        self.header = stack.enter_context(atomic_stream(path))
        self.frames = stack.enter_context(atomic_stream(path.with_suffix(".mraw")))

    def write(self, image: Image) -> None:
        self.frames.write(image.astype(image.dtype.newbyteorder("<"), copy=False).tobytes())

    def finish(self, times: Sequence[float]) -> None:
        height, width, *channels = self.take.image.shape
        entries = {
            "Record Rate(fps)": f"{self.take.rate:.15g}",
            "Total Frame": len(times),
            "Original Total Frame": len(times),
            "Start Frame": round(self.take.time * self.take.rate),
            "Save Step": 1,
            "Image Width": width,
            "Image Height": height,
            "Color Type": "Color" if channels else "Mono",
            "Color Bit": 8 * self.take.image.itemsize * (3 if channels else 1),
            "File Format": "MRaw",
            "EffectiveBit Depth": self.take.bits,
            "EffectiveBit Side": "Lower",
        }
        lines = ["#Camera Information Header", *(f"{key} : {entries[key]}" for key in entries)]
        self.header.write(("\n".join(lines) + "\n").encode())


class PictureWriter:
    """A folder of pictures, ``000000.png`` and so on; each is whole as soon as it has its name."""

    lossless = True

    def __init__(self, path: Path, take: Take, stack: ExitStack) -> None:
        self.place, self.suffix, self.count = path.parent, path.suffix, 0
        where = f"video: {path}"
        require(path.stem == "*", where, path.name, f"*{path.suffix}, as in frames/*.png")
        there = [one.name for one in self.place.glob("*.*") if one.suffix.lower() in SUFFIXES]
        got = f"pictures in the folder: {sorted(there)[:1]}"
        require(not there, where, got, "a new or empty one")

    def write(self, image: Image) -> None:
        write_image(inside(self.place, f"{self.count:06d}{self.suffix}"), image)
        self.count += 1

    def finish(self, times: Sequence[float]) -> None:
        """Each is written already."""
