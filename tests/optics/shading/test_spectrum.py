"""Coloured pictures: three planes that are the grey pictures of the bands, at once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.errors import InputError, TwinMismatch
from gpusim.gpu import Device
from gpusim.gpu.twin import compare
from gpusim.optics.geometry.view import look
from gpusim.optics.shading import scene_buffers
from gpusim.optics.shading.setup import Setup
from gpusim.surface.color import BANDS, in_band

QUAD = [[0, 1, 2, 3]]
BOX = np.array([[x, y, z] for x in (-0.4, 0.3) for y in (-0.5, 0.2) for z in (-0.9, 0.1)])
SIDES = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
SHEET = np.array([[-0.3, -0.2, -0.3], [0.3, -0.1, -0.3], [0.3, 0.1, 0.3], [-0.3, 0.0, 0.3]])
BEHIND = (0.2, 0.1, 0.05)

# The ColorChecker's 24 patches, sRGB of 8 bits (published by its makers).
CHART = """735244 c29682 627a9d 576c43 8580b1 67bdaa d67e2c 505ba6 c15a63 5e3c6c 9dbc40 e0a32e
383d96 469449 af363c e7c71f bb5695 0885a1 f3f3f2 c8c8c8 a0a0a0 7a7a79 555555 343434""".split()


def quad(low: tuple[float, float, float], u: Sequence[float], v: Sequence[float]) -> Any:
    """Corners of a parallelogram."""
    a = np.array(low, float)
    return [a, a + u, a + np.array(u) + v, a + v]


def laboratory(shadows: bool, glossy: bool) -> tuple[list[gs.Surface], list[Any]]:
    """Every kind of pattern in colour, under lamps of two temperatures and even surroundings."""
    texels = np.random.default_rng(1).uniform(0.2, 0.8, (24, 30, 3))
    paint = gs.paint
    body = {"roughness": 0.4, "metallic": 1.0} if glossy else {}
    shown: list[tuple[Any, Any, Any]] = [
        (quad((-2, 1, -1), (4, 0, 0), (0, 0, 3)), QUAD,
         paint.Checker(0.31, dark=(0.05, 0.02, 0.3), light=(0.9, 0.7, 0.4), ground=0.8)),
        (quad((-2, -2, -1), (4, 0, 0), (0, 3, 0)), QUAD,
         paint.Dots(0.1, 0.25, albedo="#ff2010", ground="#2040c0")),
        (BOX, SIDES, paint.Plain("#c8a060", **body)),
        (SHEET + np.array([0.9, -0.3, 0.4]), QUAD,
         paint.Speckle(0.05, dot="#101040", ground="#f0e0d0")),
        (SHEET + np.array([-1.1, -0.3, 0.5]), QUAD, paint.Image(texels, texel=0.015)),
    ]  # fmt: skip
    lights = [
        gs.AreaLight(
            (-1.5, -2.5, 2.5), (0, 0, 0), (0.5, 0.4), 60.0, shadows=shadows, color="#ffb060"
        ),
        gs.PointLight((1.5, -2.5, 1.5), 20.0, shadows=shadows, color=(0.5, 0.9, 1.6)),
        gs.AmbientLight(0.1, color=(1.0, 0.8, 1.2)),
    ]
    return [gs.Surface(points, faces, paint=own) for points, faces, own in shown], lights


def camera(width: int, height: int) -> gs.Camera:
    return gs.Camera.from_lens((36, 24), 35, (width, height), (0.2, -4.0, 0.9), (0, 0, 0.1))


def of_band(surfaces: list[gs.Surface], lights: list[Any] | None, band: int) -> tuple[Any, Any]:
    """The grey scene that a coloured one is in a band."""
    grey = [
        gs.Surface(own.points, own.faces, paint=in_band(next(iter(own.paints.values())), band))
        for own in surfaces
    ]
    return grey, None if lights is None else [in_band(light, band) for light in lights]


@pytest.mark.parametrize(("lit", "shadows"), [(False, False), (True, False), (True, True)])
def test_planes_are_the_pictures_of_the_bands(device: Device, lit: bool, shadows: bool) -> None:
    surfaces, lamps = laboratory(shadows, glossy=not shadows)
    lights = lamps if lit else None
    frame = gs.render(surfaces, camera(120, 80), lights, background=BEHIND, device=device)
    assert frame.radiance.shape == (80, 120, 3) and frame.coloured
    for band in BANDS:
        grey = gs.render(
            *(own := of_band(surfaces, lights, band))[:1], camera(120, 80), own[1],
            background=BEHIND[band], device=device,
        )  # fmt: skip
        np.testing.assert_allclose(
            frame.radiance[..., band], grey.radiance, rtol=2e-6, atol=1e-6, err_msg=f"band {band}"
        )
    assert len(np.unique(frame.radiance[..., 0] / frame.radiance[..., 2])) > 1000


@pytest.mark.parametrize("glossy", [False, True])
def test_the_device_agrees_with_the_twin(device: Device, glossy: bool) -> None:
    surfaces, lights = laboratory(True, glossy)
    found = gs.render(surfaces, camera(96, 64), lights, background=BEHIND, device=device)
    twin = gs.render(surfaces, camera(96, 64), lights, background=BEHIND, backend="numpy")
    # a penumbra's sample may fall to the other side of an outline: 1 of 512
    compare("coloured", found.radiance, twin.radiance, "pixel", atol=2e-3)


def chart() -> tuple[list[gs.Surface], list[Any], gs.Camera, npt.NDArray[np.float64]]:
    """A chart of 6 x 4 patches, its lamps and camera, and the patches' linear colours (24, 3)."""
    surfaces, colors = [], []
    for k, digits in enumerate(CHART):
        row, column = divmod(k, 6)
        corners = quad((column, 0.0, 3.0 - row), (0.9, 0, 0), (0, 0, 0.9))
        own = gs.paint.Plain(f"#{digits}")
        surfaces.append(gs.Surface(corners, QUAD, paint=own))
        colors.append([in_band(own.albedo, band) for band in BANDS])
    lights = [
        gs.PointLight((0.0, -4.0, 4.0), 300.0, color=gs.blackbody(2856.0)),
        gs.PointLight((6.0, -5.0, 1.0), 500.0, color=gs.blackbody(6504.0)),
    ]
    view = gs.Camera.from_lens((36, 24), 50, (120, 80), (3.0, -9.5, 2.0), (3.0, 0.0, 2.0))
    return surfaces, lights, view, np.array(colors)


@pytest.mark.parametrize("backend", ["gpu", "numpy"])
def test_a_chart_under_two_temperatures_is_the_integral(device: Device, backend: str) -> None:
    surfaces, lights, view, colors = chart()
    frame = gs.render(surfaces, view, lights, backend=backend)
    truth = frame.truth()
    at = truth.reference[:, [0, 2]]
    patch = (3 - np.floor(at[:, 1]).astype(int)) * 6 + np.floor(at[:, 0]).astype(int)
    points = np.stack([at[:, 0], np.zeros(len(at)), at[:, 1]], axis=1)
    want = np.zeros((len(at), 3))
    for light in lights:
        to = np.array(light.position) - points
        distance = np.linalg.norm(to, axis=1)
        irradiance = light.power / (4.0 * np.pi) * -to[:, 1] / distance**3
        want += (irradiance / np.pi)[:, None] * np.array(light.color)
    want *= colors[patch]
    got = frame.radiance[truth.row, truth.column]
    whole = np.abs(at - np.floor(at) - 0.45).max(axis=1) < 0.4  # pixels within a patch
    assert len(np.unique(patch[whole])) == 24
    error = np.abs(got - want)[whole] / want[whole]
    assert error.max() < 1e-4, error.max()


def test_a_wrong_colour_is_seen(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    surfaces, lights = laboratory(False, glossy=False)

    def spoiled(setup: Setup) -> None:
        assert setup.palette is not None
        setup.palette[len(setup.palette) // 2, 1] += 0.02

    bindings = scene_buffers._color_bindings

    def wrong(device: Device, setup: Setup) -> dict[str, Any]:
        spoiled(setup)
        return bindings(device, setup)

    twin = gs.render(surfaces, camera(96, 64), lights, backend="numpy")
    monkeypatch.setattr(scene_buffers, "_color_bindings", wrong)
    found = gs.render(surfaces, camera(96, 64), lights, device=device)
    with pytest.raises(TwinMismatch):
        compare("coloured", found.radiance, twin.radiance, "pixel")


def test_a_photograph_blurs_every_plane(device: Device) -> None:
    surfaces, lights = laboratory(False, glossy=False)
    lens = gs.Lens(psf=gs.psf.Gaussian(0.6), vignetting=None)
    given = {"lens": lens, "device": device}
    frame = gs.photograph(surfaces, camera(60, 40), lights, background=BEHIND, **given)
    twin = gs.photograph(
        surfaces, camera(60, 40), lights, background=BEHIND, lens=lens, backend="numpy"
    )
    compare("photograph", frame.radiance, twin.radiance, "pixel")
    grey, lamps = of_band(surfaces, lights, 2)
    blue = gs.photograph(grey, camera(60, 40), lamps, background=BEHIND[2], **given)
    np.testing.assert_allclose(frame.radiance[..., 2], blue.radiance, rtol=2e-6, atol=1e-6)


@pytest.mark.parametrize("backend", ["gpu", "numpy"])
def test_colours_and_places_as_people_write_them(device: Device, backend: str) -> None:
    """Lists and arrays are what tuples are, in scenes with and without other colours."""
    for paint in (gs.paint.Plain(0.5), gs.paint.Plain("#ff8000")):
        wall = gs.Surface(quad((-1, 0, -1), (1, 0, 0), (0, 0, 1)), QUAD, paint=paint)
        want = gs.render([wall], camera(12, 8), background=(1.0, 0.0, 0.0), backend=backend)
        for given in ([1, 0, 0], np.array([1.0, 0.0, 0.0]), "#ff0000"):
            for take in (gs.render, gs.photograph):
                got = take([wall], camera(12, 8), background=given, backend=backend)
                np.testing.assert_array_equal(got.radiance, want.radiance)
        lit = [
            gs.render([wall], camera(12, 8), [gs.PointLight(place, 9.0, color=[2, 1, 0])],
                      backend=backend).radiance
            for place in ((0.0, -3.0, 1.0), [0.0, -3.0, 1.0], np.array([0.0, -3.0, 1.0]))
        ]  # fmt: skip
        assert lit[0].any() and (lit[0] == lit[1]).all() and (lit[0] == lit[2]).all()
    grey = gs.render([wall], camera(12, 8), background=[0.2, 0.2, 0.2], backend=backend)
    assert (grey.radiance[0, 0] == np.float32(0.2)).all()
    for bad in ((1, 2), (1, 2, 3, 4), (0, -1, 0), "red", (np.nan, 0, 0)):
        with pytest.raises(InputError, match=r"render background; got .*'#rrggbb'"):
            gs.photograph([wall], camera(12, 8), background=bad, backend=backend)  # type: ignore[arg-type]


def test_surroundings_in_colour_are_mirrored(device: Device) -> None:
    random = np.random.default_rng(3)
    sky = gs.EnvironmentLight(image=random.uniform(0.0, 1.0, (16, 32, 3)), color=(1.0, 0.9, 0.5))
    lacquer = gs.paint.Plain("#d02010", roughness=0.3)
    box = gs.Surface(BOX, SIDES, paint=lacquer)
    frame = gs.render([box], camera(90, 60), [sky], device=device)
    twin = gs.render([box], camera(90, 60), [sky], backend="numpy")
    # a map of noise, looked up in float32
    compare("surroundings", frame.radiance, twin.radiance, "pixel", atol=1e-4)
    for band in BANDS:
        grey, lamps = of_band([box], [sky], band)
        own = gs.render(grey, camera(90, 60), lamps, device=device)
        np.testing.assert_allclose(frame.radiance[..., band], own.radiance, rtol=1e-5, atol=1e-6)


def test_grey_scenes_have_one_plane_and_the_programs_of_one(device: Device) -> None:
    box = gs.Surface(BOX, SIDES, paint=gs.paint.Plain([0.4, 0.4, 0.4]))
    device.programs.asked.clear()
    frame = gs.render([box], camera(90, 60), [gs.PointLight((0, -4, 3), 9.0)], device=device)
    assert frame.planes == (frame,) and frame.radiance.shape == (60, 90)
    assert not [name for name, *_ in device.programs.asked if "@" in str(name)]
    setup = Setup.build(look([box], camera(90, 60), lit=False), None, 0.0)
    assert setup.palette is None and len(setup.bands) == 1
