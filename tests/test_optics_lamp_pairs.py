"""What is left out of the lists of faces, receiver by receiver."""

from __future__ import annotations

import numpy as np
import pytest

import gpusim as gs
from gpusim.optics import faces_before
from gpusim.optics.lamp_pairs import LampPairs
from gpusim.optics.light import Light
from gpusim.optics.setup import Setup
from gpusim.optics.shade import shade_twin
from gpusim.optics.shadow_tiles import ShadowTiles
from gpusim.optics.view import look
from gpusim.optics.visibility import visibility_twin
from tests.test_optics_receivers import tube

LAMPS = {
    "small": gs.PointLight((-0.8, -1.2, 2.0), 30.0),
    "large": gs.AreaLight((-0.8, -1.2, 2.0), (0.0, 0.0, 0.0), (0.4, 0.3), 30.0),
    "far": gs.SunLight(direction=(0.5, 0.6, -1.2), irradiance=3.0),
}
CAMERA = gs.Camera.from_lens(
    (36.0, 27.0), 40.0, (320, 240), eye=(0.2, -0.4, 2.5), target=(0.0, 0.0, 0.0)
)


def shadows(surfaces: list[gs.Surface], lamp: Light) -> tuple[ShadowTiles, np.ndarray]:
    """Tiles and the twin's picture."""
    view = look(surfaces, CAMERA, lit=True)
    setup = Setup.build(view, [lamp], 0.0, surfaces)
    assert setup.lighting.shadows is not None
    return setup.lighting.shadows, shade_twin(setup, visibility_twin(view))


def ground() -> gs.Surface:
    corners = [[-1.5, -1.2, -0.5], [1.5, -1.2, -0.5], [1.5, 1.2, -0.5], [-1.5, 1.2, -0.5]]
    return gs.Surface(np.array(corners), np.array([[0, 1, 2, 3]]), gs.paint.Plain(0.7))


@pytest.mark.parametrize("lamp", list(LAMPS))
def test_faces_left_out_hide_nothing(lamp: str, monkeypatch: pytest.MonkeyPatch) -> None:
    surfaces = [tube(40, 12), ground()]
    _, few = shadows(surfaces, LAMPS[lamp])
    monkeypatch.setattr(
        LampPairs, "may_hide", lambda self, at, across, down, receiver, face: receiver >= 0
    )
    _, every = shadows(surfaces, LAMPS[lamp])
    np.testing.assert_allclose(few, every, rtol=0.0, atol=1.5 / 512 * float(every.max()))
    assert (few != every).mean() < 1e-3
    # and what is left in matters
    monkeypatch.setattr(
        LampPairs, "may_hide", lambda self, at, across, down, receiver, face: receiver < 0
    )
    _, none = shadows(surfaces, LAMPS[lamp])
    assert np.abs(none - every).max() > 0.1 * float(every.max())


@pytest.mark.parametrize("lamp", list(LAMPS))
def test_what_bulges_has_no_lists(lamp: str, monkeypatch: pytest.MonkeyPatch) -> None:
    surfaces = [tube(30, 3), ground()]
    tiles, picture = shadows(surfaces, LAMPS[lamp])
    monkeypatch.setattr(
        faces_before, "lies_low", lambda lamp, casters, face, points, planes, box, *_: box < 0
    )
    before, every = shadows(surfaces, LAMPS[lamp])
    assert tiles.count.sum() < 0.9 * before.count.sum()
    np.testing.assert_allclose(picture, every, rtol=0.0, atol=2.5 / 512 * float(every.max()))
