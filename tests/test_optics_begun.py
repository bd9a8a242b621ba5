"""Views whose triangles the device begins with before the rest is known."""

from __future__ import annotations

import sys

import numpy as np
import pytest

import gpusim as gs
from gpusim.gpu import Device
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.geometry.view import View, look
from gpusim.optics.raster.compute_raster import Sight, sheet

K = np.array([[222.0, 0.3, 58.7], [0.0, 220.0, 40.2], [0.0, 0.0, 1.0]])
CAMERA = Camera(118, 79, K)


def fine(smooth_angle: float) -> gs.Surface:
    """A crumpled sheet of 2816 triangles."""
    x, y = np.meshgrid(np.linspace(-0.9, 0.9, 45), np.linspace(-0.6, 0.6, 33))
    rest = np.stack([x, y, np.full_like(x, 4.0)], axis=-1).reshape(-1, 3)
    points = rest + np.random.default_rng(5).normal(size=rest.shape) * [0.003, 0.003, 0.01]
    n = np.arange(45 * 33).reshape(33, 45)
    faces = np.stack([n[:-1, :-1], n[1:, :-1], n[1:, 1:], n[:-1, 1:]], axis=-1).reshape(-1, 4)
    paint = gs.paint.Checker(0.31)
    return gs.Surface(points, faces, paint, reference=rest, smooth_angle=smooth_angle)


def views(surfaces: list[gs.Surface], camera: Camera) -> tuple[list[View], View]:
    begun: list[View] = []
    view = look(surfaces, camera, lit=True, begin=begun.append)
    return begun, view


def test_a_whole_surface_is_begun_with_where_it_is() -> None:
    (begun,), view = views([fine(3.0)], CAMERA)
    assert np.array_equal(begun.corner, view.corner)
    assert np.array_equal(begun.fixed(), view.fixed())
    assert np.array_equal(begun.raster_depth()[1], view.raster_depth()[1])
    assert begun.extent == view.extent


def test_what_may_be_cut_or_joined_isnt_begun_with() -> None:
    near = sheet(0.95, 1.3, 0.0, depth=0.5)
    near.points[:9, 2] = -0.1
    bent = Camera(118, 79, K, distortion=[-0.1, 0.03, 0.0, 0.0])
    for surfaces, camera in (([fine(3.0)] * 2, CAMERA), ([fine(3.0)], bent), ([near], CAMERA)):
        assert views(surfaces, camera)[0] == []


@pytest.mark.parametrize("smooth_angle", [3.0, 0.02])
def test_the_picture_is_the_same(
    device: Device, monkeypatch: pytest.MonkeyPatch, smooth_angle: float
) -> None:
    surface, lights = fine(smooth_angle), [gs.PointLight((3.0, -2.0, -9.0), 400.0, shadows=False)]
    made: list[Sight] = []
    init = Sight.__init__

    def counted(self: Sight, *args: object) -> None:
        made.append(self)
        init(self, *args)  # type: ignore[arg-type]

    monkeypatch.setattr(Sight, "__init__", counted)
    # a layer isn't begun with
    monkeypatch.setattr(sys.modules["gpusim.optics.geometry.view"], "FEWEST", 1_000_000)
    got = gs.render([surface], CAMERA, lights, device=device).radiance
    # normals of their own at creases make other vertices than it began with, the same triangles
    assert len(made) == 1
    assert (len(made[0].view.place) > len(surface.points)) == (smooth_angle < 1.0)
    rendering = sys.modules["gpusim.optics.rendering.renderer"]
    monkeypatch.setattr(rendering, "look", lambda s, c, lit, begin=None: look(s, c, lit))
    want = gs.render([surface], CAMERA, lights, device=device).radiance
    assert np.array_equal(got, want)
    assert np.ptp(got) > 0.1 * got.max() > 0.0
