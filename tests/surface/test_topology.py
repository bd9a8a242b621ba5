"""Which sides of faces run along each other, against a look at every pair."""

from __future__ import annotations

import numpy as np

from gpusim.surface.topology import opposite_sides


def by_pairs(faces: np.ndarray) -> np.ndarray:
    sides = [
        (int(start), int(end))
        for face in faces
        for start, end in zip(face, np.roll(face, -1), strict=True)
    ]
    found = []
    for start, end in sides:
        alike = [k for k, other in enumerate(sides) if {*other} == {start, end} and start != end]
        other = [k for k in alike if sides[k] == (end, start)]
        found.append(other[0] if len(alike) == 2 and len(other) == 1 else -1)
    return np.reshape(found, faces.shape)


def test_sides_are_those_that_two_faces_share_one_each_way() -> None:
    """A strip, a face turned over, a third one at an edge, triangles with a corner twice."""
    faces = np.array(
        [[0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [4, 5, 9, 8], [5, 9, 10, 6], [6, 7, 11, 11],
         [6, 11, 10, 10], [1, 5, 12, 13]]
    )  # fmt: skip
    found = opposite_sides(faces)
    np.testing.assert_array_equal(found, by_pairs(faces))
    assert (found >= 0).sum() >= 8 and found[0, 1] == -1
    triangles = np.random.default_rng(3).integers(0, 9, (40, 3))
    np.testing.assert_array_equal(opposite_sides(triangles), by_pairs(triangles))
