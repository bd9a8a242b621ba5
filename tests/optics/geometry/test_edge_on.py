"""Faces seen edge-on from a pixel, whose plane passes through it: what they may hide of a lamp."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.gpu import Device
from gpusim.optics.edge_pixels.fragment_lists import find_edge_pixels
from gpusim.optics.geometry.view import look
from gpusim.optics.light.lights import Light
from gpusim.optics.light.quadrature import lamps_of
from gpusim.optics.shadow.receivers import Receivers
from tests.support.optics_rays import brute_share, triangles_of
from tests.support.shadow_rays import found

Array = npt.NDArray[np.float64]

CAMERA = gs.Camera.from_lens((36.0, 24.0), 34.0, (240, 160), (0.3, -1.2, 0.2), (0.0, 0.0, 0.0))
LIGHTS: dict[str, Light] = {
    "sun": gs.SunLight((0.9, 2.0, -0.6), 1.0, diameter=0.01),
    "point": gs.PointLight((-0.9, -2.0, 0.6), 50.0),
    "area": gs.AreaLight((-0.9, -2.0, 0.6), (0.0, 0.0, 0.0), (0.2, 0.2), 50.0),
}


def eggs() -> gs.Surface:
    """An open sheet of steep bumps, coarse: next to most edges of a face another one is steeper
    than 60 degrees to it."""
    x, z = np.linspace(-0.3, 0.3, 21), np.linspace(-0.2, 0.2, 11)
    X, Z = np.meshgrid(x, z, indexing="ij")
    points = np.stack([X, 0.03 * np.sin(60.0 * X) * np.sin(60.0 * Z), Z], axis=-1).reshape(-1, 3)
    number = np.arange(X.size).reshape(X.shape)
    quads = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], -1)
    return gs.Surface(points, quads.reshape(-1, 4), gs.paint.Plain(0.8))


def share(device: Device, light: Light, corners: Array, both_sides: bool) -> float:
    """What a floor's pixel at the origin, 2 mm wide, sees of a lamp beside a face of an open
    surface, or of a thin body; seen from 0.5 m above."""
    surface = gs.Surface(corners, np.array([[0, 1, 2, 3]]))
    if not both_sides:
        normal = np.cross(corners[2] - corners[0], corners[3] - corners[1])
        back = corners - 1e-4 * normal / np.linalg.norm(normal)
        faces = [[0, 1, 2, 3], [7, 6, 5, 4], *([k, k + 4, (k + 1) % 4 + 4, (k + 1) % 4]
                                               for k in range(4))]  # fmt: skip
        surface = gs.Surface(np.concatenate([corners, back]), np.array(faces))
        assert surface.topology.closed
    own = Receivers(
        np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]]), np.array([[2e-3, 0.0, 0.0]]),
        np.array([[0.0, 2e-3, 0.0]]), np.array([-1]),
    )  # fmt: skip
    return float(found(device, [surface], [light], own, (0.0, 0.0, 0.5))[0, 0])


@pytest.mark.parametrize("both_sides", [False, True], ids=["closed", "open"])
def test_a_face_edge_on_hides_nothing_on_its_other_side(device: Device, both_sides: bool) -> None:
    """Its plane, x = -0.3 mm, passes through the pixel; it is 80 mm away, and the lamp that way, or
    the other way."""
    wall = np.array([[0.0, 0.08, -0.05], [0.0, 0.1, -0.05], [0.0, 0.1, 0.05], [0.0, 0.08, 0.05]])
    corners = wall - [3e-4, 0.0, 0.0]
    beyond, opposite = (
        gs.AreaLight((0.0, side, 0.3), (0.0, 0.0, 0.0), (0.2, 0.2), 1.0) for side in (1.0, -1.0)
    )
    assert share(device, opposite, corners, both_sides) == 1.0
    # seen from the side, it hides a sliver of the other one
    assert 0.9 < share(device, beyond, corners, both_sides) < 1.0


def test_a_face_below_the_receiver_hides_nothing_above_it(device: Device) -> None:
    """Beyond a ridge the next face falls away, at 70 degrees to the pixel's."""
    fall = [np.cos(np.deg2rad(70.0)), 0.0, -np.sin(np.deg2rad(70.0))]
    ridge = np.array([[2e-4, -0.1, 0.0], [2e-4, 0.1, 0.0]])
    corners = np.concatenate([ridge, ridge[::-1] + 0.1 * np.array(fall)])
    lamp = gs.PointLight((1.0, 0.1, 0.2), 1.0)
    assert share(device, lamp, corners, True) == 1.0
    # what rises from there hides the lamp from all of the pixel that is before it
    rising = np.concatenate([ridge, ridge[::-1] - 0.3 * np.array(fall)])
    assert share(device, lamp, rising, True) < 0.9


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (name == "sun")) for name in LIGHTS]
)
def test_bumps_are_lit_as_rays_say(device: Device, name: str) -> None:
    surface, light = eggs(), LIGHTS[name]
    lit = gs.render([surface], CAMERA, [replace(light, shadows=False)], device=device)
    seen = gs.render([surface], CAMERA, [light], device=device).radiance / np.where(
        lit.radiance > 0.0, lit.radiance, 1.0
    )
    truth = lit.truth()
    place, face = truth.image("reference"), truth.image("face")
    # pixels inside of faces, each as its neighbours
    inner = np.zeros(face.shape, bool)
    inner.reshape(-1)[find_edge_pixels(look([surface], CAMERA, lit=True)).pixel] = True
    inner = ~inner & np.isfinite(face) & (lit.radiance > 0.2 * lit.radiance.max())
    row, column = np.nonzero(inner)
    (lamp,) = lamps_of([light])
    at = place[row, column]
    way = lamp.centre - (0.0 if lamp.far else 1.0) * at
    share = brute_share(lamp, at + 1e-6 * way, triangles_of([surface]), 4)
    # lit fully by rays, and around: shadows of edges are wider than a pixel there
    full = np.zeros(face.shape, bool)
    full[row, column] = share == 1.0
    for axis in (0, 1):
        for step in (-1, 1):
            full &= np.roll(full, step, axis=axis) | ~inner
    assert np.count_nonzero(full) > 1500
    wrong = full & (seen < 0.98)
    print(f"{name}: {np.count_nonzero(wrong)} of {np.count_nonzero(full)} lit pixels darker")
    assert not wrong.any()
