"""Things that stand on others: the pixels along the line where they touch."""

from __future__ import annotations

import numpy as np
import pytest

import gpusim as gs
from gpusim.optics.polygon import clip, clip_square, moments

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
