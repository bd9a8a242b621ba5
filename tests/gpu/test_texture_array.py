"""Long arrays as textures: what goes in comes back, and what can't be is refused."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from gpusim.errors import InputError, OutOfDeviceMemory
from gpusim.gpu import Device, Texels
from gpusim.gpu.texture_array import TEXEL_WIDTH, most_texels

DOUBLE = """
#import lib/numeric/index
#import lib/numeric/texel
@group(0) @binding(0) var a: texture_2d<f32>;
@group(0) @binding(1) var b: texture_storage_2d<rgba32float, write>;
@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let i = linear_id(gid, groups, 64u);
    textureStore(b, texel(i), 2.0 * textureLoad(a, texel(i), 0));
}
"""


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Device]:
    folder: Path = tmp_path_factory.mktemp("shaders")
    (folder / "double.wgsl").write_text(DOUBLE, encoding="utf-8")
    yield Device(shaders=folder)


@pytest.mark.parametrize("count", [1, 4095, 4096, 4097, 3 * 4096, 20_001])
def test_values_come_back(device: Device, count: int) -> None:
    texels = device.texels(count, "rgba32uint", "test")
    values = np.arange(4 * count, dtype=np.uint32).reshape(-1, 4)
    assert (texels.read() == 0).all(), "zero at first"
    texels.write(values)
    assert (texels.read() == values).all()


@pytest.mark.parametrize(("first", "size"), [(0, 5), (4090, 10), (4090, 9000), (8192, 4096)])
def test_a_write_touches_nothing_else(device: Device, first: int, size: int) -> None:
    texels = device.texels(14_000, "rgba32float", "test")
    before = np.random.default_rng(1).random((14_000, 4), dtype=np.float32)
    texels.write(before)
    piece = 1.0 + np.arange(4 * size, dtype=np.float32).reshape(-1, 4)
    texels.write(piece, first)
    before[first : first + size] = piece
    assert (texels.read() == before).all()


def test_the_height_is_never_a_power_of_two() -> None:
    for count in (1, TEXEL_WIDTH, 4 * TEXEL_WIDTH, 4 * TEXEL_WIDTH + 1, 64 * TEXEL_WIDTH):
        rows = Texels.footprint(count) // (16 * TEXEL_WIDTH)
        assert rows & (rows - 1), rows
        assert rows * TEXEL_WIDTH >= count


def test_kernels_read_and_write_texels(lab: Device) -> None:
    kernel = lab.kernel("double")
    source, target = (lab.texels(5000, "rgba32float", "test") for _ in range(2))
    values = np.random.default_rng(2).random((5000, 4), dtype=np.float32)
    source.write(values)
    bindings = kernel.bind(a=source, b=target)
    with lab.recording("test") as recording:
        recording.dispatch(kernel, bindings, threads=(5000,))
    assert (target.read() == 2.0 * values).all()


def test_wrong_texels_are_named(lab: Device, device: Device) -> None:
    kernel = lab.kernel("double")
    good = lab.texels(10, "rgba32float", "test")
    with pytest.raises(InputError, match=r"double\.a; got rgba32uint \(whole\)"):
        kernel.bind(a=lab.texels(10, "rgba32uint", "whole"), b=good)
    with pytest.raises(InputError, match=r"double\.b; got rgba32uint"):
        kernel.bind(a=good, b=lab.texels(10, "rgba32uint", "whole"))
    with pytest.raises(InputError, match="another device"):
        kernel.bind(a=device.texels(10, "rgba32float", "foreign"), b=good)
    with pytest.raises(InputError, match="expected one of"):
        lab.texels(10, "r8unorm", "test")
    with pytest.raises(InputError, match=r"float64 of shape \(3, 4\)"):
        good.write(np.zeros((3, 4)))
    with pytest.raises(InputError, match="at most 10"):
        good.write(np.zeros((3, 4), dtype=np.float32), 8)
    with pytest.raises(OutOfDeviceMemory, match="expected at most"):
        lab.texels(most_texels(lab) + 1, "rgba32float", "test")


def test_memory_is_counted_and_given_back(lab: Device) -> None:
    before = lab.allocated
    texels = lab.texels(10_000, "rgba32float", "test")
    assert lab.allocated == before + Texels.footprint(10_000)
    kernel = lab.kernel("double")
    other = lab.texels(10_000, "rgba32float", "test")
    bindings = kernel.bind(a=texels, b=other)
    texels.release()
    with pytest.raises(InputError, match="released"):
        texels.read()
    with pytest.raises(InputError, match="released"), lab.recording("test") as recording:
        recording.dispatch(kernel, bindings, threads=(10,))
    other.release()
    assert lab.allocated == before
    small = Device(memory_limit=100_000)
    with pytest.raises(OutOfDeviceMemory, match="texture large"):
        small.texels(10_000, "rgba32float", "large")


def test_what_waits_is_no_reason_to_refuse() -> None:
    device = Device(memory_limit=300_000)
    device.pool.texels(10, "rgba32float", "frame")
    assert device.allocated == Texels.footprint(10)
    buffer = device.empty(250_000, "solver")
    assert device.allocated == 250_000
    with pytest.raises(OutOfDeviceMemory):
        device.empty(100_000, "more")
    buffer.release()
