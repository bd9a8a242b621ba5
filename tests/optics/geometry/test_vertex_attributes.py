"""Normals are the surface's own: kept from camera to camera, found anew where vertices moved."""

from __future__ import annotations

import numpy as np

import gpusim as gs
from gpusim.optics.geometry.triangle_corners import NORMAL
from gpusim.optics.geometry.vertex_attributes import surface_normals
from gpusim.optics.geometry.view import look


def sheet(height: float) -> gs.Surface:
    x, y = np.meshgrid(np.linspace(-1.0, 1.0, 9), np.linspace(-1.0, 1.0, 7))
    points = np.stack([x, y, height * np.sin(2.0 * x) * y], axis=-1).reshape(-1, 3)
    node = np.arange(len(points)).reshape(x.shape)
    faces = np.stack([node[:-1, :-1], node[:-1, 1:], node[1:, 1:], node[1:, :-1]], axis=-1)
    return gs.Surface(points, faces.reshape(-1, 4).astype(np.int32))


def camera(x: float) -> gs.Camera:
    return gs.Camera.from_lens((36.0, 24.0), 30.0, (90, 60), (x, -0.3, 4.0), (0.0, 0.0, 0.0))


def test_shapes_are_kept_until_something_moves() -> None:
    one, other = sheet(0.2), sheet(0.3)
    first = surface_normals([one, other])
    assert [a is b for a, b in zip(surface_normals([one, other]), first, strict=True)] == [
        True,
        True,
    ]
    same = one.moved(one.points.copy())
    assert surface_normals([same, other])[0] is first[0]
    moved = one.moved(one.points + 1e-9)
    assert surface_normals([moved, other])[0] is not first[0]
    # in place, behind the surface's back
    kept = surface_normals([one])[0]
    one.points[3, 2] += 1e-9
    assert surface_normals([one])[0] is not kept
    # another surface of the same shape may have other triangles
    assert surface_normals([sheet(0.3)])[0] is not surface_normals([other])[0]


def test_two_cameras_see_the_same_normals() -> None:
    surface = sheet(0.2)
    views = [look([surface], camera(x), lit=True) for x in (-1.0, 1.0)]
    anew = look([sheet(0.2)], camera(1.0), lit=True)
    for view in views:
        np.testing.assert_array_equal(view.vertices[:, NORMAL], anew.vertices[:, NORMAL])
        length = np.linalg.norm(view.vertices[:, NORMAL], axis=1)
        np.testing.assert_allclose(length, 1.0, atol=1e-12)
        # they look at the cameras, which are above
        assert (view.vertices[:, NORMAL.start + 2] > 0.8).all()


def test_an_image_after_another_is_that_of_a_fresh_surface(device: gs.Device) -> None:
    lights = [gs.PointLight((2.0, -1.0, 3.0), 60.0)]
    surface = sheet(0.2)
    gs.render([surface], camera(0.3), lights, device=device).release()
    lower = surface.moved(surface.points * [1.0, 1.0, 0.5])
    got = gs.render([lower], camera(0.3), lights, device=device).radiance
    want = gs.render([sheet(0.1)], camera(0.3), lights, device=device).radiance
    np.testing.assert_array_equal(got, want)
