"""The nearest place of a surface, against looking at every face."""

from __future__ import annotations

import numpy as np
import pytest

from gpusim.mesh import boundary_faces, plate_with_hole
from gpusim.mesh.nearest_places import nearest_on_surface, nearest_places


@pytest.mark.parametrize("element", ["hex8", "hex20"])
def test_the_nearest_of_all_faces_is_found(element: str) -> None:
    """Of a plate with a hole, whose faces grow with the distance from it; points near its skin."""
    mesh = plate_with_hole(80.0, 60.0, 2.0, 12.0, around=16, radial=4, element=element)
    faces = boundary_faces(mesh)
    rng = np.random.default_rng(4)
    chosen = rng.integers(len(faces), size=60)
    normals = faces.area_vectors / faces.areas[:, None]
    points = faces.centroids[chosen] + rng.uniform(-0.2, 0.2, (60, 3)) * normals[chosen]
    points += rng.uniform(-0.3, 0.3, (60, 1)) * (faces.corners[chosen, 0] - faces.centroids[chosen])
    face, distance, shares = nearest_on_surface(faces, points)
    everyone = np.tile(np.arange(len(faces)), len(points))
    outside, gap, _ = nearest_places(faces, everyone, np.repeat(points, len(faces), axis=0))
    wanted = np.where(outside <= 1e-9, gap, np.inf).reshape(len(points), -1).min(axis=1)
    inside = np.isfinite(wanted)
    assert inside.mean() > 0.9
    np.testing.assert_allclose(distance[inside], wanted[inside], atol=1e-9)
    nodes = np.maximum(faces.nodes[face], 0)
    place = np.einsum("nk,nki->ni", shares, mesh.points[nodes])
    np.testing.assert_allclose(np.linalg.norm(place - points, axis=1), distance, atol=1e-12)


def test_a_point_beside_all_faces_has_none() -> None:
    mesh = plate_with_hole(80.0, 60.0, 2.0, 12.0, around=16, radial=4)
    top = boundary_faces(mesh)
    top = top[top.area_vectors[:, 2] > 0.0]
    middle = mesh.bounds.mean(axis=0)
    _, distance, _ = nearest_on_surface(top, middle + np.array([[0.0, 0.0, 0.0], [20.0, 0.0, 5.0]]))
    assert np.isinf(distance[0])
    assert distance[1] == pytest.approx(4.0)
