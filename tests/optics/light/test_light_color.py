"""Colours of lights: temperatures against published chromaticities, and what each band gets."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError
from gpusim.optics.light.blackbody import XYZ_OF_RGB, tristimulus
from gpusim.optics.light.environment import Environment
from gpusim.optics.light.quadrature import emitters
from gpusim.surface.color import BANDS, in_band, is_colored

WARM = gs.blackbody(3000.0)

LIGHTS: dict[str, Callable[..., Any]] = {
    "point": lambda **k: gs.PointLight((0, 0, 3), 40.0, **k),
    "spot": lambda **k: gs.SpotLight((0, 0, 3), (0, 0, 0), 40.0, **k),
    "area": lambda **k: gs.AreaLight((0, 0, 3), (0, 0, 0), (0.3, 0.2), 40.0, **k),
    "sun": lambda **k: gs.SunLight((0, 0.3, -1), 800.0, **k),
    "ambient": lambda **k: gs.AmbientLight(0.3, **k),
    "environment": lambda **k: gs.EnvironmentLight(1.0, 0.2, **k),
}


@pytest.mark.parametrize(
    ("temperature", "x", "y"),
    [  # Wyszecki and Stiles, "Color Science", 2nd ed., 1982, table 1(3.11); CIE 15 for A
        (1000.0, 0.6528, 0.3444), (1500.0, 0.5857, 0.3931), (2000.0, 0.5267, 0.4133),
        (2500.0, 0.4770, 0.4137), (2856.0, 0.44757, 0.40745), (4000.0, 0.3805, 0.3768),
        (5000.0, 0.3451, 0.3516), (6504.0, 0.3135, 0.3236), (8000.0, 0.2952, 0.3048),
        (10000.0, 0.2807, 0.2884),
    ],
)  # fmt: skip
def test_chromaticities_of_black_bodies(temperature: float, x: float, y: float) -> None:
    xyz = tristimulus(temperature)
    found = xyz[:2] / xyz.sum()
    print(f"{temperature:.0f} K: off by {found - [x, y]}")
    assert np.abs(found - [x, y]).max() <= 2e-4
    rgb = np.array(gs.blackbody(temperature))
    assert rgb.mean() == pytest.approx(1.0, abs=1e-15) and rgb.min() >= 0.0
    if temperature >= 2000.0:  # inside the triangle of the primaries: nothing is cut off
        back = XYZ_OF_RGB @ rgb
        np.testing.assert_allclose(back[:2] / back.sum(), found, rtol=1e-12)


def test_hotter_is_bluer_all_the_way() -> None:
    colors = np.array([gs.blackbody(t) for t in np.geomspace(800.0, 40_000.0, 60)])
    assert (np.diff(colors[:, 0]) <= 1e-12).all() and (np.diff(colors[:, 2]) >= -1e-12).all()
    assert colors[0].tolist() == [3.0, 0.0, 0.0]
    for wrong in (799.0, 40_001.0, np.nan, np.inf):
        with pytest.raises(
            InputError, match=r"blackbody temperature; got .*expected 800 to 40000 K"
        ):
            gs.blackbody(wrong)


@pytest.mark.parametrize("kind", LIGHTS)
def test_a_band_gets_its_share(kind: str) -> None:
    make = LIGHTS[kind]
    plain = make()
    assert not is_colored(plain) and plain.color is None and plain.in_band(1) is plain
    light = make(color=[0.2, 0.4, 0.6])
    assert is_colored(light)
    np.testing.assert_allclose(light.color, [0.5, 1.0, 1.5])
    for band, share in zip(BANDS, (0.5, 1.0, 1.5), strict=True):
        own = light.in_band(band)
        assert type(own) is type(plain) and not is_colored(own)
        assert own is light.in_band(band) is in_band(light, band)
        for name, value in vars(plain).items():
            strong = name in plain.strengths
            assert getattr(own, name) == (pytest.approx(share * value) if strong else value)
    for same in ([1, 1, 1], "#808080", 0.7):
        assert make(color=same).color is None
    np.testing.assert_allclose(make(color=WARM).color, WARM, rtol=1e-15)


@pytest.mark.parametrize("kind", LIGHTS)
@pytest.mark.parametrize(
    ("value", "part"),
    [("warm", "#rrggbb"), ([1, 2], "three numbers"), (True, "three numbers"), (0.0, "not all"),
     ([0, 0, 0], "not all"), ([1, -1, 1], "from 0 up"), ([1, np.nan, 1], "three numbers")],
)  # fmt: skip
def test_what_is_no_colour_of_light(kind: str, value: Any, part: str) -> None:
    with pytest.raises(InputError, match=rf"Light color; got .*expected .*{part}"):
        LIGHTS[kind](color=value)


def test_a_band_without_light() -> None:
    """A red lamp has no power in green: no error, and nothing falls on anything."""
    lamp = gs.PointLight((0, 0, 3), 40.0, color="#ff0000")
    assert [lamp.in_band(band).power for band in BANDS] == [120.0, 0.0, 0.0]
    assert emitters([lamp.in_band(1)], np.zeros((1, 3)))[0, 3] == 0.0


def test_power_is_what_an_equally_sensitive_sensor_gets() -> None:
    points = np.zeros((1, 3))
    for make in (LIGHTS["point"], LIGHTS["area"], LIGHTS["sun"]):
        bands = [emitters([make(color=WARM).in_band(band)], points)[:, 3] for band in BANDS]
        np.testing.assert_allclose(np.mean(bands, axis=0), emitters([make()], points)[:, 3])


def test_surroundings_in_colour() -> None:
    image = np.random.default_rng(2).random((6, 12, 3))
    light = gs.EnvironmentLight(image=image, color=[1.0, 2.0, 3.0])
    assert is_colored(light) and is_colored(gs.EnvironmentLight(image=image))
    up = np.array([[0.0, 0.0, 1.0]])
    total = np.zeros(1)
    for band, share in zip(BANDS, (0.5, 1.0, 1.5), strict=True):
        own = light.in_band(band)
        assert own.image is not None and own is light.in_band(band)
        np.testing.assert_allclose(own.image, share * image[..., band])
        found = Environment.of([own])
        assert found is not None
        total += found.diffuse(up)
    # light adds up: the mean of the bands is the picture of the means
    mean = Environment.of([gs.EnvironmentLight(image=(image * [0.5, 1.0, 1.5]).mean(axis=2))])
    assert mean is not None and total / 3.0 == pytest.approx(mean.diffuse(up))
    grey = gs.EnvironmentLight(image=np.repeat(image[..., :1], 3, axis=2))
    assert not is_colored(grey) and grey.image is not None and grey.image.shape == (6, 12)
    with pytest.raises(InputError, match=r"image; got shape \(6, 12, 4\); expected finite values"):
        gs.EnvironmentLight(image=np.ones((6, 12, 4)))
