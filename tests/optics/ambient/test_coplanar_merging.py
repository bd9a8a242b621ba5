"""Flat parts of meshes joined for what they hide: what is joined, and what isn't."""

from __future__ import annotations

import numpy as np
import pytest

import gpusim as gs
from gpusim.optics.ambient.coplanar_merging import merge_flat
from gpusim.optics.ambient.sky_occluders import joined_faces


def strip(columns: int, rows: int, sag: float) -> tuple[np.ndarray, np.ndarray]:
    """Points and quads of a sheet 1.2 x 0.5, bent by ``sag`` along x."""
    u, v = np.meshgrid(np.linspace(0, 1, columns + 1), np.linspace(0, 1, rows + 1))
    points = np.stack([1.2 * u, 0.5 * v, 4 * sag * u * (1 - u)], axis=-1).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(columns), np.arange(rows))
    a = (j * (columns + 1) + i).reshape(-1)
    return points, np.stack([a, a + 1, a + columns + 2, a + columns + 1], axis=1)


def test_a_flat_sheet_becomes_one_face() -> None:
    points, faces = strip(7, 3, 0.0)
    found = merge_flat(points, faces, 1e-9)
    assert len(found) == 1
    corners = points[found[0]]
    np.testing.assert_allclose(
        np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1), [1.2, 0.5, 1.2, 0.5]
    )


@pytest.mark.parametrize("tolerance", [1e-5, 1e-4, 1e-3])
def test_a_bent_sheet_keeps_to_its_tolerance(tolerance: float) -> None:
    points, faces = strip(64, 3, 0.02)
    found = merge_flat(points, faces, tolerance)
    assert 4 <= len(found) <= 64
    middles = points[faces].mean(axis=1)
    covered = 0
    for quad in points[found]:
        low, high = quad.min(axis=0)[:2], quad.max(axis=0)[:2]
        own = ((middles[:, :2] > low) & (middles[:, :2] < high)).all(axis=1)
        inside = points[faces[own]].reshape(-1, 3)
        normal = np.cross(quad[2] - quad[0], quad[3] - quad[1])
        gap = np.abs((inside - quad.mean(axis=0)) @ normal) / np.linalg.norm(normal)
        assert gap.max() <= 2.0 * tolerance
        covered += np.count_nonzero(own)
    # each face went into one of them
    assert covered == len(faces)


def test_triangles_are_not_joined() -> None:
    points, faces = strip(5, 2, 0.0)
    triangles = np.concatenate([faces[:, [0, 1, 2, 2]], faces[:, [0, 2, 3, 3]]])
    np.testing.assert_array_equal(merge_flat(points, triangles, 1e-6), triangles)


def test_faces_of_several_surfaces() -> None:
    points, faces = strip(5, 2, 0.0)
    flat = gs.Surface(points, faces)
    bent = points.copy()
    bent[7, 2] += 0.1
    # faces of open surfaces whose corners leave a plane are two triangles each
    every, found, both_sides = joined_faces([flat, gs.Surface(bent, faces)], 1e-6)
    assert len(found) == 1 + 2 * len(faces) and both_sides.all()
    assert (found[1:, 2] == found[1:, 3]).sum() + (found[1:, 0] == found[1:, 3]).sum() > 0
    np.testing.assert_array_equal(every[len(points) :], bent)
