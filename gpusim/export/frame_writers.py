"""What writes the frames of each kind of file: FFV1 and previews, Photron's .mraw, pictures.

A writer is made for its first frame, whose size and type all others share. It writes to a temporary
name, which the stack that it is given renames or removes; ``stored`` reads a frame of it back.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from gpusim.errors import require
from gpusim.export.images import write_image
from gpusim.files.atomic_files import atomic_path, atomic_stream, write_text
from gpusim.files.frame_source import SUFFIXES
from gpusim.files.output_folder import inside
from gpusim.files.picture_file import read_stored
from gpusim.files.recording import Image
from gpusim.files.video_container import RATE_TAG, START_TAG, read_container

SLOWED = 25  # frames a second at which a video is played whose own rate its container can't hold


class Writer(Protocol):
    """Of one kind of file."""

    lossless: bool
    place: Path
    """What `read_video` reads."""

    def write(self, image: Image) -> None:
        """Add a frame."""

    def finish(self) -> None:
        """All frames are written."""

    def stored(self) -> Callable[[int], Image]:
        """What reads frame k back, before the file has its name."""

    def sign(self, times: Sequence[float]) -> None:
        """The file has its name: write what belongs beside it."""


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
    preview: bool = True
    sides: int = 1


FFV1 = Codec("matroska", "ffv1", {"level": "3", "slicecrc": "1", "g": "1"}, 500.0,
             {"rgb24": "bgr0"}, preview=False)  # fmt: skip
"""Key frames alone; a checksum finds damage. Matroska's clock has 1 ms."""
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
        self.lossless = not codec.preview
        self.part = stack.enter_context(atomic_path(path))
        options = dict(codec.container_options)
        self.container: Any = av.open(str(self.part), "w", codec.container, options)
        stack.callback(self.container.close)
        self.container.metadata.update({RATE_TAG: repr(take.rate), START_TAG: repr(take.time)})
        played = take.rate if take.rate <= codec.fastest else SLOWED
        rate = Fraction(played).limit_denominator(10_000)
        options = dict(codec.options)
        stream: Any = self.container.add_stream(codec.name, rate=rate, options=options)
        image = self._prepared(take.image)
        self.format = _FORMATS[image.ndim, image.itemsize]
        stream.height, stream.width = image.shape[:2]
        stream.pix_fmt = codec.formats.get(self.format, self.format)
        if self.lossless:  # slices are independent; H.264 has threads of its own
            stream.codec_context.thread_type = "SLICE"
        self.stream = stream

    def write(self, image: Image) -> None:
        import av

        frame = av.VideoFrame.from_ndarray(self._prepared(image), format=self.format)
        frame = frame.reformat(format=self.stream.pix_fmt)
        frame.pts, self.count = self.count, self.count + 1
        self.container.mux(self.stream.encode(frame))

    def finish(self) -> None:
        self.container.mux(self.stream.encode())
        self.container.close()

    def stored(self) -> Callable[[int], Image]:
        return read_container(self.part).frame

    def sign(self, times: Sequence[float]) -> None:
        """A video holds all."""

    def _prepared(self, image: Image) -> Image:
        """As it is stored; of previews the upper 8 bits, with edges repeated."""
        if not self.codec.preview:
            return np.ascontiguousarray(image)
        if image.itemsize > 1:
            image = (image >> max(self.take.bits - 8, 0)).astype(np.uint8)
        more = [(0, -size % self.codec.sides) for size in image.shape[:2]]
        more += [(0, 0)] * (image.ndim - 2)
        return np.ascontiguousarray(np.pad(image, more, mode="edge"))


class PhotronWriter:
    """A .mraw, and the .cih that says what is in it."""

    lossless = True

    def __init__(self, path: Path, take: Take, stack: ExitStack) -> None:
        self.place, self.take = path, take
        self.stream = stack.enter_context(atomic_stream(path.with_suffix(".mraw")))

    def write(self, image: Image) -> None:
        self.stream.write(image.astype(image.dtype.newbyteorder("<"), copy=False).tobytes())

    def finish(self) -> None:
        self.stream.flush()

    def stored(self) -> Callable[[int], Image]:
        first, name = self.take.image, self.stream.name
        kind = first.dtype.newbyteorder("<")

        def frame(number: int) -> Image:
            pixels = np.fromfile(name, kind, first.size, offset=number * first.nbytes)
            return pixels.reshape(first.shape)

        return frame

    def sign(self, times: Sequence[float]) -> None:
        image, count = self.take.image, len(times)
        color = image.ndim == 3
        entries = {
            "Record Rate(fps)": f"{self.take.rate:.17g}",
            "Total Frame": count,
            "Original Total Frame": count,
            "Start Frame": round(self.take.time * self.take.rate),
            "Save Step": 1,
            "Image Width": image.shape[1],
            "Image Height": image.shape[0],
            "Color Type": "Color" if color else "Mono",
            "Color Bit": image.itemsize * 8 * (3 if color else 1),
            "File Format": "MRaw",
            "EffectiveBit Depth": self.take.bits,
            "EffectiveBit Side": "Lower",
            "Comment Text": "",
        }
        lines = ["#Camera Information Header", *(f"{key} : {entries[key]}" for key in entries)]
        write_text(self.place, "\n".join(lines) + "\n")


class PictureWriter:
    """A folder of pictures, ``000000.png`` and so on; each is whole as soon as it has its name."""

    lossless = True

    def __init__(self, path: Path, take: Take, stack: ExitStack) -> None:
        self.place, self.suffix, self.count = path.parent, path.suffix, 0
        require(
            path.stem == "*", f"video: {path}", path.name, f"*{path.suffix}, as in frames/*.png"
        )
        there = [one.name for one in self.place.glob("*.*") if one.suffix.lower() in SUFFIXES]
        got = f"pictures in the folder: {sorted(there)[:1]}"
        require(not there, f"video: {path}", got, "a new or empty one")

    def write(self, image: Image) -> None:
        write_image(self._file(self.count), image)
        self.count += 1

    def finish(self) -> None:
        """Pictures are whole as they are written."""

    def stored(self) -> Callable[[int], Image]:
        return lambda number: read_stored(self._file(number))

    def sign(self, times: Sequence[float]) -> None:
        """Pictures hold all."""

    def _file(self, number: int) -> Path:
        return inside(self.place, f"{number:06d}{self.suffix}")
