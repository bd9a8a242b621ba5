"""Lamps that flicker in an exposure: row by row, lamp by lamp, and in flashes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.errors import InputError
from gpusim.gpu import Device
from gpusim.optics.lens.exposure import plan_exposure
from gpusim.optics.light.lights import Light

MAINS = gs.Flicker(frequency=100.0, modulation=0.4, phase=0.3)
SWITCHED = gs.Flicker(frequency=190.0, duty=0.3, phase=1.0)
WALL = gs.Surface([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2, 3]])
CARD = gs.Surface([[-0.2, -0.2, 0.3], [0.2, -0.2, 0.3], [0.0, 0.3, 0.3]], [[0, 1, 2, -1]])
ROWS = 90
CAMERA = gs.Camera.from_lens((36, 54), 50, (60, ROWS), (0, 0, 2), (0, 0, 0), up=(0, 1, 0))
SMALL = CAMERA.reframed(12, 18, corner=(0.0, 0.0), scale=(0.2, 0.2))
LEFT = gs.PointLight((-0.7, 0.3, 2.0), power=60.0)
RIGHT = gs.SpotLight((0.8, 0.1, 1.5), (0, 0, 0), power=40.0)
ROOM = gs.AmbientLight(0.2)


def radiance(
    lights: Sequence[Light], device: Device | None, camera: gs.Camera = CAMERA, **how: Any
) -> npt.NDArray[np.float64]:
    backend = "numpy" if device is None else "gpu"
    frame = gs.photograph([WALL, CARD], camera, lights, device=device, backend=backend, **how)
    return frame.radiance.astype(np.float64)


def flickering(light: Light, flicker: gs.Flicker) -> Light:
    return replace(light, flicker=flicker)


@pytest.mark.parametrize("twin", [False, True], ids=["device", "twin"])
def test_bands_of_a_rolling_shutter(device: Device, twin: bool) -> None:
    """In 100 Hz light 1 / (f line_time) rows apart, of contrast m sinc(f T), none of T = 1 / f."""
    where, line_time, start = None if twin else device, 250e-6, 0.013
    steady = radiance([LEFT], where)
    for exposure in (0.0, 0.004, 0.01):
        shutter = gs.Shutter(exposure, line_time)
        seen = radiance([flickering(LEFT, MAINS)], where, shutter=shutter, time=start)
        middle = start + line_time * np.arange(ROWS) + 0.5 * exposure
        bands = np.cos(2.0 * np.pi * 100.0 * middle + 0.3)
        want = 1.0 + 0.4 * np.sinc(100.0 * exposure) * bands
        assert np.abs(seen - want[:, None] * steady).max() <= 1e-6 * steady.max()
        if exposure == 0.004:
            ratio = seen[5:85, 10] / steady[5:85, 10] - 1.0
            assert np.abs(ratio[40:] - ratio[:-40]).max() <= 1e-6, "40 rows a period"
            assert ratio.max() >= 0.99 * 0.4 * np.sinc(0.4)


@pytest.mark.parametrize("twin", [False, True], ids=["device", "twin"])
@pytest.mark.parametrize("line_time", [0.0, 60e-6])
def test_each_lamp_by_its_own_flicker(device: Device, twin: bool, line_time: float) -> None:
    """The sum of what each lamp shows alone, times its own factor; what is steady, and what is
    behind the surfaces, as it is. By one rendering where all rows are exposed at once."""
    where, shutter = None if twin else device, gs.Shutter(0.0031, line_time)
    lens = gs.Lens(psf=gs.psf.Gaussian(0.8), samples_per_px=2)
    how: dict[str, Any] = {"camera": SMALL, "lens": lens}
    left, right = (radiance([lamp], where, **how) for lamp in (LEFT, RIGHT))
    room = radiance([ROOM], where, background=0.15, **how)
    opens = 0.02 + line_time * np.arange(SMALL.height)
    factors = [kind.mean(opens, opens + 0.0031)[:, None] for kind in (MAINS, SWITCHED)]
    lights = [flickering(LEFT, MAINS), ROOM, flickering(RIGHT, SWITCHED)]
    seen = radiance(lights, where, shutter=shutter, time=0.02, background=0.15, **how)
    want = room + factors[0] * left + factors[1] * right
    assert np.abs(seen - want).max() <= 2e-6 * want.max()
    plan = plan_exposure([WALL], CAMERA, gs.Lens(), shutter, 0.02, 0.25, lights, True)
    assert len(plan.parts) == (3 if line_time else 1)


@pytest.mark.parametrize("twin", [False, True], ids=["device", "twin"])
def test_coloured_and_grey_lamps_apart(device: Device, twin: bool) -> None:
    """A rendering of a grey lamp alone is grey; the picture isn't."""
    where, shutter = None if twin else device, gs.Shutter(0.001, 250e-6)
    red, opens = replace(LEFT, color=(1.0, 0.4, 0.1)), 250e-6 * np.arange(SMALL.height)
    seen = radiance([flickering(red, MAINS), RIGHT], where, SMALL, shutter=shutter)
    factor = MAINS.mean(opens, opens + 0.001)[:, None, None]
    grey = radiance([RIGHT], where, SMALL)[..., None]
    assert np.abs(seen - grey - factor * radiance([red], where, SMALL)).max() <= 2e-6 * seen.max()


def test_steady_lamps_cost_nothing(device: Device) -> None:
    """The very lights, one rendering, the same bits; so does a PWM that is always on."""
    shutter, lights = gs.Shutter(0.002, 40e-6), [LEFT, RIGHT, ROOM]
    (part,) = plan_exposure([WALL], CAMERA, gs.Lens(), shutter, 0.0, 0.25, lights).parts
    assert part.lights is lights and part.gains is None
    steady = radiance([LEFT, RIGHT, ROOM], device)
    always = gs.Flicker(frequency=1000.0, duty=1.0)
    same = [replace(light, flicker=always) for light in lights]
    assert np.array_equal(radiance(same, device, shutter=gs.Shutter(0.002)), steady)


def test_dark_while_it_is_switched_off(device: Device) -> None:
    """Black, but for what is behind the surfaces."""
    dark = flickering(LEFT, gs.Flicker(frequency=10.0, duty=0.2))
    for line_time in (0.0, 1e-5):
        shutter = gs.Shutter(0.01, line_time)
        seen = radiance([dark], device, shutter=shutter, time=0.05)
        assert not seen.any()
        seen = radiance([dark], device, shutter=shutter, time=0.05, background=0.5)
        assert seen.min() == 0.0 and seen.max() == 0.5


@pytest.mark.parametrize("line_time", [0.0, 5e-6])
def test_an_edge_in_flashes(line_time: float) -> None:
    """A card that moves 10 px while the shutter is open, in a flash of 0.1 ms: it is where it was
    then, hardly blurred; in the light of two of them it is at both places."""
    length, speed, flash = 0.01, 1000.0, 1e-4
    px = 2.0 * 0.6 / 50.0  # m a pixel in the plane of the wall

    def card(time: float) -> list[gs.Surface]:
        left = (speed * time - 25.0) * px
        place = [[left, -2, 0], [left + 2, -2, 0], [left + 2, 2, 0], [left, 2, 0]]
        return [gs.Surface(place, [[0, 1, 2, 3]])]

    def edge(kind: gs.Flicker) -> float:
        frame = gs.photograph(
            card, CAMERA, [replace(ROOM, flicker=kind)], shutter=gs.Shutter(length, line_time),
            backend="numpy",
        )  # fmt: skip
        row = frame.radiance[0].astype(np.float64)
        return float(59.5 - row.sum() / row[-1])

    kind = gs.Flicker(frequency=50.0, duty=50.0 * flash, phase=-2.0 * np.pi * 50.0 * 0.0033)
    want = 29.5 - 25.0 + speed * (0.0033 + 0.5 * flash)
    abs_error = 0.16 if line_time else 0.005
    assert edge(kind) == pytest.approx(want, abs=abs_error)
    twice = replace(kind, frequency=200.0, duty=200.0 * flash, phase=-2.0 * np.pi * 200.0 * 0.0033)
    assert edge(twice) == pytest.approx(
        want + 0.5 * speed * 0.005, abs=0.005 if not line_time else 0.16
    )


def test_what_is_no_flicker() -> None:
    with pytest.raises(InputError, match=r"light: flicker; got 0\.3; expected a Flicker"):
        gs.photograph([WALL], CAMERA, [replace(LEFT, flicker=0.3)], backend="numpy")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="render lights"):
        gs.photograph([WALL], CAMERA, [0.3], backend="numpy")  # type: ignore[list-item]
