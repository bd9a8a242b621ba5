"""What is seen of a wall behind fine outlines: the pixel less what is before it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.gpu import Device
from gpusim.optics.edge_pixels import resolve
from gpusim.optics.edge_pixels.fragment_lists import find_edge_pixels
from gpusim.optics.edge_pixels.fragment_shading import backdrops, fills, left_open
from gpusim.optics.geometry.polygon_clipping import (
    clip_square,
    half_planes,
    moments,
    second_moments,
)
from gpusim.optics.geometry.view import FIXED, look
from gpusim.optics.light.lights import Light
from gpusim.optics.shading.setup import Setup
from gpusim.optics.shadow.sample_mask import SAMPLES

Array = npt.NDArray[np.float64]

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


def setup_of(surfaces: list[gs.Surface], lights: list[Light] | None) -> Setup:
    return Setup.build(look(surfaces, CAMERA, lit=bool(lights)), lights, 0.0, surfaces)


def told(setup: Setup) -> tuple[int, int]:
    """How many triangles over edge pixels are backdrops, of how many such pixels."""
    found = find_edge_pixels(setup.view)
    pixel = found.pixel[np.repeat(np.arange(len(found.pixel)), found.depth)]
    at = np.stack([pixel % CAMERA.width, pixel // CAMERA.width], axis=1)
    triangle = found.triangle[: len(pixel)]
    corners = np.rint(setup.view.screen[triangle] * FIXED) / FIXED - at[:, None]
    full = fills(half_planes(corners))
    area = moments(clip_square(half_planes(corners))[0])[0]
    np.testing.assert_array_equal(full, area >= 1.0 - 1e-9)
    return int(backdrops(setup, found, full, corners).sum()), len(found.pixel)


def test_what_is_left_has_the_moments_of_the_rest() -> None:
    """Of two pixels, cut by lines: the other sides of these."""
    random = np.random.default_rng(6)
    normal = random.normal(size=(2, 1, 3)) * [1.0, 1.0, 0.2]
    (kept, _), (rest, _) = clip_square(normal), clip_square(-normal)
    size, middle = moments(kept)
    area, centre, second = left_open(np.array([0, 1]), 2, size, middle, second_moments(kept))
    want, place = moments(rest)
    np.testing.assert_allclose(area, want, atol=1e-12)
    np.testing.assert_allclose(centre, place, atol=1e-9)
    np.testing.assert_allclose(second, second_moments(rest), atol=1e-12)
    # pieces of other pixels don't count
    area, _, _ = left_open(np.array([-1, 1]), 2, size, middle, second_moments(kept))
    assert area[0] == 1.0 and area[1] == pytest.approx(want[1])


@pytest.mark.parametrize("lights", [None, [LAMP]], ids=["unlit", "lit"])
def test_pictures_are_those_of_pieces(
    device: Device, monkeypatch: pytest.MonkeyPatch, lights: list[Light] | None
) -> None:
    surfaces = [disc(), wall()]
    count, pixels = told(setup_of(surfaces, lights))
    assert count > 0.7 * pixels > 70
    pictures = []
    for kept in (True, False):
        if not kept:
            monkeypatch.setattr(
                resolve, "backdrops", lambda setup, found, area, corners: area < 0.0
            )
        pictures.append([
            np.asarray(gs.render(surfaces, CAMERA, lights, backend="numpy").radiance, float),
            np.asarray(gs.render(surfaces, CAMERA, lights, device=device).radiance, float),
        ])  # fmt: skip
    for by_rest, by_pieces in zip(*pictures, strict=True):
        away = np.abs(by_rest - by_pieces) / by_pieces.max()
        # in half shadow one rectangle stands for several, and the lattice of samples lies elsewhere
        # on the lamp: by itself it tells shares to 0.008
        assert away.max() < (6 / SAMPLES if lights else 1e-6)
        assert np.sqrt(np.mean(away**2)) < (1e-4 if lights else 1e-7)


def test_what_stands_on_the_wall_is_followed_piece_by_piece() -> None:
    far, near = ([disc(y=y), wall()] for y in (0.0, 0.299))
    assert told(setup_of(far, [LAMP]))[0] > 0
    assert told(setup_of(near, [LAMP]))[0] == 0
    # no shadow can end there without a lamp
    assert told(setup_of(near, None))[0] > 0


def test_patterns_are_followed_piece_by_piece() -> None:
    assert told(setup_of([disc(), wall(paint=gs.paint.Checker(0.003))], None))[0] == 0
