"""PNG and TIFF, grey and in colour: every pixel comes back, by readers that aren't ours."""

from __future__ import annotations

import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile
from PIL import Image

from gpusim.errors import InputError
from gpusim.export import images
from gpusim.export.images import Picture, read_image, write_image


def noise(height: int, width: int, dtype: type[np.unsignedinteger]) -> Picture:
    rng = np.random.default_rng(height * 7919 + width)
    return rng.integers(0, np.iinfo(dtype).max, (height, width), dtype, endpoint=True)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("suffix", [".png", ".tif", ".tiff"])
@pytest.mark.parametrize("shape", [(33, 57), (1, 1), (1, 5), (700, 1)])
def test_round_trip_by_three_readers(
    tmp_path: Path, dtype: type[np.unsignedinteger], suffix: str, shape: tuple[int, int]
) -> None:
    image = noise(*shape, dtype)
    path = write_image(tmp_path / f"a{suffix}", image)
    for got in (
        read_image(path),
        cv2.imread(str(path), cv2.IMREAD_UNCHANGED),
        tifffile.imread(path) if suffix != ".png" else np.asarray(Image.open(path)),
    ):
        assert got.dtype == image.dtype
        assert np.array_equal(got, image)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("suffix", [".png", ".tif"])
def test_colours_keep_their_order(
    tmp_path: Path, dtype: type[np.unsignedinteger], suffix: str
) -> None:
    """Red comes first; OpenCV's arrays begin with blue, Pillow knows no 16-bit colour."""
    image = np.dstack([noise(33, 57, dtype) // (k + 1) for k in range(3)])
    path = write_image(tmp_path / f"a{suffix}", image)
    others = [cv2.imread(str(path), cv2.IMREAD_UNCHANGED)[..., ::-1]]
    if suffix == ".tif":
        others.append(tifffile.imread(path))
    elif dtype == np.uint8:
        others.append(np.asarray(Image.open(path)))
    images._kept.clear()
    for got in (read_image(path), *others):
        assert got.dtype == image.dtype
        assert np.array_equal(got, image)


def test_drawings_keep_their_colours_and_size(tmp_path: Path) -> None:
    drawing = np.dstack([noise(33, 57, np.uint8) for _ in range(3)])
    drawing[:, :, 1] //= 2
    drawing[:, :, 2] = 255 - drawing[:, :, 2]
    path = write_image(tmp_path / "a.png", drawing[:, ::-1], pixels_per_metre=200 / 0.0254)
    with Image.open(path) as picture:
        picture.verify()
    with Image.open(path) as picture:
        assert picture.info["dpi"] == pytest.approx((200, 200), abs=0.01)
        assert np.array_equal(np.asarray(picture), drawing[:, ::-1])
    assert np.array_equal(cv2.imread(str(path))[:, :, ::-1], drawing[:, ::-1])


def test_png_stream_is_what_zlib_expects(tmp_path: Path) -> None:
    """The deflate stream, its Adler-32 and the filter are right, byte by byte."""
    image = noise(33, 57, np.uint8)
    data = write_image(tmp_path / "a.png", image).read_bytes()
    stream, place = b"", 8
    while place < len(data):
        size = int.from_bytes(data[place : place + 4])
        if data[place + 4 : place + 8] == b"IDAT":
            stream += data[place + 8 : place + 8 + size]
        place += 12 + size
    inflater = zlib.decompressobj()
    lines = np.frombuffer(inflater.decompress(stream), np.uint8).reshape(33, 58)
    assert inflater.eof and not inflater.unused_data
    assert (lines[:, 0] == 2).all()
    assert np.array_equal(np.cumsum(lines[:, 1:], axis=0, dtype=np.uint8), image)


def test_not_contiguous_and_foreign_byte_order(tmp_path: Path) -> None:
    image = noise(66, 114, np.uint16)
    for view in (image[::2, ::-2], image.T, image.astype(">u2")):
        write_image(tmp_path / "a.png", view)
        write_image(tmp_path / "a.tif", view)
        assert np.array_equal(read_image(tmp_path / "a.png"), view)
        assert np.array_equal(read_image(tmp_path / "a.tif"), view)


def test_metadata(tmp_path: Path) -> None:
    image = noise(33, 57, np.uint8)
    text = {"Software": "gpusim 0.1.0", "camera": "front"}
    write_image(tmp_path / "a.png", image, pixels_per_metre=156_000.4, text=text)
    with Image.open(tmp_path / "a.png") as picture:
        assert picture.text == text
        assert picture.info["dpi"] == pytest.approx((156_000 * 0.0254,) * 2)
    write_image(tmp_path / "a.tif", image, pixels_per_metre=156_000.0, text=text)
    with tifffile.TiffFile(tmp_path / "a.tif") as file:
        tags = file.pages.first.tags
        assert tags["ImageDescription"].value == "Software: gpusim 0.1.0\ncamera: front"
        numerator, denominator = tags["XResolution"].value
        assert numerator / denominator == pytest.approx(1560.0)
        assert tags["ResolutionUnit"].value == 3  # centimetre


@pytest.mark.parametrize(
    ("image", "suffix", "options", "message"),
    [
        (np.zeros((3, 4), np.uint8), ".jpg", {}, "expected .png, .tif or .tiff"),
        (np.zeros((3, 4)), ".png", {}, "float64; expected"),
        (np.zeros((3, 4, 2), np.uint8), ".tif", {}, r"\(3, 4, 2\)"),
        (np.zeros((0, 4), np.uint8), ".png", {}, "not empty"),
        (np.zeros((3, 4), np.uint8), ".png", {"pixels_per_metre": float("nan")}, "pixels_per"),
        (np.zeros((3, 4), np.uint8), ".png", {"text": {"k": "日"}}, "Latin-1"),
        (np.zeros((3, 4), np.uint8), ".png", {"text": {"": "x"}}, "key of 1 to 79"),
        (np.zeros((1, 1_000_001), np.uint8), ".png", {}, "1000001.*at most 1000000 px a side"),
    ],
)
def test_bad_input_writes_nothing(
    tmp_path: Path, image: Picture, suffix: str, options: dict[str, object], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        write_image(tmp_path / f"a{suffix}", image, **options)  # type: ignore[arg-type]
    assert list(tmp_path.iterdir()) == []


def test_unreadable_images(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="not found"):
        read_image(tmp_path / "absent.png")
    (tmp_path / "text.png").write_text("no image")
    with pytest.raises(InputError, match="can't be read"):
        read_image(tmp_path / "text.png")
    cv2.imwrite(str(tmp_path / "floats.tif"), np.zeros((5, 4, 3), np.float32))
    with pytest.raises(InputError, match=r"\(5, 4, 3\), float32"):
        read_image(tmp_path / "floats.tif")


def test_what_is_transparent_is_read_as_if_it_were_not(tmp_path: Path) -> None:
    pixels = np.random.default_rng(1).integers(0, 256, (5, 4, 4)).astype(np.uint8)
    cv2.imwrite(str(tmp_path / "clear.png"), pixels)
    assert np.array_equal(read_image(tmp_path / "clear.png"), pixels[..., 2::-1])


def test_an_image_read_again_comes_from_memory_while_the_file_is_the_same(tmp_path: Path) -> None:
    first, second = np.arange(600, dtype=np.uint16).reshape(20, 30), np.full((20, 30), 7, np.uint8)
    path = write_image(tmp_path / "a.png", first)
    read = read_image(path)
    assert read_image(path) is read and not read.flags.writeable
    write_image(path, second)
    again = read_image(path)
    assert np.array_equal(again, second) and np.array_equal(read, first)
    path.unlink()
    with pytest.raises(InputError, match="not found"):
        read_image(path)


def test_the_images_seen_longest_ago_are_forgotten(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(images, "MOST_BYTES", 1500)
    paths = [write_image(tmp_path / f"{k}.png", np.full((20, 30), k, np.uint8)) for k in range(3)]
    read = [read_image(path) for path in paths]
    assert read_image(paths[2]) is read[2] and read_image(paths[1]) is read[1]
    assert read_image(paths[0]) is not read[0] and np.array_equal(read_image(paths[0]), read[0])
    large = write_image(tmp_path / "large.png", np.full((40, 40), 9, np.uint8))
    assert read_image(large) is not read_image(large)
    assert read_image(paths[0]) is read_image(paths[0])
