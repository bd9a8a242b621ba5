"""Kinds of pictures of which decoders give other numbers than are stored, or too much memory."""

from __future__ import annotations

import io
import os
import resource
import struct
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile

from gpusim.errors import InputError
from gpusim.files.picture_file import read_grey, read_picture
from gpusim.files.radiance_file import to_srgb
from gpusim.optics.light.panorama import read_panorama

ROWS, COLUMNS = 4, 6
Tags = Sequence[tuple[int, int, Sequence[int]]]


def tiff(width: int, height: int, data: bytes, bits: int, more: Tags = ()) -> bytes:
    """A TIFF of one strip, tag by tag; ``more``: number, type (3: 16 bits, 4: 32) and values."""
    tags = {256: (4, [width]), 257: (4, [height]), 258: (3, [bits]), 259: (3, [1]), 262: (3, [1]),
            273: (4, [0]), 277: (3, [1]), 278: (4, [height]), 279: (4, [len(data)])}  # fmt: skip
    tags |= {number: (kind, list(values)) for number, kind, values in more}
    begin = 8 + 2 + 12 * len(tags) + 4
    longer = b""
    entries = struct.pack("<H", len(tags))
    sizes = [len(v) * (2 if kind == 3 else 4) for kind, v in tags.values()]
    tags[273] = (4, [begin + sum(size for size in sizes if size > 4)])
    for number, (kind, values) in sorted(tags.items()):
        raw = struct.pack(f"<{len(values)}{'H' if kind == 3 else 'I'}", *values)
        if len(raw) > 4:
            raw, longer = struct.pack("<I", begin + len(longer)), longer + raw
        entries += struct.pack("<HHI", number, kind, len(values)) + raw.ljust(4, b"\0")
    return b"II*\0" + struct.pack("<I", 8) + entries + bytes(4) + longer + data


@pytest.mark.parametrize("kind", ["u1", "u2", "u4", "f2", "f4"])
@pytest.mark.parametrize("planes", ["contig", "separate"])
@pytest.mark.parametrize("channels", [2, 3])
def test_grey_beside_opacity_keeps_its_bits(
    kind: str, planes: str, channels: int, tmp_path: Path
) -> None:
    right = (np.arange(24).reshape(ROWS, COLUMNS) * (1000 if kind == "u2" else 1)).astype(kind)
    stored = np.full((ROWS, COLUMNS, channels), 200, kind)
    stored[..., 0] = right
    options = {"extrasamples": ["unassalpha", "unspecified"][: channels - 1]}
    if planes == "separate":
        stored = np.moveaxis(stored, 2, 0).copy()
    path = tmp_path / "grey.tif"
    tifffile.imwrite(path, stored, photometric="minisblack", planarconfig=planes, **options)
    found = read_grey(path)
    assert found.dtype == kind
    np.testing.assert_array_equal(found, right)


def test_colours_beside_two_more_channels(tmp_path: Path) -> None:
    stored = np.arange(2 * 3 * 5, dtype=np.uint16).reshape(2, 3, 5)
    path = tmp_path / "five.tif"
    extra = ["unassalpha", "unspecified"]
    tifffile.imwrite(path, stored, photometric="rgb", planarconfig="contig", extrasamples=extra)
    np.testing.assert_array_equal(read_picture(path), stored[..., :3])


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (tiff(1, 1, bytes([128, 10, 20]), 8, [(258, 3, [8] * 3), (262, 3, [8]), (277, 3, [3])]),
         "photometric interpretation 8"),
        (tiff(1, 1, bytes(4), 8, [(258, 3, [8] * 4), (262, 3, [5]), (277, 3, [4])]),
         "photometric interpretation 5"),
        (tiff(4, 1, b"\x1b", 2), "numbers of 2 bits"),
        (tiff(4, 1, b"\x1b\x1b", 4), "numbers of 4 bits"),
        (tiff(4, 5, bytes(19), 8), "got 19 bytes; expected 5 rows of 4: the file is cut off"),
    ],
)  # fmt: skip
def test_a_tiff_that_is_not_read_is_one_error(content: bytes, words: str, tmp_path: Path) -> None:
    path = tmp_path / "odd.tif"
    path.write_bytes(content)
    with pytest.raises(InputError, match=rf"odd\.tif: .*{words}"):
        read_picture(path)


def tiles(side: int, tile: int, there: int, count: int) -> bytes:
    size = tile * tile
    at = [200] * there + [0] * (count - there)
    sizes = [size] * there + [0] * (count - there)
    more = [(322, 3, [tile]), (323, 3, [tile]), (324, 4, at), (325, 4, sizes)]
    return tiff(side, side, bytes(size), 8, more)


def test_tiles_are_counted_before_they_are_read(tmp_path: Path) -> None:
    path = tmp_path / "tiles.tif"
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    path.write_bytes(tiles(16000, 1, 300, 500))
    with pytest.raises(InputError, match="got 256000000 tiles or strips in"):
        read_picture(path)
    path.write_bytes(tiles(1600, 16, 16, 10000))
    with pytest.raises(InputError, match="got 16 of 10000 tiles or strips; expected all"):
        read_picture(path)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 200_000


def test_a_copy_of_tiles_that_was_cut_off(tmp_path: Path) -> None:
    path = tmp_path / "cut.tif"
    pixels = np.random.default_rng(1).integers(0, 256, (64, 64), dtype=np.uint8)
    stream = io.BytesIO()
    tifffile.imwrite(stream, pixels, photometric="minisblack", tile=(16, 16))
    path.write_bytes(stream.getvalue())
    np.testing.assert_array_equal(read_picture(path), pixels)
    path.write_bytes(stream.getvalue()[:-300])
    with pytest.raises(
        InputError, match="got 14 of 16 tiles or strips; expected all: the file is cut off"
    ):
        read_picture(path)


@pytest.mark.parametrize(
    "content",
    [
        b"GIF89a" + struct.pack("<HH", 32000, 32000) + bytes(60),
        cv2.imencode(".webp", np.zeros((5, 7), np.uint8))[1].tobytes(),
        cv2.imencode(".jp2", np.zeros((64, 64), np.uint8))[1].tobytes(),
        cv2.imencode(".ras", np.zeros((5, 7), np.uint8))[1].tobytes(),
        b"Pf\n1 1\n-1.0\n" + bytes(4),
    ],
    ids=["gif", "webp", "jp2", "ras", "pfm"],
)
def test_kinds_whose_size_is_not_known_are_refused(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "picture.png"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"picture\.png: damaged, or no picture.*PNG, TIFF, JPEG"):
        read_picture(path)


@pytest.mark.parametrize("most", [255, 1023])
@pytest.mark.parametrize("depth", [1, 2, 3, 4])
def test_a_pam_keeps_its_channels(depth: int, most: int, tmp_path: Path) -> None:
    kind = "u1" if most == 255 else ">u2"
    stored = np.arange(2 * 3 * depth).reshape(2, 3, depth).astype(kind)
    head = f"P7\nWIDTH 3\nHEIGHT 2\nDEPTH {depth}\nMAXVAL {most}\nTUPLTYPE X\nENDHDR\n"
    path = tmp_path / "a.pam"
    path.write_bytes(head.encode() + stored.tobytes())
    right = stored[..., 0] if depth < 3 else stored[..., :3]
    np.testing.assert_array_equal(read_picture(path), right)
    path.write_bytes(head.encode() + stored.tobytes()[:-1])
    with pytest.raises(InputError, match=r"a\.pam"):
        read_picture(path)
    path.write_bytes(
        head.replace("WIDTH 3", "WIDTH 99999").replace("HEIGHT 2", "HEIGHT 99999").encode()
    )
    with pytest.raises(InputError, match="too large; got 99999 x 99999"):
        read_picture(path)


RADIANCES = np.exp2(np.arange(3 * 4 * 3).reshape(3, 4, 3) % 5)  # held exactly by the format


def radiance(
    path: Path, lines: str, size: str = "-Y 3 +X 4", pixels: np.ndarray = RADIANCES
) -> Path:
    data = cv2.imencode(".hdr", pixels[..., ::-1].astype(np.float32))[1].tobytes()
    rows, columns = pixels.shape[:2]
    body = data.partition(f"-Y {rows} +X {columns}\n".encode())[2]
    path.write_bytes(f"#?RADIANCE\n{lines}\n{size}\n".encode() + body)
    return path


RGBE = "FORMAT=32-bit_rle_rgbe\n"


def test_radiance_headers_are_undone(tmp_path: Path) -> None:
    path = tmp_path / "sky.hdr"
    for lines, right in (
        (RGBE, RADIANCES),
        (RGBE + "EXPOSURE=2.0\n", RADIANCES / 2),
        (f"EXPOSURE= 2.0\n{RGBE}EXPOSURE=4\nSOFTWARE=x EXPOSURE=8\n", RADIANCES / 8),
        (RGBE + "COLORCORR=2.0 1.0 0.5\nCOLORCORR=1 1 2\n", RADIANCES / [2, 1, 1]),
        (RGBE + "PRIMARIES=0.64 0.33 0.3 0.6 0.15 0.06 0.3127 0.329\n", RADIANCES),
    ):
        np.testing.assert_allclose(read_panorama(radiance(path, lines)), right, rtol=1e-6)
    for lines, words in (
        (RGBE + "EXPOSURE=nan\n", "EXPOSURE"), (RGBE + "EXPOSURE=0\n", "EXPOSURE"),
        (RGBE + "COLORCORR=1 2\n", "COLORCORR"), ("FORMAT=32-bit_rle_other\n", "FORMAT"),
        (RGBE + "PRIMARIES=0.3 0.3\n", "PRIMARIES"),
    ):  # fmt: skip
        with pytest.raises(InputError, match=rf"sky\.hdr.*{words}"):
            read_panorama(radiance(path, lines))


def test_other_primaries_keep_white_and_luminance(tmp_path: Path) -> None:
    """XYZ's white is (1, 1, 1), and Y the luminance; a primary is seen where sRGB has it."""
    path, one = tmp_path / "sky.hdr", np.ones((3, 4, 3))
    lines = "FORMAT=32-bit_rle_xyze\n"
    np.testing.assert_allclose(read_panorama(radiance(path, lines, pixels=one)), 1.0, rtol=1e-6)
    near = one * [0.5, 0.5, 0.25]
    found = read_panorama(radiance(path, lines, pixels=near))[0, 0]
    # IEC 61966-2-1, of X, Y and Z whose white is D65
    matrix = [[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]]
    right = np.array(matrix) @ (np.array([0.5, 0.5, 0.25]) * [0.9505, 1.0, 1.089])
    np.testing.assert_allclose(found, right, atol=3e-4)
    assert found @ [0.2126, 0.7152, 0.0722] == pytest.approx(0.5, rel=2e-4)
    wide = RGBE + "PRIMARIES=0.708 0.292 0.17 0.797 0.131 0.046 0.3127 0.329\n"  # ITU-R BT.2020
    np.testing.assert_allclose(read_panorama(radiance(path, wide, pixels=one)), 1.0, rtol=1e-6)
    # ITU-R BT.2087, from 2020 to 709
    right = [[1.6605, -0.5876, -0.0728], [-0.1246, 1.1329, -0.0083], [-0.0182, -0.1006, 1.1187]]
    primaries = (0.708, 0.292, 0.17, 0.797, 0.131, 0.046, 0.3127, 0.329)
    np.testing.assert_allclose(to_srgb(primaries), right, atol=1e-4)


@pytest.mark.parametrize("first", ["-Y", "+Y", "-X", "+X"])
@pytest.mark.parametrize("second", ["-", "+"])
def test_rows_of_a_radiance_file_lie_in_any_order(first: str, second: str, tmp_path: Path) -> None:
    """Scan lines run along the second axis; -Y is from the top down, +X from left to right."""
    right = RADIANCES
    stored = right if first[1] == "Y" else right.transpose(1, 0, 2)
    other = "X" if first[1] == "Y" else "Y"
    plain = {"X": "+", "Y": "-"}
    for axis, sign in ((first[1], first[0]), (other, second)):
        if sign != plain[axis]:
            stored = np.flip(stored, axis=0 if axis == first[1] else 1)
    size = f"{first} {stored.shape[0]} {second}{other} {stored.shape[1]}"
    path = radiance(tmp_path / "sky.pic", RGBE, size, np.ascontiguousarray(stored))
    np.testing.assert_allclose(read_panorama(path), right, rtol=1e-6)


@pytest.mark.parametrize("half", [False, True])
def test_panoramas_in_openexr(
    half: bool, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    openexr = pytest.importorskip("OpenEXR")
    from gpusim.export import write_radiance

    for values in (RADIANCES, RADIANCES[..., 0]):
        path = write_radiance(tmp_path / "sky.exr", values.astype(np.float32), half=half)
        np.testing.assert_array_equal(read_panorama(path), values)
    head = {"type": openexr.scanlineimage,
            "chromaticities": (0.708, 0.292, 0.17, 0.797, 0.131, 0.046, 0.3127, 0.329)}  # fmt: skip
    green = np.zeros((2, 3, 3), np.float32) + np.float32([0.2, 1.0, 0.2])
    openexr.File(head, {"RGB": green}).write(str(path))
    right = np.array([0.2, 1.0, 0.2]) @ to_srgb(head["chromaticities"]).T
    np.testing.assert_allclose(read_panorama(path)[0, 0], np.maximum(right, 0.0), rtol=1e-5)
    data = bytearray(path.read_bytes())
    path.write_bytes(data[:-10])
    with pytest.raises(InputError, match=r"sky\.exr: can't be read as a picture"):
        read_panorama(path)
    assert capfd.readouterr() == ("", "")
    at = data.index(b"dataWindow\0box2i\0") + 21
    data[at : at + 16] = struct.pack("<4i", 0, 0, 59999, 49999)
    path.write_bytes(data)
    with pytest.raises(InputError, match="too large; got 60000 x 50000"):
        read_panorama(path)
    openexr.File({}, {"Z": green[..., 0].copy()}).write(str(path))
    with pytest.raises(InputError, match=r"sky\.exr: .*channels Z"):
        read_panorama(path)


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".tif", ".hdr", ".bmp"])
def test_decoders_say_nothing_of_damage(
    suffix: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """In any number of threads; what is printed afterwards is seen."""
    pixels = np.random.default_rng(5).integers(1, 256, (33, 57, 3), dtype=np.uint8)
    data = cv2.imencode(suffix, pixels.astype(np.float32) if suffix == ".hdr" else pixels)[1]
    path = tmp_path / f"cut{suffix}"
    path.write_bytes(data.tobytes()[: data.size // 2])
    capfd.readouterr()

    def refused(_: int) -> bool:
        with pytest.raises(InputError, match=rf"cut\{suffix}"):
            read_picture(path)
        return True

    with ThreadPoolExecutor(4) as pool:
        assert all(pool.map(refused, range(20)))
    assert capfd.readouterr() == ("", "")
    os.write(2, b"seen")
    assert capfd.readouterr().err == "seen"
