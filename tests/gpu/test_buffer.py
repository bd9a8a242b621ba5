"""Buffers: bytes there and back, refusals, and memory that is counted and given back."""

from __future__ import annotations

import gc

import numpy as np
import pytest

from gpusim.errors import DeviceError, InputError, OutOfDeviceMemory
from gpusim.gpu import Device


@pytest.fixture(scope="module")
def single() -> Device:
    """A device that emulates 64-bit floats."""
    return Device(real="double_single")


@pytest.mark.parametrize("size", [1, 2, 3, 4, 5, 7, 16, 17, 1001])
def test_bytes_of_any_number_come_back(device: Device, size: int) -> None:
    data = np.random.default_rng(size).integers(0, 256, size).astype(np.uint8)
    buffer = device.buffer(data, "bytes")
    np.testing.assert_array_equal(buffer.read(np.uint8), data)
    for part in range(min(size, 6)):
        np.testing.assert_array_equal(buffer.read(np.uint8, (part,)), data[:part])


def test_a_write_touches_nothing_else(device: Device) -> None:
    expected = np.arange(23, dtype=np.uint8)
    buffer = device.buffer(expected, "bytes")
    for size in (8, 4, 23, 20):
        piece = np.full(size, 100 + size, np.uint8)
        buffer.write(piece)
        expected[:size] = piece
        np.testing.assert_array_equal(buffer.read(np.uint8), expected)


def test_reads_and_writes_with_shapes(device: Device) -> None:
    table = np.arange(5 * 7, dtype=np.float32).reshape(5, 7)
    buffer = device.buffer(table[:, ::-1], "table")  # not contiguous
    np.testing.assert_array_equal(buffer.read(np.float32, (5, 7)), table[:, ::-1])
    np.testing.assert_array_equal(buffer.read(np.float32, (2, 7)), table[:2, ::-1])
    assert buffer.read(np.float32, (0, 7)).shape == (0, 7)
    buffer.write(np.array([-1.0, -2.0], np.float32))
    assert buffer.read(np.float32, (4,)).tolist() == [-1.0, -2.0, 4.0, 3.0]
    assert device.empty(12, "zeros").read(np.uint32).tolist() == [0, 0, 0]
    assert device.buffer(np.zeros((0, 3), np.float32), "none").read(np.float32).size == 0


def test_reads_and_writes_out_of_bounds_are_refused(device: Device) -> None:
    buffer = device.empty(10, "ten")
    with pytest.raises(InputError, match="reading ten; got 12 bytes"):
        buffer.read(np.uint32, (3,))
    with pytest.raises(InputError, match=r"reading ten; got 10 bytes; .*multiple of 4"):
        buffer.read(np.uint32)
    with pytest.raises(InputError, match=r"reading ten; got shape \(-1,\)"):
        buffer.read(np.uint8, (-1,))
    with pytest.raises(InputError, match="writing ten; got 12 bytes"):
        buffer.write(np.zeros(3, np.uint32))
    with pytest.raises(InputError, match=r"writing ten; got 3 bytes; .*a multiple of 4 or all"):
        buffer.write(np.zeros(3, np.uint8))


@pytest.mark.parametrize("dtype", [np.float64, np.int64, np.uint64, np.complex64, object, "U3"])
def test_types_that_wgsl_lacks_are_refused(device: Device, dtype: object) -> None:
    with pytest.raises(InputError, match="buffer bad: got"):
        device.buffer(np.zeros(3, dtype), "bad")  # type: ignore[call-overload]


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_real_buffers_take_finite_values_only(device: Device, single: Device, bad: float) -> None:
    values = np.ones((4, 3))
    values[2, 1] = bad
    for one in (device, single):
        with pytest.raises(InputError, match=r"u: not finite at index \(2, 1\); got -?(nan|inf)"):
            one.real_buffer(values, "u")
        target = one.real_buffer(np.zeros((4, 3)), "u")
        with pytest.raises(InputError, match=r"u: not finite at index \(2, 1\)"):
            target.write(values)


def test_float32_overflow_is_refused_where_it_would_happen(device: Device, single: Device) -> None:
    values = np.array([1.0, -3.5e38])
    with pytest.raises(InputError, match=r"u: too large .*got 3\.5e\+38; expected at most 3\.4"):
        single.real_buffer(values, "u")
    single.real_buffer(np.array([3.4e38]), "u")
    np.testing.assert_array_equal(device.real_buffer(values, "u").read(), values)


def test_real_values_come_back(device: Device, single: Device) -> None:
    values = np.random.default_rng(2).normal(size=(5, 3)) * 10.0 ** np.arange(-6, 9, 3)[:, None]
    np.testing.assert_array_equal(device.real_buffer(values, "u").read(), values)
    buffer = single.real_buffer(values, "u")
    np.testing.assert_allclose(buffer.read(), values, rtol=2.0**-47, atol=0)
    buffer.write(values[2])
    np.testing.assert_allclose(buffer.read(shape=(3,)), values[2], rtol=2.0**-47, atol=0)
    np.testing.assert_allclose(buffer.read()[1:], values[1:], rtol=2.0**-47, atol=0)
    with pytest.raises(DeviceError, match=r"u holds real values; got .*float32"):
        buffer.read(np.float32)


# --- memory ---------------------------------------------------------------------------------


def test_memory_is_refused_before_it_is_taken() -> None:
    device = Device(memory_limit=100_000)
    before = device.allocated
    with pytest.raises(OutOfDeviceMemory, match=r"buffer|big.*got a limit of 0 MB"):
        device.empty(100_001, "big")
    with pytest.raises(OutOfDeviceMemory, match="texture big"):
        device.texture(200, 200, "rgba16float", "big")
    with pytest.raises(OutOfDeviceMemory, match="expected at most 268435456 in one buffer"):
        Device().empty(2**40, "huge")
    assert device.allocated == before
    kept = [device.empty(40_000, str(i)) for i in range(2)]
    with pytest.raises(OutOfDeviceMemory):
        device.empty(40_000, "third")
    kept.pop()
    device.empty(40_000, "again")


def test_memory_comes_back_when_a_buffer_is_dropped_or_released(device: Device) -> None:
    gc.collect()
    before = device.allocated
    buffer = device.empty(1000, "a")
    rows = device.real_buffer(np.zeros((100, 3)), "rows")
    texture = device.texture(57, 33, "rg32uint", "t")
    assert device.allocated - before == 1008 + 2400 + 57 * 33 * 8
    del buffer, texture
    rows.release()
    rows.release()
    gc.collect()
    assert device.allocated == before


def test_buffers_of_submitted_work_may_be_dropped(device: Device) -> None:
    n = 100_000
    values = np.linspace(1.0, 2.0, n)
    kernel = device.kernel("gpu/probes/real_arithmetic")
    out = device.real_buffer(np.zeros((6, n)), "out")
    for release in (False, True):
        a, b = device.real_buffer(values, "a"), device.real_buffer(values, "b")
        bindings = kernel.bind(a=a, b=b, result=out, params={"count": n})
        with device.recording("gpu.real") as recording:
            recording.dispatch(kernel, bindings, threads=(n,))
        if release:
            a.release()
            b.release()
        del a, b, bindings
        gc.collect()
        np.testing.assert_array_equal(out.read()[0], 2 * values)


def test_bindings_keep_their_buffers(device: Device) -> None:
    kernel = device.kernel("gpu/probes/real_arithmetic")
    out = device.real_buffer(np.zeros((6, 2)), "out")
    bindings = kernel.bind(
        a=device.real_buffer(np.array([1.0, 2.0]), "a"),
        b=device.real_buffer(np.array([4.0, 8.0]), "b"),
        result=out,
        params={"count": 2},
    )
    gc.collect()
    with device.recording("gpu.real") as recording:
        recording.dispatch(kernel, bindings, threads=(2,))
    assert out.read()[0].tolist() == [5.0, 10.0]


def test_a_released_buffer_is_refused_everywhere(device: Device) -> None:
    gone = device.empty(64, "gone")
    gone.release()
    for use in (lambda: gone.read(np.uint32), lambda: gone.write(np.zeros(1, np.uint32))):
        with pytest.raises(InputError, match="ing gone; got a released buffer"):
            use()
    with pytest.raises(InputError, match="gone; got a released buffer"):
        with device.recording("stage") as recording:
            recording.clear(gone)


def test_a_buffer_released_before_its_submit_is_named(device: Device) -> None:
    # without the check wgpu would end the process here
    kernel = device.kernel("gpu/probes/real_arithmetic")
    a, b = device.real_buffer(np.ones(2), "early"), device.real_buffer(np.ones(2), "b")
    out = device.real_buffer(np.zeros((6, 2)), "out")
    bindings = kernel.bind(a=a, b=b, result=out, params={"count": 2})
    with pytest.raises(
        InputError, match=r"gpu/probes/real_arithmetic\.a: early; got a released buffer"
    ):
        with device.recording("gpu.real") as recording:
            recording.dispatch(kernel, bindings, threads=(2,))
            a.release()
    with pytest.raises(InputError, match="stage: b; got a released buffer"):
        with device.recording("stage") as recording:
            recording.clear(b)
            b.release()


def test_what_is_written_at_any_time_is_what_is_read(device: Device) -> None:
    random = np.random.default_rng(5)
    expected = random.integers(0, 256, 4099).astype(np.uint8)
    buffer = device.buffer(expected, "bytes")
    for size in (4, 4099, 4096, 16):
        # not submitted before it is read
        piece = random.integers(0, 256, size).astype(np.uint8)
        buffer.write(piece)
        expected[:size] = piece
        np.testing.assert_array_equal(buffer.read(np.uint8, (size,)), piece)
        np.testing.assert_array_equal(buffer.read(np.uint8), expected)


def test_what_is_read_is_a_copy_that_may_be_written(device: Device) -> None:
    buffer = device.buffer(np.arange(6, dtype=np.float32), "six")
    first = buffer.read(np.float32)
    first[:] = -1.0
    buffer.write(np.array([7.0], np.float32))
    assert (first == -1.0).all()
    assert buffer.read(np.float32).tolist() == [7.0, 1.0, 2.0, 3.0, 4.0, 5.0]
