"""What triangles look like, found on the device by a guess at the largest pixel: the same image."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.gpu import Device
from gpusim.optics.geometry.view import View, look
from gpusim.optics.shading import looks
from gpusim.optics.shading.looks import looks_twin, sampled
from gpusim.optics.shading.setup import Setup
from gpusim.surface.paint import Checker, Paint, Plain

EYE = (0.07, -0.84, 0.05)
CAMERA = gs.Camera.from_lens((36.0, 24.0), 46.0, (361, 242), EYE, (0.0, 0.0, 0.01))
BENT = gs.Camera.from_lens(
    (36.0, 24.0), 46.0, (361, 242), EYE, (0.0, 0.0, 0.01), distortion=(-0.1, 0.03, 1e-3, -2e-3)
)
LIGHTS = [gs.PointLight((-1.0, -2.0, 1.0), 50.0, shadows=False)]
ENDING = Checker(0.061, 7, 5, (-0.23, -0.13), 0.1, 0.7, 0.4)


def wavy(
    paint: Paint, height: float = 0.01, moved: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> gs.Surface:
    columns, rows = 90, 60
    x, z = np.meshgrid(np.linspace(-0.31, 0.29, columns + 1), np.linspace(-0.2, 0.21, rows + 1))
    flat = np.stack([x, 0.0 * x, z], axis=-1).reshape(-1, 3)
    points = flat + np.array([0.0, 1.0, 0.0]) * (height * np.sin(9.0 * x + 4.0 * z)).reshape(-1, 1)
    points += np.array(moved)
    node = np.arange(len(points)).reshape(x.shape)
    faces = np.stack([node[:-1, :-1], node[:-1, 1:], node[1:, 1:], node[1:, :-1]], axis=-1)
    return gs.Surface(points, faces.reshape(-1, 4), paint=paint, reference=flat)


@pytest.fixture(autouse=True)
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(looks, "FEWEST", 1000)


def pictures(
    device: Device, surfaces: list[gs.Surface], camera: gs.Camera, patch: pytest.MonkeyPatch
) -> list[npt.NDArray[np.float32]]:
    """With the largest pixel guessed, and without; whether it was is checked."""
    guesses: list[View | None] = []
    result = []
    for ask in (sampled, lambda view: None):

        def asked(view: View) -> View | None:
            guesses.append(ask(view))  # noqa: B023
            return guesses[-1]

        patch.setattr(sys.modules["gpusim.optics.rendering.renderer"], "sampled", asked)
        result.append(gs.render(surfaces, camera, LIGHTS, device=device).radiance)
    assert guesses[0] is not None and guesses[1] is None
    return result


@pytest.mark.parametrize("camera", [CAMERA, BENT])
@pytest.mark.parametrize("paint", [ENDING, Checker(0.07, None, 3, (0.0, -0.1)), Plain(0.3)])
def test_a_picture_is_the_same_as_with_the_largest_pixel(
    device: Device, monkeypatch: pytest.MonkeyPatch, camera: gs.Camera, paint: Paint
) -> None:
    if not device.atomics64:
        pytest.skip("no 64-bit atomics")
    got, want = pictures(device, [wavy(paint)], camera, monkeypatch)
    assert np.abs(got - want).max() <= 5e-7 * want.max()
    assert np.ptp(want) > 0.0


def test_several_surfaces_have_their_own_paints(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not device.atomics64:
        pytest.skip("no 64-bit atomics")
    behind = wavy(Checker(0.09), moved=(0.1, 0.3, 0.02))
    wall = wavy(Plain(0.2), moved=(-0.2, 0.2, 0.1))
    got, want = pictures(device, [wavy(ENDING), behind, wall], CAMERA, monkeypatch)
    assert np.abs(got - want).max() <= 5e-7 * want.max()
    twin = gs.render([wavy(ENDING), behind, wall], CAMERA, LIGHTS, backend="numpy").radiance
    assert np.abs(got - twin).max() < 2e-4 * twin.max()


def test_a_wrong_guess_is_noticed(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    if not device.atomics64:
        pytest.skip("no 64-bit atomics")
    want = gs.render([wavy(ENDING)], CAMERA, LIGHTS, device=device).radiance

    def small(view: View) -> View | None:
        found = sampled(view)
        assert found is not None
        paints = tuple(replace(region, reach=0.4 * region.reach) for region in found.paints)
        return replace(found, found=(paints, found.footprint))

    rendering = sys.modules["gpusim.optics.rendering.renderer"]
    monkeypatch.setattr(rendering, "sampled", small)
    again = gs.render([wavy(ENDING)], CAMERA, LIGHTS, device=device).radiance
    monkeypatch.setattr(rendering, "sampled", lambda view: None)
    certain = gs.render([wavy(ENDING)], CAMERA, LIGHTS, device=device).radiance
    np.testing.assert_array_equal(again, certain)
    assert np.abs(want - certain).max() <= 5e-7 * want.max()


def test_no_guess_where_pixels_differ_or_boards_are_fine(monkeypatch: pytest.MonkeyPatch) -> None:
    view = look([wavy(ENDING)], CAMERA, lit=True)
    found = sampled(view)
    assert found is not None and found.guessed
    # no less than it is, and not half as much again beyond what it could be
    assert view.paints[0].reach / 1.1 < found.paints[0].reach < 1.6 * view.paints[0].reach
    # seen at 45 degrees, pixels differ twofold, but evenly
    aslant = gs.Camera.from_lens((36.0, 24.0), 34.0, (361, 242), (0.6, -0.6, 0.05), (0.0, 0.0, 0.0))
    tilted = look([wavy(ENDING)], aslant, lit=True)
    found = sampled(tilted)
    assert found is not None and found.paints[0].reach > tilted.paints[0].reach / 1.1
    assert sampled(look([wavy(Checker(0.002))], CAMERA, lit=True)) is None
    # creased so deeply that some triangles are seen at a grazing angle
    assert sampled(look([wavy(ENDING, height=0.2)], CAMERA, lit=True)) is None
    # what isn't seen of a paint can't be told
    away = wavy(Checker(0.09), moved=(9.0, 0.0, 0.0))
    assert sampled(look([wavy(ENDING), away], CAMERA, lit=True)) is None
    monkeypatch.setattr(looks, "FEWEST", 20_000)
    assert sampled(view) is None


def test_what_the_twin_takes_for_plain_is_plain_by_the_largest_pixel() -> None:
    setup = Setup.build(look([wavy(ENDING)], CAMERA, lit=True), LIGHTS, 0.0)
    near, albedo, _ = looks_twin(setup)
    assert not near[~setup.near_feature].any() and 0.03 < near.mean() < 0.9
    plain = ~setup.near_feature
    np.testing.assert_array_equal(albedo[plain], setup.albedo[plain])
    assert set(albedo[~near]) == {np.float32(v) for v in (0.1, 0.7, 0.4)}


def test_groups_of_some_triangles_are_those_of_all() -> None:
    view = look([wavy(ENDING)], CAMERA, lit=True)
    setup = Setup.build(view, LIGHTS, 0.0)
    guessed = replace(view, found=(view.paints, view.footprint), guessed=True)
    some = np.array([7, 3000, 41, 7, 9, 5000, 1234])
    got = Setup.build(guessed, LIGHTS, 0.0).groups_of(some)
    np.testing.assert_array_equal(got, setup.groups[some])
    assert Setup.build(guessed, LIGHTS, 0.0).groups_present() == setup.groups_present() == [0, 1]
