"""Device time by stage."""

from __future__ import annotations

import numpy as np
import pytest

from gpusim.gpu import Device
from gpusim.gpu.timing import _PAIRS


@pytest.fixture
def timed() -> Device:
    device = Device()
    if not device.timer.enabled:
        pytest.skip(f"{device.name} has no timestamps")
    return device


def run(device: Device, stage: str, n: int, times: int = 1) -> None:
    kernel = device.kernel("gpu/probes/real_arithmetic")
    a = device.real_buffer(np.ones(n), "a")
    out = device.real_buffer(np.zeros((6, n)), "out")
    bindings = kernel.bind(a=a, b=a, result=out, params={"count": n})
    for _ in range(times):
        with device.recording(stage) as recording:
            recording.dispatch(kernel, bindings, threads=(n,))


def test_seconds_sum_by_stage(timed: Device) -> None:
    assert timed.timer.seconds() == {}
    # the least of several: others may use the processors meanwhile
    for k in range(5):
        run(timed, f"small {k}", 64)
        run(timed, f"large {k}", 300_000)
    first = timed.timer.seconds()
    small, large = ([first[f"{stage} {k}"] for k in range(5)] for stage in ("small", "large"))
    assert len(first) == 10 and 0 < min(small) < min(large) < 30
    assert timed.timer.seconds() == first
    run(timed, "large 0", 300_000, times=3)
    again = timed.timer.seconds()
    assert again["small 0"] == first["small 0"]
    assert again["large 0"] >= first["large 0"] + 2.0 * min(large)


def test_more_passes_than_the_query_set_holds(timed: Device) -> None:
    run(timed, "many", 64, times=_PAIRS + 5)
    part = timed.timer._total["many"]
    assert 0 < part < timed.timer.seconds()["many"]
    assert timed.timer.untimed == 0


def test_one_recording_with_too_many_passes_says_how_many(timed: Device) -> None:
    kernel = timed.kernel("gpu/probes/real_arithmetic")
    a = timed.real_buffer(np.ones(2), "a")
    out = timed.real_buffer(np.zeros((6, 2)), "out")
    bindings = kernel.bind(a=a, b=a, result=out, params={"count": 2})
    spare = timed.empty(16, "spare")
    with timed.recording("long") as recording:
        for _ in range(_PAIRS + 3):
            recording.dispatch(kernel, bindings, threads=(2,))
            recording.clear(spare)  # ends the pass
    assert timed.timer.untimed == 3
    assert timed.timer.seconds()["long"] > 0


def test_a_failed_recording_is_not_timed(timed: Device) -> None:
    run(timed, "good", 64)
    kernel = timed.kernel("gpu/probes/real_arithmetic")
    a = timed.real_buffer(np.ones(2), "a")
    out = timed.real_buffer(np.zeros((6, 2)), "out")
    bindings = kernel.bind(a=a, b=a, result=out, params={"count": 2})
    with pytest.raises(KeyError), timed.recording("bad") as recording:
        recording.dispatch(kernel, bindings, threads=(2,))
        raise KeyError
    with timed.recording("open") as recording:
        recording.dispatch(kernel, bindings, threads=(2,))
        assert set(timed.timer.seconds()) == {"good"}  # asked while another one is open
    run(timed, "good", 64)
    assert set(timed.timer.seconds()) == {"good", "open"}


def test_without_timestamps_nothing_is_timed() -> None:
    device = Device()
    device.timer.enabled = False
    run(device, "stage", 8)
    assert device.timer.seconds() == {}
