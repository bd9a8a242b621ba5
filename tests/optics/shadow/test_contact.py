"""Shadows where a body stands on another: no light gets out from below."""

from __future__ import annotations

import numpy as np
import pytest

import gpusim as gs

QUAD = np.array([[0, 1, 2, 3]])


def box(centre: tuple[float, float, float], size: tuple[float, float, float]) -> gs.Surface:
    """A closed box, turned by 25 degrees about z."""
    unit = np.array([[x, y, z] for z in (-0.5, 0.5) for y in (-0.5, 0.5) for x in (-0.5, 0.5)])
    c, s = np.cos(np.deg2rad(25.0)), np.sin(np.deg2rad(25.0))
    points = unit * size @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) + centre
    faces = np.array([[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2],
                      [1, 3, 7, 5]])  # fmt: skip
    return gs.Surface(points, faces, gs.paint.Plain(0.3))


@pytest.mark.parametrize("backend", ["numpy", "gpu"])
def test_a_lamp_in_a_box_on_a_floor_lights_nothing(
    backend: str, request: pytest.FixtureRequest
) -> None:
    """The truth is darkness. What a pixel's samples find under the box is hidden by its bottom."""
    device = request.getfixturevalue("device") if backend == "gpu" else None
    corners = np.array([[-0.19, -0.175, 0], [0.21, -0.175, 0], [0.21, 0.185, 0], [-0.19, 0.185, 0]])
    floor = gs.Surface(corners, QUAD, gs.paint.Plain(0.6))
    body = box((0.02, -0.01, 0.03), (0.04, 0.03, 0.06))
    # NumPy looks at the box and what is around it, with the same pixels
    sensor, pixels = ((9.64, 7.24), (241, 181)) if backend == "gpu" else ((4.04, 4.04), (101, 101))
    camera = gs.Camera.from_lens(sensor, 12.0, pixels, (-0.06, -0.33, 0.3), (0.01, 0.0, 0.01))
    lamp = gs.PointLight((0.02, -0.01, 0.03), 30.0)
    frame = gs.render([floor, body], camera, [lamp], backend=backend, device=device)
    below = 30.0 / (4.0 * np.pi) / 0.03**2 * 0.6 / np.pi  # the floor's radiance in the box
    lit = frame.radiance > 0.0
    # at two corners of the box, pieces of the floor are sampled beyond them
    assert lit.sum() <= 2
    assert frame.radiance.max() <= 0.01 * below
    # without the box the same lamp lights the floor
    alone = gs.render([floor], camera, [lamp], backend=backend, device=device)
    assert alone.radiance.max() >= 0.9 * below


def standing(times: int, part: int) -> tuple[list[gs.Surface], gs.Camera]:
    """A thin sheet upright on a floor, in a picture that is ``times`` as fine, of one ``part`` of
    the field each way."""
    floor = gs.Surface(2.0 * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]]), QUAD)
    foot = np.array([[-0.48, -0.15, 0.0], [0.48, 0.15, 0.0]])
    sheet = gs.Surface(np.concatenate([foot, foot[::-1] + np.array([0.0, 0.0, 0.5])]), QUAD)
    size = 200 // part * times, 150 // part * times
    camera = gs.Camera.from_lens(
        (36.0, 27.0), 40.0 * part, size, eye=(0.7, -1.6, 1.3), target=(0, 0, 0.1)
    )
    return [floor, sheet], camera


@pytest.mark.parametrize("backend", ["numpy", "gpu"])
def test_shadows_are_filtered_where_the_plane_of_a_standing_sheet_meets_the_floor(
    backend: str, request: pytest.FixtureRequest
) -> None:
    device = request.getfixturevalue("device") if backend == "gpu" else None
    lamp = gs.AreaLight((1.8, 0.9, 1.2), (0.0, 0.0, 0.0), size=(0.01, 0.01), power=50.0)
    part, times = (1, 4) if backend == "gpu" else (2, 4)
    one, fine = (
        gs.render(*standing(finer, part), [lamp], backend=backend, device=device).radiance
        for finer in (1, times)
    )
    mean = fine.reshape(150 // part, times, 200 // part, times).mean(axis=(1, 3))
    # 16 rows a pixel, where a shadow's edge runs along them
    assert np.abs(one - mean).max() < 0.04 * mean.max()
