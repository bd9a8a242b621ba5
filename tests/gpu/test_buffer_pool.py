"""Buffers that frames give back and take again."""

from __future__ import annotations

import gc
import weakref

import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError, OutOfDeviceMemory
from gpusim.gpu import Device
from gpusim.gpu.buffer import BufferPool


def test_a_buffer_is_taken_again(device: Device) -> None:
    own = BufferPool(device)
    first = own.take(4000, "first")
    first.write(np.arange(1000, dtype=np.uint32))
    memory = first.gpu
    own.give(first)
    with pytest.raises(InputError, match="released"):
        first.read(np.uint32)
    own.give(first)
    assert own.nbytes == 4000
    # another size doesn't fit
    assert own.take(4016, "larger").gpu is not memory
    assert own.take(3984, "smaller").gpu is not memory
    again = own.take(3996, "again")
    assert again.gpu is memory and again.nbytes == 3996 and own.nbytes == 0
    again.write(np.full(999, 7, np.uint32))
    assert (again.read(np.uint32) == 7).all()


def test_the_oldest_are_freed(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gpusim.gpu.buffer.MOST_BYTES", 3000)
    own, before = BufferPool(device), device.allocated
    buffers = [own.take(1024, f"b{k}") for k in range(4)]
    memory = [buffer.gpu for buffer in buffers]
    for buffer in buffers:
        own.give(buffer)
    assert own.nbytes == 2048 == device.allocated - before
    assert own.take(1024, "next").gpu in memory[2:]
    own.free()
    assert own.nbytes == 0


def test_what_waits_is_no_reason_to_refuse() -> None:
    device = Device(memory_limit=300_000)
    device.pool.give(device.pool.take(200_000, "frame"))
    assert device.allocated == device.pool.nbytes == 200_000
    buffer = device.empty(250_000, "solver")
    assert device.allocated == 250_000 and device.pool.nbytes == 0
    with pytest.raises(OutOfDeviceMemory):
        device.empty(100_000, "more")
    buffer.release()


def test_frames_share_their_memory(device: Device) -> None:
    camera = gs.Camera(97, 61, np.array([[90.0, 0.0, 48.0], [0.0, 90.0, 30.0], [0.0, 0.0, 1.0]]))
    points = np.array([[-0.3, -0.2, 1.0], [0.4, -0.25, 1.1], [0.35, 0.3, 1.2], [-0.2, 0.25, 1.0]])

    def frame(albedo: float, background: float) -> gs.Frame:
        paint = gs.paint.Plain(albedo)
        surface = gs.Surface(points, np.array([[0, 3, 2, 1]]), paint=paint)
        return gs.render([surface], camera, background=background, device=device)

    one = frame(0.3, 0.7)
    memory, picture = one.bands[0].buffer.gpu, one.radiance.copy()
    one.release()
    two = frame(0.6, 0.1)
    assert two.bands[0].buffer.gpu is memory
    np.testing.assert_array_equal(one.radiance, picture)
    assert two.radiance.min() == np.float32(0.1)
    assert abs(two.radiance.max() - 0.6) <= 1e-6
    two.release()
    # what nobody holds is gone at once: views are large, and the garbage collector comes seldom
    gone = weakref.ref(two)
    gc.disable()
    try:
        del two
        assert gone() is None
    finally:
        gc.enable()
