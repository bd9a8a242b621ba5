"""The faces that may hide surroundings; flat parts are joined
(`gpusim.optics.ambient.coplanar_merging`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.optics.ambient.coplanar_merging import merge_flat
from gpusim.optics.ambient.silhouette_bvh import EdgeAdjacency, SilhouetteBVH
from gpusim.optics.geometry.view import View
from gpusim.surface.surface import Surface

FLATNESS = 0.05
"""px at the nearest surface, that joined faces may pass from the surface."""

BENT = 1e-7
"""Of a face's size: a corner's distance from the plane of the others that makes it bent."""


@dataclass(frozen=True, eq=False)
class JoinedFaces:
    """``contours``, relative to the eye; ``sag``: how far faces may pass from the surface."""

    contours: SilhouetteBVH
    sag: float

    @staticmethod
    def of(view: View, surfaces: Sequence[Surface]) -> JoinedFaces:
        """Those of ``surfaces``, to what ``view`` can tell."""
        depth = 1.0 / max(float(view.inverse_depth().max(initial=0.0)), 1e-300)
        sag = FLATNESS * depth / float(np.abs(np.diag(view.camera.K)[:2]).max())
        points, faces, both_sides = joined_faces(surfaces, sag)
        facets = EdgeAdjacency.of(points - view.camera.eye, faces, both_sides)
        return JoinedFaces(SilhouetteBVH.of(facets), sag)


def joined_faces(surfaces: Sequence[Surface], sag: float) -> tuple[Float, Long, Bool]:
    """Vertices (P, 3) and faces (F, 4) of all ``surfaces``, a triangle's last corner twice, and
    whether both of their sides hide (F,), as those of open surfaces do. Flat parts are joined that
    stay within ``sag`` of the surface."""
    points, faces = [np.zeros((0, 3))], [np.zeros((0, 4), np.int64)]
    both_sides = [np.zeros(0, bool)]
    first = 0
    several = sum(len(surface.faces) for surface in surfaces) > 1
    for surface in surfaces:
        used = surface.faces.astype(np.int64)
        if not surface.topology.closed and _bent(surface.points, used):
            # both their sides hide: from its mean plane a bent face would hide part of itself
            triangles = surface.topology.triangles
            used = np.column_stack([triangles, np.full(len(triangles), -1)])
        faces_of = np.where(used >= 0, used, np.roll(used, 1, axis=1))
        if several:
            faces_of = merge_flat(surface.points, faces_of, sag)
        points.append(surface.points)
        faces.append(faces_of + first)
        both_sides.append(np.full(len(faces_of), not surface.topology.closed))
        first += len(surface.points)
    return np.concatenate(points), np.concatenate(faces), np.concatenate(both_sides)


def _bent(points: Float, faces: Long) -> bool:
    """Whether corners of some face (F, 4), -1 in the last column for triangles, leave a plane."""
    a, b, c, d = (points[corner] for corner in faces[faces[:, 3] >= 0].T)
    normal = np.cross(c - a, d - b)
    size = np.linalg.norm(normal, axis=1)
    gap = np.abs(np.einsum("fa,fa->f", normal, b - a))
    return bool((gap > BENT * size * np.sqrt(size)).any())
