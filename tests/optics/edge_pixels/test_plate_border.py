"""Borders of flat plates in closed form, against polygon areas and the general way."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.optics.edge_pixels.fragment_lists import find_edge_pixels
from gpusim.optics.edge_pixels.plate_border import Border
from gpusim.optics.geometry.polygon_clipping import clip_square, half_planes, moments
from gpusim.optics.geometry.view import View, look
from gpusim.surface.paint import Checker, Dots, Paint, Plain
from gpusim.surface.surface import Surface

# three faces, the middle one's sides prolonged by its neighbours
X = np.array([-0.33, -0.11, 0.12, 0.31, 0.31, 0.12, -0.11, -0.33])
Z = np.array([-0.2, -0.2, -0.2, -0.2, 0.21, 0.21, 0.21, 0.21])
FACES = np.array([[0, 1, 6, 7], [1, 2, 5, 6], [2, 3, 4, 5]])
BOARD = Checker(0.061, 8, 5, (0.07, 0.04), 0.06, 0.8, 0.5)


def plate(paint: Paint, bend: float = 0.0) -> Surface:
    y = 0.13 * X + 0.05 * Z + bend * X**2
    return Surface(np.stack([X, y, Z], axis=1), FACES, paint=paint)


def camera(**changes: object) -> gs.Camera:
    return gs.Camera.from_lens(
        (36.0, 24.0),
        46.0,
        (391, 262),
        (0.1, -1.1, 0.07),
        (0.0, 0.0, 0.01),
        up=(0.07, 0.0, 1.0),
        **changes,  # type: ignore[arg-type]
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


@pytest.mark.parametrize("paint", [Plain(0.7), BOARD])
def test_shares_are_polygon_areas(paint: Paint) -> None:
    view = look([plate(paint)], camera(), lit=False)
    assert Border.suits(view)
    border = Border.of(view, 0.11)
    assert len(border.pixel) > 700
    want = 0.11 + areas(view, border.pixel) * (paint.ground - 0.11)
    assert np.abs(border.value - want).max() <= 1e-9
    assert np.ptp(border.value) > 0.3
    np.testing.assert_array_equal(np.sort(border.pixel), find_edge_pixels(view).pixel)


@pytest.mark.parametrize("paint", [Plain(0.7), BOARD])
def test_a_picture_is_the_same_as_the_general_way(device: gs.Device, paint: Paint) -> None:
    got = gs.render([plate(paint)], camera(), background=0.2, device=device).radiance
    want = gs.render([plate(paint)], camera(), background=0.2, backend="numpy").radiance
    # what is left open by less than this counts as a seam there
    assert np.abs(got - want).max() <= 5.1e-4 * 0.5
    assert np.ptp(want) > 0.2


def test_what_goes_the_general_way() -> None:
    assert not Border.suits(look([plate(Plain(0.4), bend=0.1)], camera(), lit=False))
    assert not Border.suits(look([plate(Dots(0.05, 0.4))], camera(), lit=False))
    # fields up to the border, and a board whose rim is narrower than a pixel
    assert not Border.suits(look([plate(Checker(0.061))], camera(), lit=False))
    narrow = Checker(0.1, 6, 4, (0.0005, 0.0005))
    assert not Border.suits(look([plate(narrow)], camera(), lit=False))
    lens = camera(distortion=[-0.2, 0.05, 0.0, 0.0])
    assert not Border.suits(look([plate(Plain(0.4))], lens, lit=False))
    other = Surface(plate(Plain(0.1)).points + np.array([0.0, 0.3, 0.1]), FACES, paint=Plain(0.1))
    assert not Border.suits(look([plate(Plain(0.4)), other], camera(), lit=False))
    away = Surface(plate(Plain(0.1)).points + np.array([0.0, -9.0, 0.0]), FACES, paint=Plain(0.1))
    assert not Border.suits(look([away], camera(), lit=False))


def test_only_what_lies_in_one_plane() -> None:
    assert Border.suits(look([plate(Plain(0.4))], camera(), lit=False))
    points = plate(Plain(0.4)).points
    lifted = Surface(points + np.array([0.0, 1e-6, 0.0]), FACES, paint=Plain(0.1))
    assert not Border.suits(look([plate(Plain(0.4)), lifted], camera(), lit=False))
    folded = points.copy()
    folded[2, 1] += 1e-6
    assert not Border.suits(look([Surface(folded, FACES, paint=Plain(0.1))], camera(), lit=False))
