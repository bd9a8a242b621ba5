"""Things that stand on others: the pixels along the line where they touch."""

from __future__ import annotations

import numpy as np
import pytest

import gpusim as gs
from gpusim.gpu import Device
from gpusim.optics.geometry.polygon_clipping import (
    clip,
    clip_square,
    moments,
    rectangles,
    second_moments,
)
from gpusim.twin_checks.scenes import block

FLOOR, WALL = 0.2, 0.9


@pytest.mark.parametrize("backend", ["gpu", "numpy"])
def test_a_wall_on_a_floor(backend: str, request: pytest.FixtureRequest) -> None:
    """Both go on behind the line of contact: a pixel is the area on either side of its image."""
    device = request.getfixturevalue("device") if backend == "gpu" else None
    camera = gs.Camera.from_lens((8.0, 6.0), 8.0, (40, 30), eye=(0.1, -3.0, 1.7), target=(0, 0, 0))
    # in four pieces, so that the floor's triangles end somewhere along the line
    floor = np.array([[x, y, 0.0] for y in (-9, 0.3, 9) for x in (-9, 0.2, 9)])
    tiles = [[0, 1, 4, 3], [1, 2, 5, 4], [3, 4, 7, 6], [4, 5, 8, 7]]
    along = np.array([np.cos(0.3), np.sin(0.3), 0.0])
    foot = np.array([-6.0 * along, 6.0 * along])
    wall = np.concatenate([foot, np.add(foot[::-1], [0.0, 0.0, 9.0])])
    surfaces = [
        gs.Surface(floor, np.array(tiles, np.int32), gs.paint.Plain(FLOOR)),
        gs.Surface(wall, np.array([[0, 1, 2, 3]], np.int32), gs.paint.Plain(WALL)),
    ]
    image = gs.render(surfaces, camera, device=device, backend=backend).radiance
    (x0, y0), (x1, y1) = camera.project(0.2 * foot)
    y, x = (values.reshape(-1) for values in np.mgrid[:30, :40].astype(float))
    a, b = y1 - y0, x0 - x1  # a (x - x0) + b (y - y0) > 0 above the line
    plane = np.stack(
        [np.full(x.shape, a), np.full(x.shape, b), a * (x - x0) + b * (y - y0)], axis=1
    )
    plane *= np.sign(-b)
    square, count = clip_square(np.zeros((len(x), 0, 3)))
    above = moments(clip(square, count, -plane if plane[0, 2] < 0 else plane)[0])[0]
    mixed = (above > 0.0) & (above < 1.0)
    assert mixed.sum() > 40
    want = FLOOR + (WALL - FLOOR) * above.reshape(image.shape)
    assert np.abs(image - want).max() <= 1e-4


def test_rectangles_have_a_polygons_second_moments() -> None:
    """A rectangle is its own, however it is turned; of a triangle by the closed form."""
    corners = np.array([[-0.3, -0.1], [0.3, -0.1], [0.3, 0.1], [-0.3, 0.1]])
    for angle in (0.0, 0.4, 1.2, 2.0, -0.7):
        c, s = np.cos(angle), np.sin(angle)
        turned = corners @ np.array([[c, s], [-s, c]]) + [0.07, -0.11]
        shape = np.concatenate([turned, np.repeat(turned[-1:], 4, axis=0)])[None]
        area, centroid = moments(shape)
        sides = rectangles(area, centroid, second_moments(shape))[0]
        own = [np.array([c, s]) * 0.6, np.array([-s, c]) * 0.2]
        for side in sides.T:
            apart = [min(np.abs(side - v).max(), np.abs(side + v).max()) for v in own]
            assert min(apart) < 1e-12
        # the first side runs along the rows, the second down the columns
        assert sides[0, 0] > abs(sides[1, 0]) and sides[1, 1] > abs(sides[0, 1])
    square = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
    shape = np.concatenate([square, np.repeat(square[-1:], 4, axis=0)])[None]
    sides = rectangles(*moments(shape), second_moments(shape))[0]
    np.testing.assert_allclose(sides, np.eye(2), atol=1e-12)
    a, b = 0.4, 0.7  # of a right triangle: a^2 / 18, -a b / 36, b^2 / 18
    triangle = np.array([[0.0, 0.0], [a, 0.0], [0.0, b]])
    shape = np.concatenate([triangle, np.repeat(triangle[-1:], 5, axis=0)])[None]
    sides = rectangles(*moments(shape), second_moments(shape))[0]
    want = np.array([[a * a / 18, -a * b / 36], [-a * b / 36, b * b / 18]])
    np.testing.assert_allclose(sides @ sides.T / 12.0, want, atol=1e-12)


@pytest.mark.parametrize("backend", ["gpu", "numpy"])
def test_pieces_at_a_contact_look_at_the_lamp_from_where_they_are(
    device: Device, backend: str
) -> None:
    """A turned box on a floor, against 8 x 8 times the pixels: pieces beside the contact lie in
    the box's shadow, and no sample of theirs under the box."""
    floor = gs.Surface(
        np.array([[-0.2, -0.18, 0], [0.2, -0.18, 0], [0.2, 0.18, 0], [-0.2, 0.18, 0.0]]),
        np.array([[0, 1, 2, 3]]), paint=gs.paint.Plain(0.6),
    )  # fmt: skip
    box = block((0.0, 0.0, 0.03), (0.02, 0.015, 0.03), 0.3)
    c, s = np.cos(0.44), np.sin(0.44)
    turned = box.points @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1.0]]) + [0.01, -0.01, 0.0]
    scene = [floor, gs.Surface(turned, box.faces, paint=gs.paint.Plain(0.3))]
    camera = gs.Camera.from_lens((9.6, 7.2), 30.0, (96, 72), (-0.07, -0.33, 0.3), (0.01, 0.0, 0.01))
    fine = gs.Camera(
        8 * 96, 8 * 72, np.array([[8, 0, 3.5], [0, 8, 3.5], [0, 0, 1.0]]) @ camera.K,
        camera_from_world=camera.camera_from_world,
    )  # fmt: skip
    lamp = gs.PointLight((-0.25, 0.3, 0.35), 30.0)
    want = gs.render(scene, fine, [lamp], device=device).radiance.astype(float)
    want = want.reshape(72, 8, 96, 8).mean(axis=(1, 3))
    got = gs.render(scene, camera, [lamp], device=device, backend=backend).radiance
    off = np.abs(got - want) / want.max()
    print(f"{backend}: RMS {np.sqrt((off**2).mean()):.1e}, worst {off.max():.3f}, "
          f"{(off > 0.02).sum()} pixels off by 2 %")  # fmt: skip
    assert np.sqrt((off**2).mean()) < 1.2e-3 and off.max() < 0.04 and (off > 0.02).sum() <= 3
