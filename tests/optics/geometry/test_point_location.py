"""Triangles found at any place of an image: against the rasteriser, and against planes in space."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import gpusim as gs
from gpusim.optics.frame import Frame
from gpusim.optics.geometry.point_location import PointLocation
from gpusim.optics.rendering.local_origin import local_view

LENSES = {"pinhole": None, "barrel": np.array([-0.2, 0.1, 0.001, -0.002, 0.0])}


def block() -> gs.Surface:
    grid = gs.mesh.box(size=(0.2, 0.1, 0.02), divisions=(23, 11, 3))
    skin = gs.Skin(grid, gs.mesh.boundary_faces(grid))
    return gs.Surface(skin.at_vertices(grid.points), skin.pieces)


def camera(lens: str) -> gs.Camera:
    found = gs.Camera.from_lens((0.036, 0.024), 0.05, (257, 183), (0.15, -0.35, 0.2), (0.1, 0, 0))
    return replace(found, distortion=LENSES[lens])


def pixels_of(shape: tuple[int, int]) -> np.ndarray:
    row, column = np.indices(shape).reshape(2, -1)
    return np.stack([column, row], axis=1).astype(np.float64)


@pytest.mark.parametrize("lens", LENSES)
def test_pixel_centres_see_what_the_rasteriser_draws(lens: str) -> None:
    frame = Frame(local_view([block()], camera(lens), lit=False), None)
    ids = frame.ids()
    triangle, inverse = PointLocation(frame.view).nearest(pixels_of(ids.shape))
    found = triangle.reshape(ids.shape) + 1
    assert (ids > 0).mean() > 0.1
    # the rasteriser rounds corners to 1/65536 px: a centre on an edge may fall either way
    assert np.count_nonzero(found != ids) <= 1e-3 * ids.size
    truth = frame.truth()
    same = (found == ids)[truth.row, truth.column]
    depth = 1.0 / inverse.reshape(ids.shape)[truth.row, truth.column][same]
    assert np.abs(depth / truth.depth[same] - 1.0).max() <= 1e-12


def test_between_pixels_the_nearer_of_two_walls_is_seen_to_its_very_edge() -> None:
    square = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    far = gs.Surface(3.0 * square, [[0, 1, 2, 3]], name="far")
    near = gs.Surface(square * [0.25, 0.5, 1] + [0, 0, 0.4], [[0, 1, 2, 3]], name="near")
    eye = gs.Camera.from_lens((36, 24), 50, (57, 33), (0, 0, 2), (0, 0, 0), up=(0, 1, 0))
    located = PointLocation(local_view([far, near], eye, lit=False))
    edge = eye.project(np.array([[0.25, 0.1, 0.4]]))
    triangle, inverse = located.nearest(edge + np.array([[-1e-6, 0], [1e-6, 0], [900, 0]]))
    assert located.view.body[triangle[:2]].tolist() == [1, 0]
    assert 1.0 / inverse[:2] == pytest.approx([1.6, 2.0], rel=1e-12)
    assert triangle[2] == -1 and inverse[2] == 0.0


def test_a_camera_that_sees_nothing_finds_nothing() -> None:
    away = gs.Camera.from_lens((36, 24), 50, (57, 33), (0, 0, 2), (0, 0, 9), up=(0, 1, 0))
    wall = gs.Surface([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2, 3]])
    triangle, _ = PointLocation(local_view([wall], away, lit=False)).nearest(pixels_of((33, 57)))
    assert (triangle == -1).all()
