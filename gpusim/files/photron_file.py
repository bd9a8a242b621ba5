"""Photron's recordings: a header, .cih or .cihx, and beside it a .mraw of all frames, or pictures.

What a header names is looked for beside it under its own name, so that it can't lead elsewhere:
``film.mraw``, or ``film000001.png`` and so on.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from gpusim.errors import InputError, require
from gpusim.files.input_file import open_input
from gpusim.files.packed_pixels import PACKED, WHOLE, packed_size, pixels_of
from gpusim.files.picture_file import LARGEST, read_stored
from gpusim.files.recording import Image, Recording

PHOTRON = (".cih", ".cihx", ".mraw")
_MOST = 1 << 20  # bytes of a header
_TIFF, _JPEG = (".tif", ".tiff"), (".jpg", ".jpeg")
_PICTURES = {"png": (".png",), "tif": _TIFF, "tiff": _TIFF, "bmp": (".bmp",), "jpeg": _JPEG}
_KEYS = {
    "width": ("Image Width", "imageDataInfo/resolution/width"),
    "height": ("Image Height", "imageDataInfo/resolution/height"),
    "frames": ("Total Frame", "frameInfo/totalFrame"),
    "start": ("Start Frame", "frameInfo/startFrame"),
    "step": ("Save Step", "frameInfo/skipFrame"),
    "rate": ("Record Rate(fps)", "recordInfo/recordRate"),
    "pixel_bits": ("Color Bit", "imageDataInfo/colorInfo/bit"),
    "depth": ("EffectiveBit Depth", "imageDataInfo/effectiveBit/depth"),
    "side": ("EffectiveBit Side", "imageDataInfo/effectiveBit/side"),
    "color": ("Color Type", "imageDataInfo/colorInfo/type"),
    "kind": ("File Format", "imageFileInfo/fileFormat"),
}
"""Of what is needed: its name in .cih, its place in .cihx."""
_USUAL = {"start": "0", "step": "1", "side": "lower", "color": "mono", "depth": "0"}


@dataclass(frozen=True)
class _Header:
    """What a header says: ``pixel_bits`` of a pixel with all its channels, of which in each channel
    ``depth`` are used, the higher or the lower ones."""

    width: int
    height: int
    frames: int
    start: int
    step: int
    rate: float
    pixel_bits: int
    depth: int
    side: str
    color: str
    kind: str

    @property
    def channels(self) -> int:
        return 3 if self.color == "color" else 1

    @property
    def bits(self) -> int:
        """Of a channel of a pixel."""
        return self.pixel_bits // self.channels

    @property
    def shape(self) -> tuple[int, ...]:
        size = self.height, self.width
        return (*size, 3) if self.channels == 3 else size


def read_photron(path: Path) -> Recording:
    """The recording of a .cih, .cihx or .mraw. Raises InputError for what can't be true."""
    if path.suffix.lower() == ".mraw":
        beside = [one for one in path.parent.iterdir() if one.stem == path.stem]
        headers = [one for one in beside if one.suffix.lower() in PHOTRON[:2]]
        require(len(headers) > 0, f"video: {path}", "no header beside it", "its .cih or .cihx")
        path = headers[0]
    header = _header(path)
    if header.kind == "mraw":
        data = path.with_suffix(".mraw")
        size = packed_size(int(np.prod(header.shape)), header.bits)
        with open_input(data, f"the frames of {path.name}") as stream:
            there = stream.seek(0, 2) // size
        read = partial(_frame, data, header, size)
    else:
        files = _pictures(path, _PICTURES[header.kind])
        there = len(files)
        read = partial(_picture, files, header)
    require(there > 0, f"video: {path}", f"no whole frame of {header.frames}", "at least one")
    cut = f"{path}: is cut off: {there} frames of {header.frames}"
    numbers = header.start + header.step * np.arange(min(there, header.frames))
    return Recording(read, numbers / header.rate, notes=(cut,) * (there < header.frames))


def _pictures(header: Path, suffixes: tuple[str, ...]) -> list[Path]:
    """Pictures beside a header whose names are its own and a number."""
    name = re.compile(re.escape(header.stem) + r"\D?\d+")
    files = [one for one in header.parent.iterdir() if one.suffix.lower() in suffixes]
    return sorted(one for one in files if name.fullmatch(one.stem))


def _header(path: Path) -> _Header:
    """Read it, and refuse what no camera writes: no memory is asked for before."""
    with open_input(path, "a header of Photron's") as stream:
        data = stream.read(_MOST)
    xml = path.suffix.lower() == ".cihx"
    found = _from_xml(path, data) if xml else _from_lines(data)
    entries = {name: found.get(name) or _USUAL.get(name) for name in _KEYS}
    values: dict[str, Any] = {}
    for name, text in entries.items():
        key = _KEYS[name][xml]
        require(text is not None, f"video: {path}", f"no {key}", "a header of Photron's")
        if name in ("side", "color", "kind"):
            values[name] = str(text).strip().lower()
            continue
        try:
            values[name] = float(str(text)) if name == "rate" else int(str(text))
        except ValueError:
            raise InputError(f"video: {path}: {key}; got {text!r}; expected a number") from None
    header = _Header(**values)
    pixels = header.width * header.height
    positive = min(header.width, header.height, header.frames, header.step) > 0
    sane = positive and pixels <= LARGEST and header.frames < 1 << 31 and header.depth <= 16
    size = f"{header.frames} frames of {header.width} x {header.height} px, every {header.step}."
    where = f"video: {path}"
    require(sane and abs(header.start) < 1 << 40, where, size, "a recording")
    require(0.0 < header.rate < 1e9, where, f"{header.rate} frames a second", "a rate")
    kinds = ("mraw", *_PICTURES)
    require(header.kind in kinds, where, f"frames as {header.kind}", ", ".join(kinds))
    bits = header.pixel_bits == header.bits * header.channels
    bits &= header.bits in (*WHOLE, *PACKED)
    got = f"{header.pixel_bits} bits of {header.channels} channels"
    require(bits, where, got, "8, 10, 12 or 16 of each")
    return header


def _from_lines(data: bytes) -> dict[str, str]:
    names = {key: name for name, (key, _) in _KEYS.items()}
    lines = (line.split(" : ", 1) for line in data.decode("latin-1").splitlines())
    return {names[line[0].strip()]: line[1] for line in lines
            if len(line) == 2 and line[0].strip() in names}  # fmt: skip


def _from_xml(path: Path, data: bytes) -> dict[str, str]:
    """Of what stands between other bytes."""
    text = data[max(0, data.find(b"<cih>")) : data.rfind(b"</cih>") + len(b"</cih>")]
    try:
        if b"<!" in text:
            raise ValueError("definitions of its own")
        root = ElementTree.fromstring(text.decode("utf-8", "replace"))
    except (ElementTree.ParseError, ValueError) as error:
        raise InputError(f"video: {path}; got {error}; expected a header of Photron's") from None
    return {name: root.findtext(place) or "" for name, (_, place) in _KEYS.items()}


def _frame(file: Path, header: _Header, size: int, number: int) -> Image:
    data = np.fromfile(file, np.uint8, size, offset=number * size)
    got, expected = f"{len(data)} bytes of frame {number + 1}", f"{size}: the file was changed"
    require(len(data) == size, f"video: {file}", got, expected)
    count = int(np.prod(header.shape))
    return _aligned(pixels_of(data, header.bits)[:count].reshape(header.shape), header)


def _picture(files: list[Path], header: _Header, number: int) -> Image:
    return _aligned(read_stored(files[number]), header)


def _aligned(image: Image, header: _Header) -> Image:
    """The numbers that the sensor gave, where they were stored in the upper bits."""
    if header.side == "higher" and image.dtype.itemsize == 2 and 0 < header.depth < header.bits:
        return image >> (header.bits - header.depth)
    return image
