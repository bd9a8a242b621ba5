"""A part of an image in its place."""

from __future__ import annotations

import numpy as np
import pytest

import gpusim as gs
from gpusim.pipeline.pictures.image_window import Window


@pytest.mark.parametrize("channels", [(), (3,)])
def test_a_part_is_placed_in_black(channels: tuple[int, ...]) -> None:
    camera = gs.Camera(57, 33, np.diag([50.0, 50.0, 1.0]))
    part = np.random.default_rng(1).integers(1, 255, (9, 20, *channels), np.uint8)
    image = Window(30, 4, 20, 9).placed(part, camera)
    assert image.shape == (33, 57, *channels) and image.dtype == np.uint8
    assert np.array_equal(image[4:13, 30:50], part) and image.sum() == part.sum()
