"""Kernels and bindings: what is checked before anything reaches the device, and dispatch sizes."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from gpusim.errors import DeviceError, InputError
from gpusim.gpu import Device, Kernel, default_device
from gpusim.gpu.uniform import pack
from gpusim.gpu.warmup import compile_ahead, compile_during
from gpusim.gpu.wgsl import load

COUNT = """
#import lib/numeric/index
override step: u32 = 1u;
struct Params { n: u32, shift: i32, scale: f32, pair: vec2f }
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> source: array<u32>;
@group(0) @binding(2) var<storage, read_write> result: array<u32>;
@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let i = linear_id(gid, groups, 64u);
    if (i >= params.n) { return; }
    result[i] = source[i] + u32(i32(i) + params.shift) * step;
}
@compute @workgroup_size(64)
fn other() { result[0] = params.n; }
@fragment
fn paint() -> @location(0) vec4f { return vec4f(1.0); }
"""
LOOK = """
@group(0) @binding(0) var picture: texture_2d<f32>;
@group(0) @binding(1) var<storage, read_write> result: array<f32>;
@compute @workgroup_size(1)
fn main() { result[0] = textureLoad(picture, vec2u(0), 0).x; }
"""
BROKEN = "@compute @workgroup_size(1) fn main() { let x: u32 = 1.5; }"


SIZED = "override block: u32; @compute @workgroup_size(block) fn main() { }"


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Device]:
    """A device that also finds the shaders of this file."""
    folder: Path = tmp_path_factory.mktemp("shaders")
    shaders = {"count": COUNT, "look": LOOK, "broken": BROKEN, "sized": SIZED}
    for name, text in shaders.items():
        (folder / f"{name}.wgsl").write_text(text, encoding="utf-8")
    yield Device(shaders=folder)


@pytest.fixture
def kernel(lab: Device) -> Kernel:
    return lab.kernel("count")


PARAMS = {"n": 3, "shift": -1, "scale": 0.5, "pair": (1.0, 2.0)}


def test_what_is_wrong_with_bindings_is_named(lab: Device, kernel: Kernel) -> None:
    source = lab.buffer(np.arange(3, dtype=np.uint32), "source")
    result = lab.empty(12, "result")
    good = {"params": PARAMS, "source": source, "result": result}
    kernel.bind(**good)
    with pytest.raises(InputError, match=r"binding count; missing \['result'\]"):
        kernel.bind(params=PARAMS, source=source)
    with pytest.raises(InputError, match=r"unknown \['target'\]"):
        kernel.bind(**good, target=result)
    with pytest.raises(InputError, match=r"count\.source; got ndarray; expected a Buffer"):
        kernel.bind(**{**good, "source": np.arange(3)})
    with pytest.raises(InputError, match=r"count\.source; got Texture; expected a Buffer"):
        kernel.bind(**{**good, "source": lab.texture(4, 4, "r32float", "t")})
    with pytest.raises(InputError, match=r"count\.params; got Buffer; expected a dict"):
        kernel.bind(**{**good, "params": source})
    with pytest.raises(InputError, match=r"look\.picture; got Buffer; expected a Texture"):
        lab.kernel("look").bind(picture=source, result=result)
    source.release()
    with pytest.raises(InputError, match=r"count\.source: source; got a released buffer"):
        kernel.bind(**good)


def test_a_buffer_of_another_device_is_refused(lab: Device, kernel: Kernel, device: Device) -> None:
    foreign = device.empty(12, "foreign")
    with pytest.raises(InputError, match=r"buffer of another device \(foreign\)"):
        kernel.bind(params=PARAMS, source=foreign, result=lab.empty(12, "result"))


def test_values_that_entries_share_are_bound_where_they_are_used(
    lab: Device, kernel: Kernel
) -> None:
    source = lab.buffer(np.arange(3, dtype=np.uint32), "source")
    good = {"params": PARAMS, "source": source, "result": lab.empty(12, "result")}
    kernel.bind_used(**good, target=source)
    # what is missing is still told
    with pytest.raises(InputError, match=r"binding count; missing \['source'\]"):
        kernel.bind_used(params=PARAMS, result=good["result"], target=source)


def test_a_buffer_above_the_binding_limit_is_refused(kernel: Kernel, lab: Device) -> None:
    limits = dict(lab.limits)
    big = lab.empty(4096, "big")
    lab.limits["max-storage-buffer-binding-size"] = 1024
    try:
        with pytest.raises(DeviceError, match=r"got 4096 bytes; expected at most 1024"):
            kernel.bind(params=PARAMS, source=big, result=lab.empty(12, "result"))
    finally:
        lab.limits.update(limits)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"n": -1}, r"params\.n; got -1; expected finite values that uint32 holds"),
        ({"n": 1.5}, r"params\.n; got 1\.5"),
        ({"n": 2**32}, r"params\.n; got 4294967296"),
        ({"shift": 2**31}, r"params\.shift; got 2147483648"),
        ({"scale": float("nan")}, r"params\.scale; got nan"),
        ({"scale": 1e39}, r"params\.scale; got 1e\+39"),
        ({"scale": "2"}, r"params\.scale; got '2'; expected numbers of shape \(\)"),
        ({"pair": (1.0, 2.0, 3.0)}, r"params\.pair; .*expected numbers of shape \(2,\)"),
        ({"pair": 1.0}, r"params\.pair; got 1\.0; expected numbers of shape \(2,\)"),
        ({"pair": (1.0, np.inf)}, r"params\.pair; "),
        ({"more": 1}, r"got members \['more', 'n', 'pair', 'scale', 'shift'\]"),
    ],
)
def test_a_uniform_takes_only_what_fits(
    change: dict[str, object], message: str, kernel: Kernel
) -> None:
    dtype = kernel.layout.module.structs["Params"]
    pack(PARAMS, dtype, "params")
    with pytest.raises(InputError, match=message):
        pack({**PARAMS, **change}, dtype, "params")


def test_kernel_arguments_are_checked(lab: Device) -> None:
    with pytest.raises(InputError, match=r"no such entry; expected one of \['main', 'other'"):
        lab.kernel("count", "nothing")
    with pytest.raises(InputError, match="a fragment entry; expected @compute"):
        lab.kernel("count", "paint")
    with pytest.raises(InputError, match=r"unknown \['size'\]"):
        lab.kernel("count", constants={"size": 4})
    with pytest.raises(DeviceError, match=r"(?s)shader broken: .*let x: u32 = 1\.5"):
        lab.kernel("broken")
    for block in (0, 512):
        with pytest.raises(
            InputError, match=rf"sized\.main: workgroup size; got \({block}, 1, 1\)"
        ):
            lab.kernel("sized", constants={"block": block})
    with pytest.raises(InputError, match=r"sized\.main constants; got \[\]; needed \['block'\]"):
        lab.kernel("sized")


def test_kernels_and_modules_are_compiled_once(
    lab: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    compiled: list[str] = []
    create = lab.gpu.create_shader_module

    def counted(**arguments: str) -> object:
        compiled.append(arguments["label"])
        return create(**arguments)

    monkeypatch.setattr(lab.gpu, "create_shader_module", counted)
    lab.programs.clear()
    first = lab.kernel("count")
    assert lab.kernel("count") is first
    assert lab.kernel("count", "other") is not first
    assert lab.kernel("count", constants={"step": 2}) is not first
    assert compiled == ["gpusim.count"]


def run_count(lab: Device, n: int, step: int = 1) -> np.ndarray[tuple[int], np.dtype[np.uint32]]:
    source = np.random.default_rng(3).integers(0, 1000, n).astype(np.uint32)
    kernel = lab.kernel("count", constants={"step": step})
    result = lab.buffer(np.full(n + 64, 77, np.uint32), "result")
    params = {"n": n, "shift": 5, "scale": 1.0, "pair": (0, 0)}
    bindings = kernel.bind(params=params, source=lab.buffer(source, "source"), result=result)
    with lab.recording("count") as recording:
        recording.dispatch(kernel, bindings, threads=(n,))
    got = result.read(np.uint32)
    expected = source + (np.arange(n, dtype=np.uint32) + 5) * step
    np.testing.assert_array_equal(got[:n], expected)
    assert (got[n:] == 77).all()
    return got


@pytest.mark.parametrize("n", [1, 63, 64, 65, 65535 * 64 + 1])
def test_one_dimensional_grids_of_any_size(lab: Device, n: int) -> None:
    run_count(lab, n)


def test_three_folded_rows(lab: Device) -> None:
    # a lower limit makes the fold uneven: 7 groups in rows of at most 3
    limits = dict(lab.limits)
    lab.limits["max-compute-workgroups-per-dimension"] = 3
    try:
        run_count(lab, 6 * 64 + 1, step=3)
    finally:
        lab.limits.update(limits)


def test_the_same_bits_on_two_runs(lab: Device) -> None:
    np.testing.assert_array_equal(run_count(lab, 1000), run_count(lab, 1000))


def test_dispatch_arguments_are_checked(lab: Device, kernel: Kernel) -> None:
    other = lab.kernel("count", "other")
    bound = kernel.bind(
        params=PARAMS, source=lab.empty(12, "source"), result=lab.empty(12, "result")
    )
    wrong: list[tuple[Kernel, dict[str, tuple[int, ...]], str]] = [
        (other, {"groups": (1,)}, "bindings were made for another"),
        (kernel, {}, "give one of threads, groups"),
        (kernel, {"threads": (1,), "groups": (1,)}, "give one of threads, groups"),
        (kernel, {"threads": (-1,)}, "expected 1 to 3 sizes"),
        (kernel, {"groups": (1, 1, 1, 1)}, "expected 1 to 3 sizes"),
        (kernel, {"groups": (65536,)}, "limit 65535"),
        (kernel, {"threads": (1, 65536)}, "limit 65535"),
    ]
    for program, sizes, message in wrong:
        with pytest.raises(InputError, match=message), lab.recording("count") as recording:
            recording.dispatch(program, bound, **sizes)
    with lab.recording("count") as recording:
        recording.dispatch(kernel, bound, threads=(0,))  # nothing to do isn't a fault


def test_portable_limits_are_what_the_device_has(lab: Device) -> None:
    assert lab.limits["max-storage-buffers-per-shader-stage"] == 8
    assert lab.limits["max-compute-invocations-per-workgroup"] == 256
    assert lab.limits["max-storage-buffer-binding-size"] == 128 * 1024**2


def test_the_module_is_loaded_once_per_real() -> None:
    assert load("gpu/probes/real_arithmetic", "f64") is load("gpu/probes/real_arithmetic", "f64")
    assert load("gpu/probes/real_arithmetic", "f64") is not load(
        "gpu/probes/real_arithmetic", "double_single"
    )


def test_programs_of_an_earlier_run_are_compiled_beforehand(lab: Device) -> None:
    lab.programs.clear()
    lab.programs.asked.clear()
    kernel = lab.kernel("count", constants={"step": 2})
    asked = json.loads(json.dumps(list(lab.programs.asked)))
    assert asked == [["count", "main", [["step", 2]]]]
    lab.programs.clear()
    gone = (
        ["no such file", "main", []],
        ["count", "main", [["gone", 1]]],
        ["broken", "main", []],
        [1],
    )
    lab.programs.begin([*gone, *asked])
    ready = made(lab, "count")
    assert lab.kernel("count", constants={"step": 2}) is ready
    assert ready is not kernel
    with pytest.raises(DeviceError, match="broken"):
        lab.kernel("broken")


def made(device: Device, name: str) -> Kernel:
    """A program once threads have compiled it."""
    for _ in range(200):
        for key, program in list(device.programs._made.items()):
            if key[0] == name and program.done():  # type: ignore[index]
                kernel: Kernel = program.result()
                return kernel
        time.sleep(0.05)
    raise AssertionError(f"{name} wasn't compiled")


def test_threads_that_ask_at_once_get_one_program(lab: Device) -> None:
    lab.programs.clear()
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda _: lab.kernel("count"), range(8)))
    assert len(set(map(id, found))) == 1


def test_programs_are_compiled_for_as_long_as_there_is_need(lab: Device) -> None:
    lab.programs.clear()
    with compile_during(lab, [["count", "main", []]]):
        assert lab.kernel("count") is lab.kernel("count")
    assert not lab.programs._threads
    waiting = [["count", "main", [["step", float(n)]]] for n in range(400)]
    with pytest.raises(KeyboardInterrupt), compile_during(lab, waiting):
        raise KeyboardInterrupt
    assert len(lab.programs._made) < len(waiting)


def test_the_device_is_opened_before_it_is_needed() -> None:
    with compile_ahead([["fem/no such", "main", []]]):
        opened = default_device()
    assert default_device() is opened
    with pytest.raises(ZeroDivisionError), compile_ahead([]):
        raise ZeroDivisionError
    with pytest.raises(ZeroDivisionError), compile_ahead([["fem/no such", "main", []]]):
        raise ZeroDivisionError
    assert not opened.programs._threads
