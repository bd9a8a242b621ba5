"""Pixels that one sheet covers whole: nothing is hidden there, and areas add up to the pixel."""

from __future__ import annotations

import numpy as np
import pytest

import gpusim as gs
from gpusim.optics.edge_pixels.fragment_lists import EdgePixels, bin_edges
from gpusim.optics.edge_pixels.pixel_rank import Ranks
from gpusim.optics.edge_pixels.sheets import centred, outlines
from gpusim.optics.geometry.polygon_clipping import clip_square, half_planes, moments
from gpusim.optics.geometry.view import View, look
from gpusim.optics.probes.paints import fields_setup

CAMERA = gs.Camera(60, 40, np.array([[50.0, 0.2, 29.3], [0.0, 51.0, 20.1], [0.0, 0.0, 1.0]]))
PAINTS = {"a": gs.paint.Plain(0.2), "b": gs.paint.Plain(0.9)}


def areas(view: View, edges: EdgePixels) -> np.ndarray:
    """(E,): sum of the areas of the triangles within each edge pixel."""
    entry = np.repeat(np.arange(len(edges.pixel)), edges.depth)
    number = edges.pixel[entry]
    at = np.stack([number % view.camera.width, number // view.camera.width], axis=1)
    corners = view.screen[edges.triangle] - at[:, None]
    size = moments(clip_square(half_planes(corners))[0])[0]
    return np.bincount(entry, size, len(edges.pixel))


def test_areas_within_whole_pixels_add_up() -> None:
    view = fields_setup(False).view
    edges = bin_edges(view)
    total = areas(view, edges)
    assert edges.whole.sum() > 200 and (~edges.whole).sum() > 50
    assert np.abs(total[edges.whole] - 1.0).max() < 1e-9


def test_a_sheet_before_another_isnt_whole() -> None:
    """A paint's border runs over both of two sheets at 2 and 3: each covers the pixels whole."""
    points = np.array([[-2.0, -2, 0], [0, -2, 0], [2, -2, 0], [-2, 2, 0], [0.1, 2, 0], [2, 2, 0]])
    faces = np.array([[0, 3, 4, 1], [1, 4, 5, 2]], np.int32)
    near, far = (
        gs.Surface(
            points + np.array([0.0, 0.0, z]), faces, PAINTS, region=np.array([0, 1], np.int32)
        )
        for z in (2.0, 3.0)
    )
    one = look([near], CAMERA, lit=False)
    assert bin_edges(one).whole.all() and len(bin_edges(one).pixel) >= CAMERA.height
    two = look([far, near], CAMERA, lit=False)
    edges = bin_edges(two)
    assert not edges.whole.any() and np.abs(areas(two, edges) - 2.0).max() < 1e-9


def test_outlines_are_all_but_the_borders_within() -> None:
    """A box of two paints ends at its outline, not at the border of its two visible faces."""
    corners = np.array([[x, y, z] for z in (3.0, 4.0) for y in (-0.5, 0.5) for x in (-0.9, -0.1)])
    quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    paint = np.array([0, 1, 1, 1, 1, 1], np.int32)
    view = look([gs.Surface(corners, np.array(quads, np.int32), PAINTS, paint)], CAMERA, lit=False)
    ends, again = outlines(view)
    triangle, k = view.edge_source.T
    sides = np.stack([view.corner[triangle, k], view.corner[triangle, (k + 1) % 3]], axis=1)
    depth = view.vertices[sides][:, :, 2]
    # the face in front shows, and the one on its right: they have one edge in common
    within = (depth == 3.0).all(axis=1) & (view.vertices[sides][:, :, 0] > -0.2).all(axis=1)
    assert within.sum() == 2 and not ends[within].any() and ends[~within].all()
    assert again.sum() == again[within].sum() == 1


def test_neighbours_leave_no_gap_at_a_centre() -> None:
    """A fan of triangles about a point near the origin: its centre lies in one, or on a side."""
    rng = np.random.default_rng(3)
    for middle in (np.zeros(2), *rng.normal(size=(50, 2)) * 1e-17, *rng.normal(size=(50, 2)) * 0.1):
        angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, 9))
        rim = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        if np.diff(np.append(angle, angle[0] + 2.0 * np.pi)).max() > 3.0:
            continue
        fan = np.stack([np.broadcast_to(middle, rim.shape), rim, np.roll(rim, -1, axis=0)], axis=1)
        assert centred(fan).any()


@pytest.mark.parametrize("size", [1, 64, 65, 4096, 100_003])
def test_ranks_are_those_of_a_search(size: int) -> None:
    rng = np.random.default_rng(size)
    for share in (0.0, 0.03, 1.0):
        listed = np.flatnonzero(rng.uniform(size=size) < share)
        index = np.concatenate([[0, size], rng.integers(0, size + 1, 40_000)])
        np.testing.assert_array_equal(Ranks(listed, size).of(index), np.searchsorted(listed, index))
