"""The comparison that everything else rests on must be able to fail; so must the twin checks."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from gpusim.errors import InputError, TwinMismatch
from gpusim.gpu import TOLERANCES, Device, compare, twin_check
from gpusim.gpu.probes import finiteness, real_arithmetic
from gpusim.gpu.probes.finiteness import finite_probe, finite_probe_twin
from gpusim.gpu.probes.real_arithmetic import real_probe, real_probe_twin
from gpusim.gpu.twin import _CHECKS
from tests.support.shader_stages import stages


@pytest.fixture(scope="module", params=["f64", "double_single"])
def one(request: pytest.FixtureRequest, device: Device) -> Device:
    if request.param == "f64" and device.real != "f64":
        pytest.skip(f"{device.name} has no 64-bit floats")
    return device if request.param == device.real else Device(real=request.param)


def test_equal_values_pass_and_the_largest_difference_comes_back() -> None:
    twin = np.linspace(1, 2, 57 * 33).reshape(57, 33)
    device = twin.copy()
    device[11, 7] += 3e-7
    assert compare("stage", device, twin) == pytest.approx(3e-7, rel=1e-6)
    assert compare("stage", twin.astype(np.float32), twin) < 2e-7
    assert compare("stage", np.arange(5, dtype=np.uint8), np.arange(5), "exact") == 0.0


def test_one_value_in_a_hundred_thousand_is_found() -> None:
    twin = np.random.default_rng(1).normal(size=(1000, 100))
    device = twin.copy()
    device[731, 42] += 1e-4
    with pytest.raises(TwinMismatch, match=r"stage: 1 of 100000 values off; worst at \(731, 42\)"):
        compare("stage", device, twin)
    device[3, 5] -= 1e-3
    with pytest.raises(TwinMismatch, match=r"2 of 100000 .* worst at \(3, 5\): device") as caught:
        compare("stage", device, twin)
    assert f"twin {twin[3, 5]:.9g}" in str(caught.value)
    assert caught.value.exit_code == 5


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("where", ["device", "twin", "both"])
def test_what_is_not_finite_never_passes(bad: float, where: str) -> None:
    device, twin = np.ones((3, 4)), np.ones((3, 4))
    if where != "twin":
        device[2, 1] = bad
    if where != "device":
        twin[2, 1] = bad
    named = "twin" if where == "twin" else "device"
    with pytest.raises(TwinMismatch, match=rf"{named} not finite at \(2, 1\) \(1 values\)"):
        compare("stage", device, twin, atol=np.inf)


def test_shapes_must_agree_and_hold_something() -> None:
    with pytest.raises(TwinMismatch, match=r"shapes differ; device \(3, 1\), twin \(3,\)"):
        compare("stage", np.ones((3, 1)), np.ones(3))
    with pytest.raises(TwinMismatch, match="nothing to compare"):
        compare("stage", np.ones((0, 3)), np.ones((0, 3)))


def test_tolerances_are_checked() -> None:
    with pytest.raises(TwinMismatch):
        compare("stage", np.ones(2), np.ones(2), atol=np.nan)
    with pytest.raises(InputError, match="tolerance; got 'loose'; expected one of"):
        compare("stage", np.ones(2), np.ones(2), "loose")
    with pytest.raises(TwinMismatch):
        compare("stage", np.array([1]), np.array([2]), "exact")
    compare("stage", np.array([1.0]), np.array([2.0]), atol=1.0, rtol=0.0)
    for tolerance in TOLERANCES.values():
        assert 0 <= tolerance.atol <= 1e-4 and 0 <= tolerance.rtol <= 1e-4 and tolerance.reason


def test_large_integers_are_compared_exactly() -> None:
    with pytest.raises(TwinMismatch, match="1 of 2 values off"):
        compare("stage", np.array([2**53, 5]), np.array([2**53 + 1, 5]), "exact")


def test_a_stage_registers_once() -> None:
    before = dict(_CHECKS)
    with pytest.raises(
        InputError, match="twin check 'gpu/probes/real_arithmetic' is registered twice"
    ):
        twin_check("gpu/probes/real_arithmetic")(lambda device: None)
    assert before == _CHECKS


def test_every_shader_of_the_layer_is_checked() -> None:
    assert {"gpu/probes/real_arithmetic", "gpu/probes/finiteness"} <= set(stages())
    assert not any(name.startswith("lib/") for name in stages())


# --- the layer's own kernels ----------------------------------------------------------------


@pytest.mark.parametrize("stage", ["gpu/probes/real_arithmetic", "gpu/probes/finiteness"])
def test_twins_agree(one: Device, stage: str) -> None:
    _CHECKS[stage](one)


@pytest.mark.parametrize(
    ("stage", "module", "probe"),
    [
        ("gpu/probes/real_arithmetic", real_arithmetic, "real_probe"),
        ("gpu/probes/finiteness", finiteness, "finite_probe"),
    ],
)
def test_one_corrupted_value_turns_a_check_red(
    one: Device, stage: str, module: object, probe: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    run: Callable[..., np.ndarray[tuple[int, ...], np.dtype[np.float64]]] = getattr(module, probe)

    def corrupted(*args: object) -> object:
        result = run(*args).copy()
        last = result.reshape(-1)[-3:-2]
        last += 1 if result.dtype.kind == "u" else 1e-6 * np.abs(last) + 1e-6
        return result

    monkeypatch.setattr(module, probe, corrupted)
    with pytest.raises(TwinMismatch, match=f"{stage}: 1 of"):
        _CHECKS[stage](one)


def test_arithmetic_is_better_than_float32_by_far(one: Device) -> None:
    # independent of the twin: results known in closed form
    third = real_probe(one, np.array([1.0, 2.0, 1e-7]), np.array([3.0, -2.0, 1.0]))
    assert abs(third[3, 0] - 1 / 3) < 3e-14
    assert abs(third[5, 1] - np.sqrt(2)) < 6e-14
    assert abs(third[0, 2] - 1 - 1e-7) < 1e-13
    assert third[0, 1] == 0.0


def test_arithmetic_has_the_same_bits_on_two_runs(one: Device) -> None:
    rng = np.random.default_rng(7)
    a, b = rng.normal(size=5000), rng.normal(size=5000) + 3
    np.testing.assert_array_equal(real_probe(one, a, b), real_probe(one, a, b))
    relative = np.abs(real_probe(one, a, b) - real_probe_twin(a, b)).max()
    assert relative < (1e-13 if one.real == "f64" else 1e-11)


@pytest.mark.parametrize(
    ("value", "flags"), [(1.0, 7), (0.0, 7), (np.nan, 0), (np.inf, 0), (-np.inf, 0), (3e38, 2)]
)
def test_what_is_finite_is_known_to_the_device(one: Device, value: float, flags: int) -> None:
    single, wide = np.full(3, value, np.float32), np.full(3, value)
    if one.real == "f64" and flags == 2:
        flags = 6  # 4 * 3e38 overflows f32 but not f64
    assert finite_probe(one, single, wide).tolist() == [flags] * 3
    assert finite_probe_twin(single, wide, one.real).tolist() == [flags] * 3
