"""Buffers of a processor's own device are mapped, those of cards go through the queue: the same."""

from __future__ import annotations

import numpy as np
import pytest

import gpusim.gpu.context as device_module
from gpusim.errors import DeviceLost
from gpusim.gpu import Device
from gpusim.gpu.adapter import is_processor
from gpusim.gpu.transfer import MAPPABLE
from gpusim.gpu.twin import twin_checks


@pytest.fixture(scope="module", params=["mapped", "queued"])
def either(request: pytest.FixtureRequest) -> Device:
    with pytest.MonkeyPatch.context() as patch:
        if request.param == "queued":
            patch.setattr(device_module, "is_processor", lambda info: False)
        made = Device()
    if request.param == "mapped" and not is_processor(made.info):
        pytest.skip("the memory of a card is its own")
    mapped = request.param == "mapped" and MAPPABLE in made.adapter.features
    assert made.transfer.direct == mapped
    return made


def test_what_is_written_at_any_time_is_what_is_read(either: Device) -> None:
    random = np.random.default_rng(5)
    expected = random.integers(0, 256, 4099).astype(np.uint8)
    buffer = either.buffer(expected, "bytes")
    for offset, size in [(3, 1), (0, 4099), (4093, 6), (8, 16), (12, 4)]:
        # not submitted before it is read
        piece = random.integers(0, 256, size).astype(np.uint8)
        buffer.write(piece, offset)
        expected[offset : offset + size] = piece
        np.testing.assert_array_equal(buffer.read(np.uint8, (size,), offset), piece)
        np.testing.assert_array_equal(buffer.read(np.uint8), expected)


def test_what_is_read_is_a_copy_that_may_be_written(either: Device) -> None:
    buffer = either.buffer(np.arange(6, dtype=np.float32), "six")
    first = buffer.read(np.float32)
    first[:] = -1.0
    buffer.write(np.array([7.0], np.float32), 20)
    assert (first == -1.0).all()
    assert buffer.read(np.float32).tolist() == [0.0, 1.0, 2.0, 3.0, 4.0, 7.0]


def test_a_buffer_may_be_seen_without_a_copy_and_used_again(either: Device) -> None:
    table = np.arange(35, dtype=np.float32).reshape(5, 7)
    buffer = either.buffer(table, "table")
    with buffer.seen(np.float32, (4, 7), 28) as values:
        assert not values.flags.writeable or not either.transfer.direct
        np.testing.assert_array_equal(values, table[1:])
    with pytest.raises(ValueError, match="the caller's own"), buffer.seen(np.float32):
        raise ValueError("the caller's own")
    np.testing.assert_array_equal(buffer.read(np.float32, (5, 7)), table)


@pytest.mark.parametrize(
    "stage",
    ["optics/edge_pixels/scatter", "optics/edge_pixels/resolve", "optics/shading/forward_pass"],
)
def test_stages_find_the_same_either_way(either: Device, stage: str) -> None:
    twin_checks()[stage](either)


def test_a_lost_device_says_so(either: Device) -> None:
    buffer = either.buffer(np.zeros(3, np.uint32), "gone")
    either.gpu.destroy()
    with pytest.raises(DeviceLost, match="reading gone"):
        buffer.read(np.uint32)
