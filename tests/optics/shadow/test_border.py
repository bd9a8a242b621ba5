"""Shadows in pictures whose sides are whole numbers of shadow tiles."""

from __future__ import annotations

import numpy as np
import pytest

import gpusim as gs


@pytest.mark.parametrize(
    ("backend", "size"),
    [("gpu", (256, 128)), ("gpu", (255, 129)), ("numpy", (64, 32)), ("numpy", (63, 33))],
)
def test_a_wall_beyond_the_border_is_lit(
    backend: str, size: tuple[int, int], request: pytest.FixtureRequest
) -> None:
    """Seen from the front, a wall that fills the picture: every pixel is lit."""
    device = request.getfixturevalue("device") if backend == "gpu" else None
    corners = np.array([[-5.0, 0, -5], [5, 0, -5], [5, 0, 5], [-5, 0, 5]])
    near = np.array([[-0.1, -0.5, -0.1], [0.1, -0.5, -0.1], [0.1, -0.5, 0.1], [-0.1, -0.5, 0.1]])
    face = np.array([[0, 1, 2, 3]], np.int32)
    camera = gs.Camera.from_lens((36, 18), 40, size, (0, -4, 0), (0, 0, 0))
    lamp = gs.AreaLight((1.0, -3.0, 2.0), (0.0, 0.0, 0.0), (0.1, 0.1), 10.0)
    surfaces = [gs.Surface(corners, face), gs.Surface(near, face)]
    picture = gs.render(surfaces, camera, [lamp], backend=backend, device=device).radiance
    assert picture.shape == size[::-1] and (picture[:, [0, -1]] > 0).all()
    assert (picture[[0, -1]] > 0).all()
