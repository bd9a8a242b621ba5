"""Borders of flat plates against polygon areas, on the device and in NumPy."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.optics.edge_pixels.fragment_lists import find_edge_pixels
from gpusim.optics.edge_pixels.fragment_shading import THIN
from gpusim.optics.geometry.polygon_clipping import clip_square, half_planes, moments
from gpusim.optics.geometry.view import View, look
from gpusim.surface.paint import Checker, Paint, Plain
from gpusim.surface.surface import Surface

# three faces, the middle one's sides prolonged by its neighbours
X = np.array([-0.33, -0.11, 0.12, 0.31, 0.31, 0.12, -0.11, -0.33])
Z = np.array([-0.2, -0.2, -0.2, -0.2, 0.21, 0.21, 0.21, 0.21])
FACES = np.array([[0, 1, 6, 7], [1, 2, 5, 6], [2, 3, 4, 5]])
BOARD = Checker(0.061, 8, 5, (0.07, 0.04), 0.06, 0.8, 0.5)


def plate(paint: Paint) -> Surface:
    y = 0.13 * X + 0.05 * Z
    return Surface(np.stack([X, y, Z], axis=1), FACES, paint=paint)


def camera() -> gs.Camera:
    return gs.Camera.from_lens(
        (36.0, 24.0),
        46.0,
        (391, 262),
        (0.1, -1.1, 0.07),
        (0.0, 0.0, 0.01),
        up=(0.07, 0.0, 1.0),
    )


def areas(view: View, pixel: npt.NDArray[np.int64]) -> npt.NDArray[np.float64]:
    """Share of every pixel's square that any triangle covers (they don't overlap)."""
    width = view.camera.width
    at = np.stack([pixel % width, pixel // width], axis=1).astype(np.float64)
    result = np.zeros(len(pixel))
    for triangle in view.screen:
        corners = triangle - at[:, None]
        result += moments(clip_square(half_planes(corners))[0])[0]
    return result


@pytest.mark.parametrize("backend", ["gpu", "numpy"])
@pytest.mark.parametrize("paint", [Plain(0.7), BOARD])
def test_shares_are_polygon_areas(paint: Paint, backend: str) -> None:
    view = look([plate(paint)], camera(), lit=False)
    pixel = find_edge_pixels(view).pixel
    assert len(pixel) > 700
    got = gs.render([plate(paint)], camera(), background=0.11, backend=backend).radiance
    share = (got.reshape(-1)[pixel] - 0.11) / (paint.ground - 0.11)
    want = areas(view, pixel)
    off = np.abs(share - want)
    # places are in 1/65536 px; and what is left open by no more than THIN counts as a seam
    assert off[want < 1.0 - THIN].max() <= 1e-5 and off.max() <= THIN
    assert np.ptp(share) > 0.6


@pytest.mark.parametrize("paint", [Plain(0.7), BOARD])
def test_a_picture_is_the_same_as_its_twin(device: gs.Device, paint: Paint) -> None:
    got = gs.render([plate(paint)], camera(), background=0.2, device=device).radiance
    want = gs.render([plate(paint)], camera(), background=0.2, backend="numpy").radiance
    assert np.abs(got - want).max() <= 5.1e-4 * 0.5
    assert np.ptp(want) > 0.2
