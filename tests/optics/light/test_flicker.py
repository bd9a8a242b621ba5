"""Light that varies in time: closed forms of its mean over an exposure."""

from __future__ import annotations

import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError

MAINS = gs.Flicker(frequency=100.0, modulation=0.3, phase=0.7)
SWITCHED = gs.Flicker(frequency=130.0, duty=0.35, phase=-2.0)
STARTS = np.linspace(-0.031, 0.057, 61)


@pytest.mark.parametrize("flicker", [MAINS, SWITCHED], ids=["mains", "pwm"])
@pytest.mark.parametrize("exposure", [1e-5, 0.0021, 0.0137])
def test_mean_over_an_exposure(flicker: gs.Flicker, exposure: float) -> None:
    """The mean of the factor as it is defined, at 40,000 instants of each exposure."""
    inside = STARTS[:, None] + exposure * (np.arange(40_000) + 0.5) / 40_000
    turns = flicker.frequency * inside + flicker.phase / (2.0 * np.pi)
    if flicker.duty is None:
        factor = 1.0 + flicker.modulation * np.cos(2.0 * np.pi * turns)
    else:
        factor = (turns % 1.0 < flicker.duty) / flicker.duty
    got = flicker.mean(STARTS, STARTS + exposure)
    assert got.dtype == np.float64
    # an edge of the light is seen to one of the instants
    assert np.abs(got - factor.mean(axis=1)).max() <= (1e-8 if flicker.duty is None else 3e-4)
    assert np.array_equal(flicker.mean(STARTS[7], STARTS[7]), flicker.mean(STARTS, STARTS)[7])


def test_visibility_is_a_sinc_of_the_exposure() -> None:
    """Of 100 Hz light, exposures of whole periods leave nothing, others |sinc(f T)|."""
    starts = np.arange(1000) / 1e5
    for exposure in (0.0, 0.001, 0.004, 0.01, 0.0123, 0.02):
        seen = MAINS.mean(starts, starts + exposure)
        visibility = (seen.max() - seen.min()) / (seen.max() + seen.min())
        assert visibility == pytest.approx(0.3 * abs(np.sinc(100.0 * exposure)), abs=1e-6)
    for whole in (1, 3):
        exact = SWITCHED.mean(starts, starts + whole / SWITCHED.frequency)
        assert np.abs(exact - 1.0).max() <= 1e-12, "a period divides the exposure"


def test_frames_alias_it() -> None:
    """100 Hz light in frames at 96 a second is seen at 4 Hz, by the sinc of the exposure; at 50 a
    second not at all."""
    times = np.arange(960) / 96.0
    seen = np.array([MAINS.later(time).mean(0.0, 0.002) for time in times])
    spectrum = np.abs(np.fft.rfft(seen - seen.mean())) * 2.0 / len(seen)
    frequency = np.fft.rfftfreq(len(seen), 1.0 / 96.0)
    assert frequency[spectrum.argmax()] == pytest.approx(4.0, abs=1e-9)
    assert spectrum.max() == pytest.approx(0.3 * np.sinc(0.2), abs=1e-9)
    still = [MAINS.later(k / 50.0).mean(0.0, 0.002) for k in range(100)]
    assert np.ptp(still) <= 1e-12


@pytest.mark.parametrize("flicker", [MAINS, SWITCHED], ids=["mains", "pwm"])
def test_a_later_clock(flicker: gs.Flicker) -> None:
    later = flicker.later(12.3456)
    got = later.mean(STARTS, STARTS + 0.003)
    assert np.abs(got - flicker.mean(STARTS + 12.3456, STARTS + 12.3486)).max() <= 1e-9


def test_where_it_is_switched() -> None:
    """Light just before and after differ there, and nowhere else."""
    switches = SWITCHED.switches(0.0, 0.05)
    assert len(switches) == 13 and 0.0 < switches.min() and switches.max() < 0.05
    before, after = (SWITCHED.mean(switches + step, switches + step) for step in (-1e-9, 1e-9))
    assert np.abs(np.abs(after - before) - 1.0 / 0.35).max() <= 1e-12
    assert not len(MAINS.switches(0.0, 1.0))


def test_what_is_refused() -> None:
    for wrong in ({"frequency": 0.0}, {"modulation": 1.1}, {"duty": 0.0}, {"phase": np.inf}):
        with pytest.raises(InputError, match=f"Flicker {next(iter(wrong))}"):
            gs.Flicker(**{"frequency": 100.0, **wrong})
