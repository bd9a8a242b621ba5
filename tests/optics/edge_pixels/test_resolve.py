"""Pixels under tens of triangles, most of which hide parts of others."""

from __future__ import annotations

import numpy as np
import pytest

import gpusim as gs
from gpusim.gpu import Device
from gpusim.optics.edge_pixels.fragment_lists import find_edge_pixels
from gpusim.optics.edge_pixels.resolve import MAX_DEPTH, MAX_ERROR
from gpusim.optics.geometry.view import look

CAMERA = gs.Camera(57, 33, np.array([[60.0, 0.0, 28.0], [0.0, 60.0, 16.0], [0.0, 0.0, 1.0]]))

SMALL = np.array([[-0.05, -0.04], [0.05, -0.04], [0.0, 0.05]])
LARGE = np.array([[-0.9, -0.8], [1.7, -0.7], [-0.6, 1.6]])


def heaps(count: int, seed: int) -> list[gs.Surface]:
    """Heaps of ``count`` small triangles, each over about a pixel, one behind the other, and a wall
    behind half of them; thin ones first, which hide the middle of those behind them."""
    rng, points, regions = np.random.default_rng(seed), [], []
    for column in range(8, 50, 6):
        for row in range(6, 28, 6):
            for k in range(count):
                size = rng.uniform(0.2, 1.3, (3, 1)) * ([1.0, 0.15] if k % 3 else [0.15, 1.0])
                turn = rng.uniform(0.0, 2.0 * np.pi) + 2.1 * np.arange(3)
                way = size * np.stack([np.cos(turn), np.sin(turn)], axis=1)
                at = np.array([column, row]) + rng.uniform(-0.4, 0.4, 2) + way
                depth = 4.0 + 0.02 * k
                points.append(
                    np.column_stack([(at - [28.0, 16.0]) / 60.0 * depth, np.full(3, depth)])
                )
                regions.append(rng.integers(0, 6))
    names = [f"paint {k}" for k in range(6)]
    paints = {name: gs.paint.Plain(0.1 + 0.15 * k) for k, name in enumerate(names)}
    faces = np.arange(3 * len(points)).reshape(-1, 3)
    heap = gs.Surface(np.concatenate(points), faces, paints, region=np.array(regions, np.int32))
    wall = np.array([[-0.2, -9.0, 9.0], [9.0, -9.0, 9.0], [9.0, 9.0, 9.0], [-0.2, 9.0, 9.0]])
    return [heap, gs.Surface(wall, np.array([[0, 1, 2, 3]]), gs.paint.Plain(0.5))]


@pytest.mark.parametrize("count", [24, 40, 60])
@pytest.mark.parametrize("lit", [False, True], ids=["unlit", "lit"])
def test_heaps_are_those_of_the_twin(count: int, lit: bool, device: Device) -> None:
    surfaces = heaps(count, 7 + count)
    depth = find_edge_pixels(look(surfaces, CAMERA, lit)).depth
    assert np.count_nonzero((depth > 0.5 * count) & (depth <= MAX_DEPTH)) > 20
    lights = [gs.PointLight((0.5, -1.0, -2.0), 300.0, shadows=False)] if lit else None
    got = gs.render(surfaces, CAMERA, lights, device=device).radiance
    want = gs.render(surfaces, CAMERA, lights, backend="numpy").radiance
    assert np.abs(got - want).max() <= MAX_ERROR * float(want.max())


def test_what_is_behind_many_small_ones_is_looked_at(device: Device) -> None:
    """Holes in a triangle, the only one of which more is hidden than the device can tell."""
    points, depths = [], []
    for column in range(8, 50, 6):
        for row in range(6, 28, 6):
            for k in range(42):
                at = np.array([column + (k % 7 - 3) / 8.0, row + (k // 7 - 2.5) / 7.0])
                points.append(at + SMALL)
                depths.append(4.0 + 0.001 * k)
            points.append(np.array([column, row]) + LARGE)
            depths.append(5.0)
    z = np.array(depths)[:, None, None]
    flat = (np.array(points) - [28.0, 16.0]) / 60.0
    corners = np.concatenate([flat * z, np.broadcast_to(z, (len(z), 3, 1))], axis=2)
    region = (np.array(depths) > 4.5).astype(np.int32)
    paints = {"small": gs.paint.Plain(0.1), "behind": gs.paint.Plain(0.9)}
    faces = np.arange(3 * len(points)).reshape(-1, 3)
    surface = gs.Surface(corners.reshape(-1, 3), faces, paints, region=region)
    depth = find_edge_pixels(look([surface], CAMERA, False)).depth
    assert np.count_nonzero((depth > 40) & (depth <= MAX_DEPTH)) > 20
    got = gs.render([surface], CAMERA, device=device).radiance
    want = gs.render([surface], CAMERA, backend="numpy").radiance
    assert np.abs(got - want).max() <= MAX_ERROR * float(want.max())
