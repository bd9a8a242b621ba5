"""Damaged pictures: grey values, or one error that names the file, soon and in little memory."""

from __future__ import annotations

import time
import tracemalloc
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile

from gpusim.errors import InputError
from gpusim.files.picture_file import pages_of, read_grey
from tests.hostile.amount import SEED, share
from tests.hostile.mutations import mutations
from tests.hostile.tiny_runs import LIMIT

pytestmark = pytest.mark.hostile

BYTES = 100e6


def picture(path: Path, kind: str) -> bytes:
    """A grey picture of 57 x 33, colour as JPEG."""
    rows, columns = np.mgrid[:33, :57]
    grey = ((rows * 3 + columns * 2) % 256).astype(np.uint8)
    if kind == "tif pages":
        tifffile.imwrite(path, np.stack([grey, 255 - grey]), photometric="minisblack")
    elif kind == "tif deflate":
        tifffile.imwrite(path, 257 * grey.astype(np.uint16), compression="zlib", predictor=True)
    elif kind == "tif tiles":
        tifffile.imwrite(path, grey.astype(np.float32), tile=(16, 16))
    elif kind == "tif opacity":
        both = np.stack([257 * grey.astype(np.uint16), 65535 - 0 * grey.astype(np.uint16)], -1)
        tifffile.imwrite(path, both, photometric="minisblack", extrasamples=["unassalpha"],
                         planarconfig="contig")  # fmt: skip
    elif kind == "pam":
        head = "P7\nWIDTH 57\nHEIGHT 33\nDEPTH 1\nMAXVAL 255\nTUPLTYPE GRAYSCALE\nENDHDR\n"
        path.write_bytes(head.encode() + grey.tobytes())
    elif kind == "hdr":
        cv2.imwrite(str(path), np.repeat(grey[..., None], 3, axis=2).astype(np.float32))
        head = b"FORMAT=32-bit_rle_rgbe\nEXPOSURE=2.0\nCOLORCORR=1 2 1\n"
        path.write_bytes(path.read_bytes().replace(b"FORMAT=32-bit_rle_rgbe\n", head))
    elif kind == "jpg":
        cv2.imwrite(str(path), np.stack([grey, 255 - grey, grey // 2], axis=-1))
    else:
        cv2.imwrite(str(path), 257 * grey.astype(np.uint16) if kind == "png 16" else grey)
    return path.read_bytes()


@pytest.mark.parametrize(
    "kind",
    [
        "png",
        "png 16",
        "tif",
        "tif pages",
        "tif deflate",
        "tif tiles",
        "tif opacity",
        "jpg",
        "bmp",
        "pgm",
        "pam",
        "hdr",
    ],
)
def test_damaged_pictures(kind: str, tmp_path: Path) -> None:
    suffix = kind.split()[0]
    valid = picture(tmp_path / f"valid.{suffix}", kind)
    path = tmp_path / f"damaged.{suffix}"
    for damage, data in mutations(valid, np.random.default_rng(SEED), share(60)):
        told = f"SEED={SEED}, {kind}: {damage}"
        path.write_bytes(data)
        tracemalloc.start()
        began = time.monotonic()
        try:
            for page in pages_of(path):
                assert read_grey(page).ndim == 2, told
        except InputError as error:
            assert str(path) in str(error) and len(str(error)) < 1000, f"{told}: {error}"
        except Exception as error:
            raise AssertionError(f"{told}: {type(error).__name__}: {error}") from error
        finally:
            peak = tracemalloc.get_traced_memory()[1]
            tracemalloc.stop()
        assert peak < BYTES, f"{told}: {peak / 1e6:.0f} MB"
        assert time.monotonic() - began < LIMIT, told
