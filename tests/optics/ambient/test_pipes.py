"""Sheets that close round something: seen from inside and from outside, and standing on a floor."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

import gpusim as gs
from gpusim.gpu import Device
from gpusim.optics.light.lights import Light

FLOOR = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
WHITE = gs.paint.Plain(1.0)
EVEN: list[Light] = [gs.AmbientLight(1.0 / np.pi, occlusion=True)]


@pytest.mark.parametrize("outward", [True, False])
def test_a_pipe_on_a_floor(outward: bool, device: Device) -> None:
    """Its inside in closed form, whichever way faces look; the floor as beside a closed body."""
    radius, height, count = 0.33, 1.0, 48
    angle = np.arange(count) * 2.0 * np.pi / count
    ring = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    points = np.concatenate([np.c_[ring, np.full(count, z)] for z in (0.0, height)])
    i = np.arange(count)
    j = (i + 1) % count
    sides = np.stack([i, j, count + j, count + i], axis=1)
    pipe = gs.Surface(points, sides if outward else sides[:, ::-1], paint=WHITE)
    caps = [
        [j, i, 0 * i + 2 * count, 0 * i - 1],
        [count + i, count + j, 0 * i + 2 * count + 1, 0 * i - 1],
    ]
    middles = np.concatenate([points, [[0.0, 0.0, 0.0], [0.0, 0.0, height]]])
    faces = np.concatenate([sides, *(np.stack(cap, axis=1) for cap in caps)])
    closed = gs.Surface(middles, faces, paint=WHITE)
    floor = gs.Surface(20.0 * FLOOR, [[0, 1, 2, 3]], paint=WHITE)
    eye = gs.Camera.from_lens((36.0, 27.0), 40.0, (200, 150), (0.25, -3.6, 2.6), (0.1, 0.0, 0.15))
    frames = [gs.render([floor, body], eye, EVEN, device=device) for body in (pipe, closed)]
    truth = frames[0].truth()
    at, normal = truth.image("reference"), truth.image("normal")
    where = np.where(at[..., 2] < 1e-9, 0, np.where((normal * at)[..., :2].sum(axis=2) > 0.0, 1, 2))
    whole = cv2.erode(where + 1.0, np.ones((3, 3))) == cv2.dilate(where + 1.0, np.ones((3, 3)))
    first, second = (np.pi * frame.radiance for frame in frames)
    # an element beside the rim of a disk, at a right angle to it (Howell's catalog, B-31)
    deep = 0.5 * (height - at[..., 2]) / radius
    share = (deep**2 + 0.5) / np.sqrt(deep**2 + 1.0) - deep
    inside = whole & (where == 2)
    assert inside.sum() > 150
    np.testing.assert_allclose(first[inside], share[inside], atol=0.01)
    outside = whole & (where < 2)
    off = np.abs(first - second)[outside]
    assert outside.sum() > 10000 and off.max() < 0.05 and np.quantile(off, 0.99) < 0.01
