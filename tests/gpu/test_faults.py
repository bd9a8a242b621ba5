"""Faults of adapter, driver and device: each ends in one clear error, none only in a log."""

from __future__ import annotations

import logging
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import gpusim
from gpusim.errors import DeviceError, DeviceLost, InputError, NoAdapter, OutOfDeviceMemory
from gpusim.gpu import Device, Uniform, faults


def run_python(code: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """A fresh interpreter without a desktop session, importing the same gpusim."""
    env = {k: v for k, v in os.environ.items() if k not in ("XDG_RUNTIME_DIR", "GPUSIM_ADAPTER")}
    env["PYTHONPATH"] = str(Path(gpusim.__file__).parents[1])
    return subprocess.run(
        [sys.executable, "-c", code],
        env=env | environment,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


def test_an_unknown_adapter_is_named_with_what_there_is(device: Device) -> None:
    with pytest.raises(NoAdapter, match=r"got 'voodoo'; expected part of one of: \S+") as caught:
        Device(adapter="voodoo")
    assert str(device.adapter.summary) in str(caught.value)


def test_the_environment_names_an_adapter(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GPUSIM_ADAPTER", "no such card")
    with pytest.raises(NoAdapter, match="got 'no such card'"):
        Device()
    part = device.name[:6]
    assert Device(adapter=part.upper()).name == device.name  # the argument wins
    monkeypatch.setenv("GPUSIM_ADAPTER", part)
    assert Device().name == device.name
    monkeypatch.setenv("GPUSIM_ADAPTER", "")
    assert Device().name == device.name


def test_a_machine_without_a_driver_is_told_what_to_install() -> None:
    done = run_python(
        "import gpusim.gpu as g\n"
        "try: g.Device()\nexcept Exception as e: print(type(e).__name__, e)",
        VK_DRIVER_FILES=os.devnull,
        VK_ICD_FILENAMES=os.devnull,
    )
    assert done.stdout.startswith("NoAdapter no Vulkan adapter found; install a driver"), done
    assert "mesa-vulkan-drivers" in done.stdout


def test_an_unknown_real_is_refused() -> None:
    with pytest.raises(InputError, match="Device real; got 'f32'"):
        Device(real="f32")


def test_opening_a_device_prints_nothing_and_leaves_the_environment_alone() -> None:
    done = run_python(
        "import os; before = dict(os.environ)\n"
        "from gpusim.gpu import Device\nimport numpy as np\n"
        "device = Device(); device.buffer(np.ones(3, np.float32), 'a').read(np.float32)\n"
        "assert dict(os.environ) == before\n"
        "assert os.system('test -z \"$XDG_RUNTIME_DIR\"') == 0"
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_an_instance_made_by_somebody_else_is_used() -> None:
    done = run_python(
        "import wgpu; wgpu.gpu.enumerate_adapters_sync()\n"
        "from gpusim.gpu import Device\nprint(Device().info['backend_type'])"
    )
    assert done.returncode == 0 and done.stdout.strip() != "OpenGL", done


def test_a_fault_found_while_recording_is_raised(device: Device) -> None:
    buffer, texture = device.empty(256, "same"), device.texture(4, 4, "depth32float", "depth")
    with pytest.raises(DeviceError, match=r"(?s)^stage: .*Partial copy"):
        with device.recording("stage") as recording:
            recording.copy_texture(texture, buffer, 1)
    kernel = device.kernel("gpu/probes/real_arithmetic")
    a = device.real_buffer(np.zeros((12,)), "a")
    bindings = kernel.bind(a=a, b=a, result=a, params={"count": 2})
    with pytest.raises(DeviceError, match=r"(?s)^gpu\.real: .*gpusim\.a"):
        with device.recording("gpu.real") as recording:
            recording.dispatch(kernel, bindings, threads=(2,))
    a.read()  # the device goes on working


def test_an_error_inside_the_block_submits_nothing(device: Device) -> None:
    buffer = device.buffer(np.ones(4, np.uint32), "kept")
    with pytest.raises(KeyError, match="mine"):
        with device.recording("stage") as recording:
            recording.clear(buffer)
            raise KeyError("mine")
    assert buffer.read(np.uint32).tolist() == [1, 1, 1, 1]


def test_an_error_that_was_only_logged_is_raised_by_the_next_call(device: Device) -> None:
    def log_error() -> None:
        logging.getLogger("wgpu").error("Validation Error\n\nCaused by:\n  out of the blue")

    log_error()
    with pytest.raises(DeviceError, match=r"^buffer one of 16 bytes: out of the blue$"):
        device.empty(4, "one")
    assert faults.pending() == []


def test_a_lost_device_says_so_and_others_go_on(device: Device) -> None:
    lost = Device()
    buffer = lost.empty(64, "u")
    kernel = lost.kernel("gpu/probes/real_arithmetic")
    a = lost.real_buffer(np.ones(2), "a")
    out = lost.real_buffer(np.zeros((6, 2)), "out")
    params = Uniform(lost, {"count": 2}, "params")
    bindings = kernel.bind(a=a, b=a, result=out, params=params)
    lost.gpu.destroy()

    def submit() -> None:
        with lost.recording("stage") as recording:
            recording.dispatch(kernel, bindings, threads=(2,))

    for use in (
        lambda: lost.empty(4, "v"),
        lambda: lost.texture(4, 4, "r32float", "t"),
        lambda: lost.kernel("gpu/probes/finiteness"),
        lambda: buffer.read(np.uint32),
        lambda: buffer.write(np.zeros(1, np.uint32)),
        lambda: kernel.bind(a=a, b=a, result=out, params={"count": 2}),
        lambda: params.update({"count": 1}),
        submit,
        lost.sync,
    ):
        with pytest.raises(DeviceLost, match="the device was lost"):
            use()
    assert device.buffer(np.ones(1, np.uint32), "fine").read(np.uint32).tolist() == [1]


def test_a_message_about_another_device_is_not_ours(device: Device) -> None:
    def log_error() -> None:
        logging.getLogger("wgpu").error("The WGPU device was lost (Unknown):\nother")

    log_error()
    device.sync()
    assert faults.pending() == []


@pytest.mark.skipif(sys.platform != "linux", reason="limits the address space the Linux way")
def test_memory_that_the_driver_lacks_is_reported(device: Device) -> None:
    if device.info["adapter_type"] != "CPU":
        pytest.skip("only a CPU adapter takes its memory from the process")
    done = run_python(
        "import resource\nfrom pathlib import Path\nfrom gpusim.gpu import Device\n"
        "from gpusim.errors import OutOfDeviceMemory\n"
        "device = Device(memory_limit=2**40); device.sync()\n"
        "pages = int(Path('/proc/self/statm').read_text().split()[0])\n"
        "resource.setrlimit(resource.RLIMIT_AS, (4096 * pages + 300 * 2**20,) * 2)\n"
        "kept = []\n"
        "try:\n    for i in range(6): kept.append(device.empty(128 * 2**20, f'b{i}'))\n"
        "except OutOfDeviceMemory as error: print(len(kept), device.allocated >> 20, error)\n"
    )
    assert done.returncode == 0, done
    count, allocated, message = done.stdout.split(" ", 2)
    assert int(allocated) == 128 * int(count) < 128 * 6
    assert "the driver has no memory left" in message and f"buffer b{count}" in message


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        ("Parent device is lost", DeviceLost),
        ("Not enough memory left.", OutOfDeviceMemory),
        ("workgroup memory layout is wrong", DeviceError),
    ],
)
def test_messages_are_told_apart(text: str, kind: type[DeviceError]) -> None:
    error = faults.translate(f"Validation Error\n\nCaused by:\n  In wgpuX\n    {text}\n", "doing x")
    assert type(error) is kind and str(error).startswith("doing x: ") and text in str(error)
    assert "Caused by" not in str(error) and error.exit_code == 4
