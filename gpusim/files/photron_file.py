"""Photron's recordings: a header, .cih or .cihx, and beside it a .mraw of all frames, or pictures.

What belongs to a header lies beside it and has its name, so that it can't lead elsewhere:
``film.mraw``, or ``film000001.png`` and so on.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar
from xml.etree import ElementTree

import numpy as np

from gpusim.errors import InputError, require
from gpusim.files.input_file import open_input
from gpusim.files.picture_file import LARGEST, read_stored
from gpusim.files.raw_frames import BITS, RawFrames, frame_bytes
from gpusim.files.recording import Image, Recording

PHOTRON = (".cih", ".cihx", ".mraw")
_MOST = 1 << 20  # bytes of a header
_PLACES = {
    "Image Width": "imageDataInfo/resolution/width",
    "Image Height": "imageDataInfo/resolution/height",
    "Total Frame": "frameInfo/totalFrame",
    "Start Frame": "frameInfo/startFrame",
    "Save Step": "frameInfo/skipFrame",
    "Record Rate(fps)": "recordInfo/recordRate",
    "Color Type": "imageDataInfo/colorInfo/type",
    "Color Bit": "imageDataInfo/colorInfo/bit",
    "EffectiveBit Depth": "imageDataInfo/effectiveBit/depth",
    "EffectiveBit Side": "imageDataInfo/effectiveBit/side",
    "File Format": "imageFileInfo/fileFormat",
}
"""Entries of a .cih, and where a .cihx has them."""
Number = TypeVar("Number", int, float)
_PICTURES = {"png": (".png",), "tif": (".tif", ".tiff"), "tiff": (".tif", ".tiff")}


def read_photron(path: Path) -> Recording:
    """The recording of a .cih, .cihx or .mraw. Raises InputError for what can't be true."""
    if path.suffix.lower() == ".mraw":
        headers = [path.with_suffix(suffix) for suffix in PHOTRON[:2]]
        path = next((one for one in headers if one.is_file()), headers[0])
    header = _Header(path)
    height = header.number(int, "Image Height", 1, 65535)
    width = header.number(int, "Image Width", 1, 65535)
    got, expected = f"{width} x {height} px", f"at most {LARGEST / 1e6:.3g} million"
    require(width * height <= LARGEST, f"video: {path}", got, expected)
    count = header.number(int, "Total Frame", 1, 1 << 31)
    start = header.number(int, "Start Frame", -(1 << 31), 1 << 31, 0)
    step = header.number(int, "Save Step", 1, 1 << 31, 1)
    rate = header.number(float, "Record Rate(fps)", 1e-6, 1e9)
    channels = 3 if header.text("Color Type", "mono") == "color" else 1
    bits, rest = divmod(header.number(int, "Color Bit", 8, 48), channels)
    got, expected = f"{bits} bits of {channels} channels", "8, 10, 12 or 16"
    require(not rest and bits in BITS, f"video: {path}", got, expected)
    higher = header.text("EffectiveBit Side", "lower") == "higher"
    unused = bits - header.number(int, "EffectiveBit Depth", 1, bits) if higher else 0
    kind = header.text("File Format", "")
    read: Callable[[int], Image]
    if kind == "mraw":
        shape = (height, width, 3) if channels == 3 else (height, width)
        data, size = path.with_suffix(".mraw"), frame_bytes(shape, bits)
        with open_input(data, f"the frames of {path.name}") as stream:
            there = stream.seek(0, 2) // size
        read = RawFrames(data, shape, bits, size * np.arange(there)).frame
    else:
        require(kind in _PICTURES, f"video: {path}", f"frames as {kind!r}", "mraw, png or tiff")
        files = _numbered(path, _PICTURES[kind])
        there, read = len(files), lambda number: read_stored(files[number])
    require(there > 0, f"video: {path}", f"no whole frame of {count}", "at least one")
    notes = (f"{path}: is cut off: {there} frames of {count}",) if there < count else ()
    times = (start + step * np.arange(min(there, count))) / rate
    return Recording(lambda number: read(number) >> unused, times, notes=notes)


def _numbered(header: Path, suffixes: tuple[str, ...]) -> list[Path]:
    """The pictures beside a header that have its name and a number."""
    name = re.compile(re.escape(header.stem) + r"\D?\d+")
    beside = [one for one in header.parent.iterdir() if one.suffix.lower() in suffixes]
    return sorted(one for one in beside if name.fullmatch(one.stem))


class _Header:
    """The entries of a header, by their names in .cih."""

    def __init__(self, path: Path) -> None:
        self.path = path
        with open_input(path, "a header of Photron's, .cih or .cihx") as stream:
            data = stream.read(_MOST)
        if path.suffix.lower() == ".cihx":
            root = self._root(data)
            self.entries = {name: root.findtext(place) for name, place in _PLACES.items()}
        else:
            lines = [line.partition(" : ") for line in data.decode("latin-1").splitlines()]
            self.entries = {name.strip(): text for name, _, text in lines}

    def _root(self, data: bytes) -> ElementTree.Element:
        """The XML of a .cihx, which stands between other bytes."""
        text = data[max(0, data.find(b"<cih>")) : data.rfind(b"</cih>") + len(b"</cih>")]
        try:
            if b"<!" in text:
                raise ValueError("definitions of its own")
            return ElementTree.fromstring(text.decode("utf-8", "replace"))
        except (ElementTree.ParseError, ValueError) as error:
            what = f"video: {self.path}; got {error}"
            raise InputError(f"{what}; expected a header of Photron's") from None

    def text(self, name: str, usual: str) -> str:
        return (self.entries.get(name) or usual).strip().lower()

    def number(
        self, kind: type[Number], name: str, low: Number, high: Number, usual: Number | None = None
    ) -> Number:
        """An entry from ``low`` to ``high``, both included; ``usual`` if there is none."""
        given = self.entries.get(name)
        if not given and usual is not None:
            return usual
        where, expected = f"video: {self.path}: {name}", f"{low:g} to {high:g}"
        try:
            value = kind(given or "nothing")
        except ValueError:
            raise InputError(f"{where}; got {given!r}; expected {expected}") from None
        require(low <= value <= high, where, given, expected)
        return value
