"""Pixels of 10 and 12 bits against a text of zeros and ones."""

from __future__ import annotations

import numpy as np
import pytest

from gpusim.files.raw_frames import frame_bytes, pixels_of
from tests.support.cine_bytes import packed


@pytest.mark.parametrize("bits", [10, 12])
@pytest.mark.parametrize("count", [1, 2, 3, 4, 57 * 33])
def test_packed_numbers_are_unpacked(bits: int, count: int) -> None:
    numbers = np.random.default_rng(count).integers(0, 1 << bits, count)
    data = np.frombuffer(packed(numbers, bits), np.uint8)
    assert len(data) == frame_bytes((count,), bits)
    np.testing.assert_array_equal(pixels_of(data, bits)[:count], numbers)


def test_whole_numbers_are_little_endian() -> None:
    data = np.array([1, 2, 3, 4], np.uint8)
    assert pixels_of(data, 8).tolist() == [1, 2, 3, 4]
    assert pixels_of(data, 16).tolist() == [0x201, 0x403]
