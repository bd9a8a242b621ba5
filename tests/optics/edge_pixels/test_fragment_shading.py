"""What is seen of a wall behind fine outlines."""

from __future__ import annotations

import numpy as np
import pytest

import gpusim as gs
from gpusim.gpu import Device
from gpusim.optics.light.lights import Light
from gpusim.optics.shadow.sample_mask import SAMPLES

CAMERA = gs.Camera.from_lens((36.0, 24.0), 40.0, (117, 79), (0.05, -1.0, 0.02), (0.0, 0.0, 0.0))
LAMP = gs.AreaLight((-0.4, -1.2, 0.5), (0.0, 0.2, 0.0), (0.2, 0.1), 50.0)


def disc(corners: int = 700, y: float = 0.0) -> gs.Surface:
    """A fine-edged disc: several triangles end in every pixel of its outline."""
    turn = np.arange(corners) * (2.0 * np.pi / corners)
    rings = [np.stack([r * np.cos(turn), np.full(corners, y), r * np.sin(turn)], axis=1)
             for r in (0.2, 0.17)]  # fmt: skip
    first = np.arange(corners)
    after = np.roll(first, -1)
    quads = np.stack([first, after, after + corners, first + corners], axis=1)
    middle = np.column_stack([np.full(corners, 2 * corners), first + corners, after + corners])
    points = np.concatenate([*rings, [[0.0, y, 0.0]]])
    faces = np.concatenate([quads, np.column_stack([middle, np.full(corners, -1)])])
    return gs.Surface(points, faces, gs.paint.Plain(0.2))


def wall(y: float = 0.3, paint: gs.paint.Paint | None = None) -> gs.Surface:
    corners = [[-1.0, y, -0.8], [1.0, y, -0.8], [1.0, y, 0.8], [-1.0, y, 0.8]]
    return gs.Surface(np.array(corners), np.array([[0, 1, 2, 3]]), paint or gs.paint.Plain(0.7))


@pytest.mark.parametrize("lights", [None, [LAMP]], ids=["unlit", "lit"])
def test_the_device_shows_as_much_of_a_wall_as_pieces_do(
    device: Device, lights: list[Light] | None
) -> None:
    surfaces = [disc(), wall()]
    got, want = (
        np.asarray(gs.render(surfaces, CAMERA, lights, **chosen).radiance, float)
        for chosen in ({"device": device}, {"backend": "numpy"})
    )
    away = np.abs(got - want) / want.max()
    # in half shadow one rectangle stands for several, and the lattice of samples lies elsewhere
    # on the lamp: by itself it tells shares to 0.008
    assert away.max() < (6 / SAMPLES if lights else 1e-6)
    assert np.sqrt(np.mean(away**2)) < (1e-4 if lights else 1e-7)
