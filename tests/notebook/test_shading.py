"""Pictures of notebooks: cameras that fit, and values that stay where they belong."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib import colormaps

import gpusim as gs
from gpusim.arrays.srgb import decoded
from gpusim.notebook import solution as of_solution
from gpusim.notebook.shading import (
    encoded,
    fitted_camera,
    painted,
    resized_camera,
    shaded,
)
from gpusim.optics.rendering.local_origin import local_view
from gpusim.optics.truth import truth_of
from gpusim.optics.visibility_buffer import visibility_twin


@pytest.mark.parametrize("size", [(3.0, 0.2, 0.1), (0.1, 0.3, 5.0), (1.0, 1.0, 0.0)])
@pytest.mark.parametrize("direction", [(0.45, 0.8, -0.4), (0.0, 0.0, -1.0), (-1.0, 0.1, 0.3)])
def test_a_fitted_camera_sees_all_and_little_else(
    size: tuple[float, float, float], direction: tuple[float, float, float]
) -> None:
    corners = np.array(np.meshgrid(*[(7.0, 7.0 + side) for side in size])).reshape(3, -1).T
    camera = fitted_camera(corners, direction)
    pixels = camera.project(corners)
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    whole = np.array([camera.width, camera.height])
    assert (low > -0.5).all() and (high < whole - 0.5).all()
    assert ((high - low) / whole).max() > 0.8
    up = camera.camera_from_world[1, :3]
    assert up[2] <= 1e-12  # z up


def test_a_smaller_picture_is_of_the_same_view() -> None:
    camera = gs.Camera.from_lens(
        (36, 24), 50, (1200, 800), (0, -3, 1), (0, 0, 0), distortion=(-0.1, 0.02, 0, 0),
        principal_point_offset_mm=(1.0, 0.5),
    )  # fmt: skip
    small = resized_camera(camera, 300, 300)
    assert (small.width, small.height) == (300, 200)
    points = np.array([[0.3, 0.2, 0.5], [-0.7, 0.1, 0.1]])
    assert np.abs((small.project(points) + 0.5) * 4 - 0.5 - camera.project(points)).max() < 1e-9


def test_the_curve_of_srgb() -> None:
    """Values of IEC 61966-2-1: its linear foot, a middle grey, white and beyond."""
    assert encoded(np.array([0.0, 0.002, 0.2140, 1.0, 3.0, -1.0])).tolist() == [
        0, 7, 127, 255, 255, 0
    ]  # fmt: skip


def test_colours_follow_a_linear_field() -> None:
    """Between the nodes, in perspective, as exactly as the colour map has steps."""
    bar = gs.mesh.box(size=(1.0, 0.3, 0.2), divisions=(2, 1, 1))
    skin = gs.Skin(bar, gs.mesh.boundary_faces(bar))
    points = skin.at_vertices(bar.points)
    values = 3.0 + 2.0 * points[:, 0]
    shown = of_solution._Shown(skin, points, values, 1.0)
    surface, colouring = of_solution._valued(shown, 3.0, 5.0)
    view = local_view([surface], fitted_camera(points), lit=True)
    truth = truth_of(view, visibility_twin(view))
    where = truth.reference + truth.displacement
    expected = np.minimum(1.25 * decoded(colormaps["viridis"](where[:, 0])[:, :3]), 1.0)
    assert len(where) > 10_000 and np.abs(colouring(truth) - expected).max() < 0.03


def test_the_side_of_the_lamp_is_bright_and_edges_are_dark() -> None:
    cube = gs.mesh.box(size=(1, 1, 1), divisions=(2, 2, 2))
    skin = gs.Skin(cube, gs.mesh.boundary_faces(cube))
    surface = skin.surface({"a": gs.paint.Plain(0.5)}, np.zeros(len(skin.faces), np.int32), {}, "c")
    camera = fitted_camera(surface.points)
    plain = shaded([surface], camera, painted([surface], camera))
    lined = shaded([surface], camera, painted([surface], camera), skin.face_of_piece)

    def at(picture: np.ndarray, point: tuple[float, float, float]) -> int:
        x, y = np.rint(camera.project(np.array([point]))[0]).astype(int)
        return int(picture[y - 1 : y + 2, x - 1 : x + 2, 1].min())

    top, front = at(plain, (0.2, 0.2, 1.0)), at(plain, (0.2, 0.0, 0.2))
    assert top > front > 60
    assert at(lined, (0.2, 0.2, 1.0)) == top
    assert at(lined, (0.5, 0.0, 0.25)) < 0.9 * front  # an edge between two elements
    assert (plain[0, 0] == 0).all()  # transparent beside it
