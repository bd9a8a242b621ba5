"""A closed body wound inwards is told, one that holds the camera isn't."""

from __future__ import annotations

import numpy as np
import pytest

import gpusim as gs

CORNERS = np.array(
    [[x, y, z] for z in (-1.0, 1.0) for y in (-1.0, 1.0) for x in (-1.0, 1.0)]
) * [0.9, 0.7, 0.4] + [3.0, 5.0, -2.0]  # fmt: skip
OUTWARD = np.array(
    [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
)


def camera(eye: tuple[float, float, float]) -> gs.Camera:
    return gs.Camera.from_lens((4.0, 3.0), 3.0, (40, 30), eye, (3.1, 5.2, -2.1))


@pytest.mark.parametrize("backend", ["gpu", "numpy"])
def test_a_body_wound_inwards_is_named(backend: str) -> None:
    lights = [gs.PointLight((2.0, 1.0, 3.0), 50.0)]
    right = gs.Surface(CORNERS, OUTWARD, name="right")
    wrong = gs.Surface(np.add(CORNERS, (3.0, 0.0, 0.0)), OUTWARD[:, ::-1], name="wrong")
    frame = gs.render([right, wrong], camera((2.0, -1.0, 1.0)), lights, backend=backend)
    (warning,) = frame.warnings
    assert "surface 'wrong'" in warning
    assert "counter-clockwise" in warning


def test_bodies_that_move_and_photographs_tell_as_well() -> None:
    body = gs.Surface(CORNERS, OUTWARD[:, ::-1], name="turned").moved(
        np.add(CORNERS, (0.0, 0.1, 0.0))
    )
    photo = gs.photograph([body], camera((2.0, -1.0, 1.0)), lens=gs.Lens(psf=gs.psf.Gaussian(0.7)))
    assert sum("turned" in text for text in photo.warnings) == 1


def test_rooms_and_open_surfaces_are_left_alone() -> None:
    room = gs.Surface(CORNERS, OUTWARD[:, ::-1])
    sheet = gs.Surface(CORNERS, OUTWARD[1:, ::-1])
    assert not gs.render([room], camera((2.5, 4.6, -1.9))).warnings
    assert not gs.render([sheet], camera((2.0, -1.0, 1.0))).warnings
