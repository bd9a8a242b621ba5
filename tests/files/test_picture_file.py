"""Whatever is wrong with a picture is one error that names it, before a large allocation."""

from __future__ import annotations

import io
import os
import resource
import struct
import sys
import zlib
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile
from typer.testing import CliRunner

from gpusim.cli import app
from gpusim.errors import InputError
from gpusim.export.images import read_image
from gpusim.files.input_file import read_input
from gpusim.files.picture_file import decode, pages_of, read_grey
from gpusim.optics.light.panorama import read_panorama
from gpusim.report.html import photo_uri
from gpusim.surface.bitmap import Image

RNG = np.random.default_rng(8)
GREY = RNG.integers(0, 256, (33, 57), dtype=np.uint8)
COLOUR = RNG.integers(0, 256, (33, 57, 3), dtype=np.uint8)


def png(width: int, height: int, rows: bytes = b"") -> bytes:
    def chunk(kind: bytes, data: bytes) -> bytes:
        crc = zlib.crc32(data, zlib.crc32(kind))
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", crc)

    head = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    body = chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + body


def tiff(pixels: np.ndarray, **options: object) -> bytes:
    stream = io.BytesIO()
    tifffile.imwrite(stream, pixels, photometric="minisblack", **options)
    return stream.getvalue()


def encoded(suffix: str, pixels: np.ndarray) -> bytes:
    return bytes(cv2.imencode(suffix, pixels)[1].tobytes())


def large(suffix: str) -> bytes:
    """A few bytes that claim 60000 x 50000 pixels."""
    if suffix == ".png":
        return png(60000, 50000)
    data = bytearray(tiff(GREY) if suffix == ".tif" else encoded(suffix, GREY))
    if suffix == ".jpg":
        at = data.index(b"\xff\xc0") + 5
        data[at : at + 4] = struct.pack(">HH", 50000, 60000)
    elif suffix == ".bmp":
        data[18:26] = struct.pack("<ii", 60000, -50000)
    elif suffix == ".pgm":
        data = bytearray(data.replace(b"57 33", b"60000 50000"))
    else:
        for tag, value in ((256, 60000), (257, 50000)):
            heads = [struct.pack("<HHI", tag, kind, 1) for kind in (3, 4)]
            at = max(data.find(head) for head in heads)
            data[at + 2 : at + 12] = struct.pack("<HII", 4, 1, value)
    return bytes(data)


READERS = {
    "read_grey": read_grey,
    "read_image": read_image,
    "bitmap": lambda path: Image.read(path, 1.0),
    "photo": photo_uri,
}


@pytest.mark.parametrize("suffix", [".png", ".tif", ".jpg", ".bmp", ".pgm"])
@pytest.mark.parametrize("reader", list(READERS))
def test_a_claim_of_three_thousand_million_pixels(reader: str, suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"claim{suffix}"
    path.write_bytes(large(suffix))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(InputError, match=r"claim\S+: too large; got 60000 x 50000 pixels"):
        READERS[reader](path)
    unit = 1 if sys.platform == "darwin" else 1024
    assert (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * unit < 200e6


def test_a_claim_in_a_panorama(tmp_path: Path) -> None:
    path = tmp_path / "claim.hdr"
    data = encoded(".hdr", COLOUR.astype(np.float32))
    path.write_bytes(data.replace(b"-Y 33 +X 57", b"-Y 50000 +X 60000"))
    with pytest.raises(InputError, match="too large; got 60000 x 50000"):
        read_panorama(path)
    array = tmp_path / "claim.npy"
    head = io.BytesIO()
    claim = {"descr": "<f8", "fortran_order": False, "shape": (10**6, 10**6)}
    np.lib.format.write_array_header_1_0(head, claim)
    array.write_bytes(head.getvalue() + bytes(800))
    with pytest.raises(InputError, match=r"claim\.npy"):
        read_panorama(array)


SEEDS = {
    ".png": encoded(".png", GREY),
    ".jpg": encoded(".jpg", COLOUR),
    ".bmp": encoded(".bmp", COLOUR),
    ".tif": tiff(np.stack([GREY, GREY + 1]), compression="zlib", tile=(16, 16)),
    ".tiff": tiff(GREY.astype(np.float16)),
}


@pytest.mark.parametrize("suffix", list(SEEDS))
def test_damaged_files_are_errors_that_name_them(suffix: str, tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    path = tmp_path / f"damaged{suffix}"
    refused = 0
    for number in range(60):
        data = bytearray(SEEDS[suffix])
        if number % 3 == 0:
            data = data[: rng.integers(len(data))]
        end = len(data) if number % 2 else min(len(data), 200)
        for place in rng.integers(0, max(end, 1), 4):
            data[place : place + 1] = bytes([rng.integers(256)])
        path.write_bytes(data)
        try:
            for page in pages_of(path):
                read_grey(page)
            Image.read(path, 1.0)
        except InputError as error:
            assert str(path) in str(error)
            refused += 1
    assert refused >= 10


def test_what_is_whole_is_read(tmp_path: Path) -> None:
    for suffix, data in SEEDS.items():
        path = tmp_path / f"whole{suffix}"
        path.write_bytes(data)
        found = decode(read_input(path), 1 if suffix == ".tif" else 0)
        expected = {".png": GREY, ".bmp": COLOUR, ".tif": GREY + 1}.get(suffix)
        if expected is not None:
            np.testing.assert_array_equal(found, expected)
        assert found.shape[:2] == (33, 57)
    again = Image.read(read_input(tmp_path / "whole.png"), 1.0)
    np.testing.assert_array_equal(again.pixels, GREY)
    stack = pages_of(tmp_path / "whole.tif")
    np.testing.assert_array_equal([read_grey(page) for page in stack], [GREY, GREY + 1])


@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.float16, np.float32])
@pytest.mark.parametrize("planes", ["contig", "separate"])
@pytest.mark.parametrize("opacity", [None, "assocalpha", "unassalpha"])
def test_colours_of_a_tiff_are_those_stored(
    kind: type, planes: str, opacity: str | None, tmp_path: Path
) -> None:
    """However they lie in the file, and whatever it says of how opaque they are."""
    full = 1.0 if np.dtype(kind).kind == "f" else np.iinfo(kind).max
    channels = 3 if opacity is None else 4
    right = (full * np.random.default_rng(2).random((33, 57, channels))).astype(kind)
    stored = right if planes == "contig" else np.moveaxis(right, 2, 0).copy()
    path = tmp_path / "colours.tif"
    options = {} if opacity is None else {"extrasamples": [opacity]}
    tifffile.imwrite(path, stored, photometric="rgb", planarconfig=planes, **options)
    np.testing.assert_array_equal(Image.read(path, 1.0).pixels, right[..., :3])
    luminance = right[..., :3].astype(float) @ [0.2126, 0.7152, 0.0722]
    np.testing.assert_allclose(
        read_grey(path), luminance, rtol=1e-3 if kind is np.float16 else 1e-6
    )
    luma = right[..., :3] / full @ [0.299, 0.587, 0.114]
    grey = Image.read(path, 1.0, channels="grey")
    np.testing.assert_allclose(grey.albedo(), luma, atol=1e-3 if kind is np.float16 else 1e-12)
    if full == 1.0:
        np.testing.assert_array_equal(read_panorama(path), right[..., :3])
    else:
        np.testing.assert_array_equal(read_image(path), right[..., :3])


@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.uint32, np.int16])
def test_white_as_zero_is_inverted_at_any_depth(kind: type, tmp_path: Path) -> None:
    steps = {1: 1, 2: 257, 4: 16843009}[np.dtype(kind).itemsize]
    right = (GREY.astype(np.int64) * steps + np.iinfo(kind).min).astype(kind)
    for name, options in (("plain", {}), ("big", {"bigtiff": True}), ("zlib", {"byteorder": ">"})):
        path = tmp_path / f"{name}.tif"
        tifffile.imwrite(path, ~right, photometric="miniswhite", **options)
        np.testing.assert_array_equal(read_grey(path), right)
    if kind is np.uint16:
        np.testing.assert_array_equal(Image.read(path, 1.0).pixels, right)


def test_white_as_zero_of_floats_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "white.tif"
    tifffile.imwrite(path, GREY.astype(np.float32), photometric="miniswhite")
    with pytest.raises(InputError, match=r"white\.tif: got floats of which white is zero"):
        read_grey(path)


def exif(orientation: int) -> bytes:
    return b"MM\0*" + struct.pack(">IHHHIHHI", 8, 1, 274, 3, 1, orientation, 0, 0)


@pytest.mark.parametrize("orientation", [3, 6])
def test_pictures_are_never_turned(orientation: int, tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "a.tif", GREY, extratags=[(274, "H", 1, orientation, True)])
    data = encoded(".png", GREY)
    crc = struct.pack(">I", zlib.crc32(b"eXIf" + exif(orientation)))
    part = struct.pack(">I", len(exif(orientation))) + b"eXIf" + exif(orientation) + crc
    (tmp_path / "a.png").write_bytes(data[:33] + part + data[33:])
    data = encoded(".jpg", GREY)
    part = b"Exif\0\0" + exif(orientation)
    part = b"\xff\xe1" + struct.pack(">H", len(part) + 2) + part
    (tmp_path / "a.jpg").write_bytes(data[:2] + part + data[2:])
    jpeg = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    for suffix, right in ((".tif", GREY), (".png", GREY), (".jpg", jpeg)):
        for reader in (read_grey, lambda path: Image.read(path, 1.0).pixels):
            with pytest.warns(UserWarning, match=rf"a\{suffix}: got orientation {orientation}, by"):
                found = reader(tmp_path / f"a{suffix}")
            np.testing.assert_array_equal(found, right)


@pytest.mark.parametrize(
    "reader", [read_grey, read_image, read_panorama, pages_of, lambda path: Image.read(path, 1.0)]
)
def test_a_pipe_is_called_one(reader: Callable[[Path], object], tmp_path: Path) -> None:
    path = tmp_path / "pipe.hdr"
    os.mkfifo(path)
    with pytest.raises(InputError, match=r"pipe\.hdr: is a device or pipe; expected a picture"):
        reader(path)
    with pytest.raises(InputError, match=r"not found|no such file"):
        reader(tmp_path / "missing.hdr")


@pytest.mark.parametrize("command", ["dic", "calibrate"])
def test_a_pipe_on_the_command_line(command: str, tmp_path: Path) -> None:
    pipe, whole = tmp_path / "pipe.png", tmp_path / "whole.png"
    os.mkfifo(pipe)
    whole.write_bytes(encoded(".png", GREY))
    given = ["dic", str(whole), str(pipe)] if command == "dic" else ["calibrate", str(pipe)]
    options = [] if command == "dic" else ["--board", "9x8", "--square-mm", "4"]
    result = CliRunner().invoke(app, [*given, *options, "-o", str(tmp_path / "out")])
    assert result.exit_code == 2
    assert "pipe.png: is a device or pipe" in " ".join(result.output.split())


def test_small_copies_between_pages_are_no_pages(tmp_path: Path) -> None:
    path = tmp_path / "stack.tif"
    with tifffile.TiffWriter(path) as writer:
        for image, reduced in ((GREY, 0), (GREY[::2, ::2], 1), (255 - GREY, 0)):
            writer.write(image, photometric="minisblack", subfiletype=reduced)
    np.testing.assert_array_equal(read_grey(f"{path}#2"), 255 - GREY)
