"""Lists of edges and faces that points need, on the device against NumPy."""

from __future__ import annotations

import numpy as np

from gpusim.gpu import Device
from gpusim.optics.ambient.silhouette_bvh import EdgeAdjacency, SamplePoints, SilhouetteBVH
from gpusim.optics.ambient.silhouette_search import (
    SilhouetteBuffers,
    contour_edges,
    faces_upward,
)


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
    wanted = contour_edges(points, contours.facets) != 0, faces_upward(points, contours.facets)
    assert wanted[0].sum(axis=1).min() > 58_000
    tables = SilhouetteBuffers(device, contours)
    begin = 0
    for near in tables.batches(points):
        got = near.counts.read(np.uint32, (near.count, 2))
        for k, (buffer, every) in enumerate(zip((near.edges, near.faces), wanted, strict=True)):
            lists = buffer.read(np.uint32, (near.count, near.most[k]))
            for listed, count, want in zip(lists, got[:, k], every[begin:], strict=False):
                kept = listed[:count]
                assert len(np.unique(kept)) == count
                # all of them, and some more
                assert np.isin(np.flatnonzero(want), kept).all()
                assert count < 1.02 * want.sum()
        begin += near.count
        near.release()
    assert begin == len(at)
    tables.release()
