"""Uniforms that programs share, and textures kept from frame to frame."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from gpusim.errors import InputError
from gpusim.gpu import Device, Uniform
from gpusim.gpu.uniform import pack

LAMPS = """
struct Lamp { power: f32, side: array<vec4f, 2>, mask: vec2u }
struct Lamps { count: u32, first: Lamp }
@group(0) @binding(0) var<uniform> lamps: Lamps;
@group(0) @binding(1) var<storage, read_write> result: array<f32>;
@compute @workgroup_size(1)
fn main() { result[0] = lamps.first.power; }
@compute @workgroup_size(1)
fn other() { result[1] = lamps.first.side[1].z + f32(lamps.first.mask.y); }
"""
LAMP = {"power": 4.0, "side": np.arange(8.0).reshape(2, 4), "mask": [3, 5]}


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Device]:
    folder: Path = tmp_path_factory.mktemp("shaders")
    (folder / "lamps.wgsl").write_text(LAMPS, encoding="utf-8")
    yield Device(shaders=folder)


def test_a_struct_in_a_struct_is_checked(lab: Device) -> None:
    dtype = lab.kernel("lamps").layout.module.structs["Lamps"]
    packed = pack({"count": 2, "first": LAMP}, dtype, "lamps")
    np.testing.assert_array_equal(packed["first"]["side"], LAMP["side"])
    short = {**LAMP, "mask": np.ones(3)}
    with pytest.raises(InputError, match=r"lamps\.first\.mask; .*numbers of shape \(2,\)"):
        pack({"count": 2, "first": short}, dtype, "lamps")
    with pytest.raises(InputError, match=r"lamps\.first; got int; expected a dict"):
        pack({"count": 2, "first": 1}, dtype, "lamps")


def test_programs_share_a_uniform(lab: Device, device: Device) -> None:
    shared = Uniform(lab, {"count": 2, "first": LAMP}, "test.lamps")
    result = lab.empty(8, "result")
    first, second = lab.kernel("lamps"), lab.kernel("lamps", "other")
    with lab.recording("test") as recording:
        for kernel in (first, second):
            recording.dispatch(kernel, kernel.bind(lamps=shared, result=result), groups=(1,))
    assert result.read(np.float32).tolist() == [4.0, 11.0]
    dtype = first.layout.module.structs["Lamps"]
    assert shared.live(dtype, "a") is shared.live(dtype, "b"), "written once"
    foreign = Uniform(device, {"count": 2, "first": LAMP}, "test.lamps")
    with pytest.raises(InputError, match=r"lamps\.lamps; got a uniform of another device"):
        first.bind(lamps=foreign, result=result)
    with pytest.raises(InputError, match=r"lamps\.lamps; got members \['count'\]"):
        first.bind(lamps=Uniform(lab, {"count": 1}, "test.lamps"), result=result)


def test_a_target_is_kept_while_it_fits(lab: Device) -> None:
    first = lab.target(20, 10, "r32float", "test")
    used = lab.allocated
    assert lab.target(20, 10, "r32float", "test") is first
    assert lab.target(20, 10, "r32float", "other") is not first
    other = lab.target(30, 10, "r32float", "test")
    assert (other.width, other.height) == (30, 10)
    del first
    assert lab.allocated == used + 4 * 10 * 30
    assert lab.target(30, 10, "depth32float", "test").format == "depth32float"


def test_missing_texels_are_zero(lab: Device) -> None:
    none = lab.no_texels("rgba32float")
    assert none is lab.no_texels("rgba32float")
    assert none.read().tolist() == [[0.0, 0.0, 0.0, 0.0]]
