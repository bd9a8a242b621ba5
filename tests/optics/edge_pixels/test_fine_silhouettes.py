"""Pixels on the outlines of finely cut bodies: many triangles, of which some hide others."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.gpu import Device
from gpusim.optics.edge_pixels.visible_polygons import visible_polygons
from gpusim.optics.geometry.polygon_clipping import clip_square, half_planes, moments
from gpusim.optics.light.lights import Light
from gpusim.optics.shadow.sample_mask import SAMPLES

Array = npt.NDArray[np.float64]


def ball(cells: int, radius: float, centre: tuple[float, float, float]) -> gs.Surface:
    """A cube of ``cells`` squares along each edge, blown up to a ball."""
    grid = np.linspace(-1.0, 1.0, cells + 1)
    number = np.arange((cells + 1) ** 2).reshape(cells + 1, cells + 1)
    square = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], -1)
    places, faces = [], []
    for axis in range(3):
        for side in (1, -1):
            own = np.empty((cells + 1, cells + 1, 3))
            own[..., axis] = side
            own[..., (axis + 1) % 3], own[..., (axis + 2) % 3] = np.meshgrid(
                grid, grid, indexing="ij"
            )
            faces.append(square.reshape(-1, 4)[:, ::side] + sum(len(v) for v in places))
            places.append(own.reshape(-1, 3))
    points, which = np.unique(np.concatenate(places).round(9), axis=0, return_inverse=True)
    points /= np.linalg.norm(points, axis=1)[:, None]
    every = which.reshape(-1)[np.concatenate(faces)]
    return gs.Surface(radius * points + np.array(centre), every, gs.paint.Plain(0.6))


def wall(y: float) -> gs.Surface:
    corners = [[-1.5, y, -1.0], [1.5, y, -1.0], [1.5, y, 1.0], [-1.5, y, 1.0]]
    return gs.Surface(np.array(corners), np.array([[0, 1, 2, 3]]), gs.paint.Plain(0.8))


def test_fans_leave_what_they_do_not_cover() -> None:
    """Triangles round common corners, in any order, before one that fills the pixel."""
    rng = np.random.default_rng(3)
    for _ in range(200):
        hub = rng.uniform(-0.4, 0.4, 2)
        turn = np.sort(rng.uniform(0.0, 5.0, 9))
        rim = hub + rng.uniform(0.1, 3.0, (9, 1)) * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        rim = np.rint(rim * 65536.0) / 65536.0
        fan = np.stack([np.broadcast_to(hub, (8, 2)), rim[:-1], rim[1:]], axis=1)
        fan = fan[rng.permutation(8)]
        whole = np.array([[[-40.0, -30.0], [50.0, -30.0], [0.0, 60.0]]])
        corners = np.concatenate([fan, whole])
        planes = half_planes(corners)
        polygon, count = clip_square(planes)
        row, piece = visible_polygons(polygon, count, planes, corners, np.zeros(9, np.int64))
        area = np.bincount(row, moments(piece)[0], 9)
        assert area.sum() == pytest.approx(1.0, abs=2e-6)


@pytest.mark.slow
def test_the_device_follows_where_neighbours_take_far_more_turns(
    device: Device,
) -> None:
    """Software rasterisers stop a loop after 65,536 turns of all that they work on in step."""
    lights: list[Light] = [
        gs.PointLight((-1.0, -1.6, 1.1), 50.0),
        gs.AreaLight((0.9, -1.9, 0.3), (0.0, 0.0, 0.0), (0.5, 0.3), 50.0),
    ]
    surfaces = [ball(44, 0.22, (0.05, 0.0, 0.0)), ball(30, 0.1, (-0.25, -0.3, 0.1)), wall(0.35)]
    camera = gs.Camera.from_lens((36.0, 24.0), 28.0, (300, 200), (0.3, -1.6, 0.4), (0.0, 0.0, 0.0))
    got = np.array(gs.render(surfaces, camera, lights, device=device).radiance, np.float64)
    want = np.array(gs.render(surfaces, camera, lights, backend="numpy").radiance, np.float64)
    # two samples of the lamp
    assert np.abs(got - want).max() < 2.5 / SAMPLES * want.max()
