"""An open sheet nearly edge-on to a lamp: its plane parts the pixels that its shadow is on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.gpu import Device
from gpusim.optics.edge_pixels.fragment_lists import find_edge_pixels
from gpusim.optics.geometry.view import look
from gpusim.optics.light.quadrature import lamps_of
from tests.support.shadow_rays import sheet

Array = npt.NDArray[np.float64]

CORNERS = np.array(
    [[0.016, 0.518, 1.865], [-0.517, -0.059, 1.519], [-0.851, 0.698, 0.771], [-0.318, 1.275, 1.117]]
)
PLACE = (1.011, 1.910, 2.291)
SIDE, ROWS = 96, slice(8, 40)
CAMERA = gs.Camera.from_lens(
    (36.0, 36.0), 40.0, (SIDE, SIDE), (1.691, -0.622, 4.264), (0.0, 0.0, 0.3), up=(0.0, 0.0, 1.0)
)


def lit_share(lamp: Array, fine: int) -> Array:
    """Share of each pixel of `ROWS` that is outside of the sheet's shadow on z = 0, which is a
    polygon in the picture, by ``fine`` x ``fine`` places a pixel."""
    fall = lamp[2] / (lamp[2] - CORNERS[:, 2])
    seen = CAMERA.to_camera(lamp + fall[:, None] * (CORNERS - lamp))
    x, y = (seen[:, :2] / seen[:, 2:] @ CAMERA.K[:2, :2].T + CAMERA.K[:2, 2]).T
    after_x, after_y = np.roll(x, -1), np.roll(y, -1)
    turn = np.sign(np.sum(x * after_y - y * after_x))
    grid = np.mgrid[ROWS.start * fine : ROWS.stop * fine, : SIDE * fine]
    row, column = (grid + 0.5) / fine - 0.5
    dark = np.ones(row.shape, bool)
    for k in range(4):
        across = (after_x[k] - x[k]) * (row - y[k]) - (after_y[k] - y[k]) * (column - x[k])
        dark &= turn * across >= 0.0
    return np.asarray(1.0 - dark.reshape(-1, fine, SIDE, fine).mean(axis=(1, 3)))


@pytest.mark.parametrize(
    ("size", "worst", "rms"), [(0.0, 0.045, 0.016), (0.03, 0.1, 0.035), (0.2, 0.045, 0.01)]
)
def test_shadow_of_a_sheet_that_a_lamp_sees_edge_on(
    device: Device, size: float, worst: float, rms: float
) -> None:
    surfaces = [
        sheet((-3.0, -3.0), (3.0, 3.0), 0.0),
        gs.Surface(CORNERS, [[0, 1, 2, 3]], gs.paint.Plain(0.5)),
    ]
    light: gs.PointLight | gs.AreaLight = gs.PointLight(PLACE, 100.0)
    places, fine = [np.array(PLACE)], 40
    if size:
        light = gs.AreaLight(PLACE, (-0.3, 0.5, 0.0), (size, size), 100.0)
        (face,) = lamps_of([light])
        grid = (np.arange(8) + 0.5) / 4.0 - 1.0
        places, fine = [face.centre + a * face.u + b * face.v for a in grid for b in grid], 8
    want = np.mean([lit_share(place, fine) for place in places], axis=0)
    plain = gs.render(surfaces, CAMERA, [replace(light, shadows=False)], device=device)
    seen, on_floor = plain.truth(), np.zeros((SIDE, SIDE), bool)
    on_floor[seen.row, seen.column] = np.abs(seen.reference[:, 2]) < 1e-9
    on_floor.flat[find_edge_pixels(look(surfaces, CAMERA, lit=True)).pixel] = False
    shown = on_floor[ROWS]
    shares = [
        gs.render(surfaces, CAMERA, [light], device=device, backend=backend).radiance[ROWS][shown]
        / plain.radiance[ROWS][shown]
        for backend in ("gpu", "numpy")
    ]
    off, shadowed = np.abs(shares[0] - want[shown]), want[shown] < 0.99
    assert shadowed.sum() > 70 and want[shown].min() < 0.7
    # a pixel has 16 rows of samples, and both of the shadow's edges run along them
    assert off.max() < worst and np.sqrt(np.mean(off[shadowed] ** 2)) < rms
    np.testing.assert_allclose(*shares, atol=5e-3)
