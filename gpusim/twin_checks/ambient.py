"""Stages of ambient occlusion against NumPy."""

from __future__ import annotations

import numpy as np

from gpusim.gpu import Device, compare, twin_check
from gpusim.optics.ambient.hemisphere_mask import (
    COLUMNS,
    ROWS,
    hemisphere_masks,
    hemisphere_masks_twin,
)
from gpusim.optics.ambient.silhouette_bvh import EdgeAdjacency, SamplePoints, SilhouetteBVH
from gpusim.optics.ambient.silhouette_search import (
    SilhouetteBuffers,
    SilhouetteLists,
    silhouettes_near,
)
from gpusim.twin_checks.shadow_scene import block


@twin_check("optics/ambient/hemisphere_mask")
def _hemisphere_mask(device: Device) -> None:
    box = block((0.1, 0.3, 0.25), (0.35, 0.2, 0.25), 0.5)
    plate = np.array([[-0.9, -0.4, 0.5], [-0.2, -0.5, 0.6], [-0.3, 0.2, 0.5], [-0.9, 0.1, 0.45]])
    corners = np.concatenate([box.points[box.faces], plate[None]])
    both = np.arange(len(corners)) == len(corners) - 1
    random = np.random.default_rng(3)
    at = np.c_[random.uniform(-1.0, 1.0, (301, 2)), np.zeros(301)]
    normal = np.c_[random.uniform(-0.4, 0.4, (301, 2)), np.ones(301)]
    normal[:150] = [0.0, 0.0, 1.0]
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    points = SamplePoints(at, normal, np.full(301, 2e-6), np.full(301, 1e-3))
    facets = EdgeAdjacency.apart(corners, both)
    want = hemisphere_masks_twin(points, SilhouetteLists.everywhere(facets, len(at)))
    tables = SilhouetteBuffers(device, SilhouetteBVH.of(facets))
    got = hemisphere_masks(tables, points)
    tables.release()
    # a few of 2048 samples may fall to the other side of an edge
    compare(
        "optics/ambient/hemisphere_mask", got.open_share, want.open_share, "single",
        atol=3.5 / (ROWS * COLUMNS),
    )  # fmt: skip
    compare("optics/ambient/hemisphere_mask", got.inside, want.inside, "exact")


@twin_check("optics/ambient/silhouette_search")
def _silhouette_search(device: Device) -> None:
    boxes = [block((0.3 * k, 0.2, 0.1 * k), (0.1, 0.2, 0.05), 0.5) for k in range(12)]
    corners = np.concatenate([box.points[box.faces] for box in boxes])
    random = np.random.default_rng(6)
    points = SamplePoints(
        np.c_[random.uniform(-1.0, 4.0, (203, 2)), random.uniform(-0.3, 1.0, 203)],
        np.tile([0.0, 0.6, 0.8], (203, 1)), np.full(203, 2e-6), np.full(203, 1e-3),
    )  # fmt: skip
    contours = SilhouetteBVH.of(EdgeAdjacency.apart(corners, np.arange(len(corners)) % 3 == 0))
    want = silhouettes_near(contours, points, 1)
    tables = SilhouetteBuffers(device, contours)
    for near in tables.batches(points):
        counts = near.counts.read(np.uint32, (near.count, 2))
        for k, (buffer, start, listed) in enumerate(
            ((near.edges, want.edge_start, want.edge), (near.faces, want.face_start, want.face))
        ):
            compare("optics/ambient/silhouette_search", counts[:, k], np.diff(start), "exact")
            lists = buffer.read(np.uint32, (near.count, near.most[k]))
            kept = np.arange(near.most[k]) < counts[:, k, None]
            compare("optics/ambient/silhouette_search", lists[kept], listed, "exact")
        near.release()
    tables.release()
