"""Texture coordinates as paint coordinates: repeated pictures, triangles of one point."""

from __future__ import annotations

import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError
from gpusim.surface.paint import Image
from gpusim.surface.texture import textured

PICTURE = Image(np.arange(12.0).reshape(3, 4) / 12.0, texel=1.0)


def test_each_triangle_begins_in_the_first_picture() -> None:
    uv = np.array(
        [[[-1.5, 2.0], [-1.25, 2.0], [-1.5, 3.0]], [[0.2, 0.0], [1.00001, 0.0], [0.5, 1]]]
    )
    same, st = textured(PICTURE, uv)
    assert same is PICTURE  # a border missed by rounding repeats nothing
    np.testing.assert_allclose(st[0], [[2.0, 0.0], [3.0, 0.0], [2.0, 3.0]])
    assert st[1, 1, 0] == 4.0
    wide, st = textured(PICTURE, [[[0.5, 0.0], [3.0, 0.0], [0.5, 1.5]]])
    assert wide.pixels.shape == (6, 12)
    np.testing.assert_array_equal(wide.pixels[3:, 4:8], PICTURE.pixels)
    np.testing.assert_allclose(st[0], [[2.0, 0.0], [12.0, 0.0], [2.0, 4.5]])


def test_pictures_that_are_mirrored_or_clamped() -> None:
    """Along u from the first column on, along v from the lowest row on."""
    wide, st = textured(PICTURE, [[[-1.0, 0.0], [3.0, 0.0], [0.5, 2.0]]], ("clamp", "mirror"))
    columns = [0] * 5 + [1, 2] + [3] * 9
    np.testing.assert_array_equal(wide.pixels, PICTURE.pixels[[2, 1, 0, 0, 1, 2]][:, columns])
    np.testing.assert_allclose(st[0], [[0.0, 0.0], [16.0, 0.0], [6.0, 6.0]])
    wide, st = textured(PICTURE, [[[-1.5, 5.5], [-1.0, 5.5], [-1.5, 6.5]]], ("mirror", "clamp"))
    np.testing.assert_array_equal(wide.pixels[:18], np.tile(PICTURE.pixels[0], (18, 1)))
    np.testing.assert_allclose(st[0], [[2.0, 16.5], [4.0, 16.5], [2.0, 19.5]])
    beside, st = textured(PICTURE, [[[-4.0, 0.0], [-3.0, 0.0], [-4.0, 1.0]]], ("clamp", "clamp"))
    np.testing.assert_array_equal(beside.pixels, np.repeat(PICTURE.pixels[:, :1], 4, axis=1))


def test_a_triangle_of_one_point_shows_its_colour() -> None:
    """As files with a palette have them; a face of no part of the picture would be 0 / 0."""
    uv = np.full((1, 3, 2), 0.625), np.array([[[0.1, 0.5], [0.5, 0.5], [0.9, 0.5]]])
    for places in uv:
        picture, st = textured(Image(np.full((3, 4), 0.7), texel=1.0), places)
        corners = np.array([[-1.0, -1, 3], [1, 1, 3], [1, -1, 3]])
        surface = gs.Surface(corners, [[0, 1, 2]], picture, frames={"surface": gs.Atlas(st)})
        camera = gs.Camera(41, 31, np.array([[30.0, 0, 20], [0, 30, 15], [0, 0, 1]]))
        for backend in ("gpu", "numpy"):
            frame = gs.render([surface], camera, backend=backend).radiance
            assert abs(frame[16, 24] - 0.7) < 1e-5


def test_faults_say_what_got_and_expected() -> None:
    with pytest.raises(InputError, match="got faces without; expected some for every corner"):
        textured(PICTURE, [[[0.0, 0.0], [1.0, np.nan], [1.0, 1.0]]])
    with pytest.raises(InputError, match="picture of 4 x 3 6000 x 1 times; expected at most 16384"):
        textured(PICTURE, [[[0.0, 0.0], [6000.0, 0.0], [1.0, 1.0]]])
