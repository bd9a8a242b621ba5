"""Light from tiles on large flat faces, against the light of every pixel."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import gpusim as gs
from gpusim.gpu import Device
from gpusim.optics.geometry.view import look
from gpusim.optics.shading import tile_light
from gpusim.optics.shading.setup import Setup
from gpusim.optics.shading.tile_light import LightTiles

CAMERA = gs.Camera.from_lens((36.0, 24.0), 90.0, (301, 203), (0.1, -2.2, 0.9), (0.03, 0.1, 0.1))
LAMPS = [
    gs.AreaLight((-0.6, -1.4, 1.9), (0.0, 0.0, 0.0), (0.3, 0.2), 30.0),
    gs.SunLight((0.3, 0.2, -1.0), 0.4, diameter=0.02),
]
QUAD = np.array([[0, 1, 2, 3]])


def room(paint: gs.paint.Plain, bend: float = 0.0) -> list[gs.Surface]:
    """A tilted floor under a small plate, which throws shadows on it."""
    corners = np.array([[-1.3, -1.0], [1.1, -1.0], [1.1, 0.9], [-1.3, 0.9]])
    floor = np.concatenate([corners, 0.1 * corners[:, :1]], axis=1)
    floor[2, 2] += bend
    plate = np.concatenate([0.2 * corners + [0.1, 0.05], np.full((4, 1), 0.4)], axis=1)
    checker = gs.paint.Checker(0.11, dark=0.1, light=0.8, origin=(0.03, 0.05))
    return [gs.Surface(floor, QUAD, paint=paint), gs.Surface(plate, QUAD, paint=checker)]


def setup_of(surfaces: list[gs.Surface], lights: list[object]) -> Setup:
    return Setup.build(look(surfaces, CAMERA, lit=True), lights, 0.0, surfaces)  # type: ignore[arg-type]


@pytest.mark.parametrize("distortion", [None, [0.06, -0.03, 1e-3, 2e-3]])
def test_tiles_are_as_right_as_they_promise(
    distortion: list[float] | None, device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    surfaces = room(gs.paint.Plain(0.6))
    camera = replace(CAMERA, distortion=distortion)
    images = []
    for tolerance in (1e-2, -1.0):
        monkeypatch.setattr(tile_light, "TOLERANCE", tolerance)
        images.append(gs.render(surfaces, camera, LAMPS, device=device).radiance)
    off = np.abs(images[0] - images[1]) / images[1].max()
    assert 1e-5 < off.max() <= 1e-2


def test_only_flat_matte_faces_far_from_lamps_without_beams_have_tiles() -> None:
    spot = gs.SpotLight((-0.6, -1.4, 1.9), (0.0, 0.0, 0.0), 5.0, cone=0.4)
    close = gs.PointLight((0.0, 0.0, 0.15), 1.0)
    matte, shiny = gs.paint.Plain(0.6), gs.paint.Plain(0.6, roughness=0.4, metallic=1.0)
    found = LightTiles.of(setup_of(room(matte), LAMPS), 1e-2)
    assert found is not None
    view = setup_of(room(matte), LAMPS).view
    np.testing.assert_array_equal(found.member, view.face == 0)
    assert LightTiles.of(setup_of(room(matte), [*LAMPS, spot]), 1e-2) is None
    assert LightTiles.of(setup_of(room(matte), [*LAMPS, close]), 1e-2) is None
    assert LightTiles.of(setup_of(room(shiny), LAMPS), 1e-2) is None


def test_planes_that_meet_in_a_square_share_it_with_nobody() -> None:
    """Two halves of a bent floor: the larger one gets the squares at the crease."""
    found = LightTiles.of(setup_of(room(gs.paint.Plain(0.6), bend=0.2), LAMPS), 1e-2)
    whole = LightTiles.of(setup_of(room(gs.paint.Plain(0.6)), LAMPS), 1e-2)
    assert whole is not None
    assert found is None or 0 < found.member.sum() < whole.member.sum()
