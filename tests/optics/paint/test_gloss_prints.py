"""Patterns on glossy ground: what they must be, put together from plain plates."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.errors import InputError
from gpusim.gpu import Device
from gpusim.surface.features import SECTOR, Features, Paint, Stack

Array = npt.NDArray[np.float64]
CAMERA = gs.Camera.from_lens((36, 24), 42, (67, 45), (0.3, -0.9, 1.4), (0.05, 0, 0))
LIGHTS = [gs.AreaLight((-0.3, 1.2, 0.9), (0, 0, 0), (0.3, 0.2), 10.0), gs.AmbientLight(0.4)]
GROUND = 0.55
STEEL = {"roughness": 0.4, "metallic": 1.0}
LACQUER = {"roughness": 0.3, "metallic": 0.0}
CENTRES = np.array([[0.62, 0.7], [1.35, 1.2]])


def picture(paint: Paint, device: Device | None = None, lit: bool = True) -> Array:
    points = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    surface = gs.Surface(points, np.array([[0, 1, 2, 3]]), paint=paint)
    backend = "numpy" if device is None else "gpu"
    frame = gs.render([surface], CAMERA, LIGHTS if lit else None, device=device, backend=backend)
    return frame.radiance.astype(np.float64)


@cache
def plain(albedo: float, lit: bool = True, **finish: float) -> Array:
    return picture(gs.paint.Plain(albedo, **finish), lit=lit)


def circles(**finish: float) -> Paint:
    return gs.paint.Circles(CENTRES, (0.6, 0.4, 0.15), ground=GROUND, **finish)


def star(**finish: float) -> Paint:
    return gs.paint.Star(CENTRES, 0.6, 9, 0.2, ground=GROUND, **finish)


def aruco(**finish: float) -> Paint:
    return gs.paint.Aruco(CENTRES, (3, 17), 0.5, angle=0.3, ground=GROUND, **finish)


def charuco(**finish: float) -> Paint:
    return gs.paint.Charuco(4, 3, 0.3, 0.22, origin=(0.4, 0.5), ground=GROUND, **finish)


def lines(**finish: float) -> Paint:
    return gs.paint.Lines(0.37, 0.11, "both", 3, 3, (0.4, 0.42), ground=GROUND, **finish)


def ring_codes(**finish: float) -> Paint:
    return gs.paint.RingCodes(CENTRES, (5, 177), 0.17, dot=0.9, ground=GROUND, **finish)


@dataclass(frozen=True)
class Fan:
    """A user's paint: sectors that lie on bare ground, not on a disc as those of stars do."""

    ground: float = GROUND
    dark: float = 0.1
    roughness: float = 1.0
    metallic: float = 0.0
    bump: None = None

    def features(self, low: Array, high: Array) -> Features | None:
        stack = Stack(self.ground)
        stack.add(SECTOR, CENTRES, 0.4, self.dark, self.ground, 0, angle=0.3, width=2.6)
        return stack.features()


def fan(**finish: float) -> Paint:
    return Fan(**finish)


# What of the ground is bare is the albedo of the same outlines in black on white, without light.
BARE: dict[Callable[..., Paint], Paint] = {
    circles: gs.paint.Circles(CENTRES, (0.6,), dark=0.0, ground=1.0),
    star: gs.paint.Circles(CENTRES, (0.6,), dark=0.0, ground=1.0),
    aruco: gs.paint.Aruco(CENTRES, (3, 17), 0.5, angle=0.3, dark=0.0, light=0.0, ground=1.0),
    charuco: gs.paint.Checker(0.3, 4, 3, (0.4, 0.5), dark=0.0, light=0.0, ground=1.0),
    lines: gs.paint.Lines(0.37, 0.11, "both", 3, 3, (0.4, 0.42), albedo=0.0, ground=1.0),
    ring_codes: gs.paint.Circles(CENTRES, (0.51,), dark=0.0, ground=1.0),
    fan: Fan(ground=1.0, dark=0.0),
}


@pytest.mark.parametrize("make", BARE, ids=lambda make: str(make.__name__))
def test_targets_are_matte_prints_on_steel(make: Callable[..., Paint], device: Device) -> None:
    """Each pixel: the matte pattern, less its bare ground in matte, plus that ground in steel."""
    bare = picture(BARE[make], lit=False)
    matte, steel = plain(GROUND), plain(GROUND, **STEEL)
    on_matte = picture(make())
    want = on_matte + bare * (steel - matte)
    assert np.abs(steel - matte).max() > 0.05  # so that a wrong share shows
    partly = (bare > 0.02) & (bare < 0.98)
    assert partly.sum() > 60 and (bare < 1e-6).sum() > 40
    got = picture(make(**STEEL))
    np.testing.assert_allclose(got, want, atol=3e-6)
    # the device's float32 has its own 5e-4 in the tips of spokes, in matte and in steel alike
    on_device = picture(make(**STEEL), device) - picture(make(), device)
    np.testing.assert_allclose(on_device, got - on_matte, atol=3e-5)


def speckle(**finish: float) -> Paint:
    return gs.paint.Speckle(0.12, 0.45, 0.02, seed=3, dot=0.05, ground=0.8, **finish)


def bitmap(**finish: float) -> Paint:
    values = np.random.default_rng(4).uniform(0.1, 0.9, (17, 23))
    return gs.paint.Image(values, 0.07, (0.2, 0.3), 0.05, 0.85, 0.6, **finish)


@pytest.mark.parametrize("finish", [STEEL, LACQUER], ids=["steel", "lacquer"])
@pytest.mark.parametrize("make", [speckle, bitmap], ids=lambda make: str(make.__name__))
def test_speckle_and_pictures_lie_under_the_gloss(
    make: Callable[..., Paint], finish: dict[str, float], device: Device
) -> None:
    """Radiance is linear in the albedo: that of black, plus albedo times what white has more."""
    black, white = (plain(albedo, **finish) for albedo in (0.0, 1.0))
    albedo = picture(make(), lit=False)
    want = black + albedo * (white - black)
    assert black.max() > 0.01 and np.ptp(albedo) > 0.4
    got = picture(make(**finish))
    seen = plain(1.0, lit=False) > 0.999  # not the plate's own edges
    np.testing.assert_allclose(got[seen], want[seen], atol=3e-6)
    np.testing.assert_allclose(picture(make(**finish), device), got, atol=4e-4)
    assert np.abs(got - picture(make())).max() > 0.02


def test_finishes_that_cannot_be() -> None:
    makers: list[Callable[..., Any]] = [circles, star, aruco, charuco, lines, ring_codes, speckle,
                                        bitmap]  # fmt: skip
    for make in makers:
        with pytest.raises(InputError, match=r"roughness; got -0\.1; expected 0 to 1"):
            make(roughness=-0.1)
        with pytest.raises(InputError, match=r"metallic; got 1\.5; expected 0 to 1"):
            make(metallic=1.5)
