"""Lists of edges and faces that points need, on the device against NumPy."""

from __future__ import annotations

import numpy as np

from gpusim.gpu import Device
from gpusim.optics.ambient.silhouette_bvh import EdgeAdjacency, SamplePoints, SilhouetteBVH
from gpusim.optics.ambient.silhouette_search import SilhouetteBuffers, silhouettes_near


def test_lists_of_many_faces_are_whole(device: Device) -> None:
    """More edges that a point needs than a device's loop may have turns."""
    random = np.random.default_rng(8)
    up = np.tile([0.0, 0.0, 1.0], (5, 1))
    middle = random.uniform(-1.0, 1.0, (20_000, 1, 3)) + 2.0 * up[0]
    corners = middle + 0.02 * random.normal(size=(20_000, 4, 3))
    corners[:, 3] = corners[:, 2]
    contours = SilhouetteBVH.of(EdgeAdjacency.apart(corners, np.ones(len(corners), bool)))
    at = np.c_[random.uniform(-0.5, 0.5, (5, 2)), np.zeros(5)]
    points = SamplePoints(at, up, np.full(5, 1e-6), np.full(5, 1e-3))
    want = silhouettes_near(contours, points, 1)
    assert np.diff(want.edge_start).min() > 58_000
    tables = SilhouetteBuffers(device, contours)
    for near in tables.batches(points):
        got = near.counts.read(np.uint32, (near.count, 2))
        np.testing.assert_array_equal(got[:, 0], np.diff(want.edge_start))
        # some more faces than in NumPy
        faces = near.faces.read(np.uint32, (near.count, near.most[1]))
        for own, count, some in zip(
            faces, got[:, 1], np.split(want.face, want.face_start[1:-1]), strict=True
        ):
            assert np.isin(some, own[:count]).all()
            assert count < 1.02 * len(some)
        lists = near.edges.read(np.uint32, (near.count, near.most[0]))
        kept = np.arange(near.most[0]) < got[:, :1]
        np.testing.assert_array_equal(lists[kept], want.edge)
        near.release()
    tables.release()
