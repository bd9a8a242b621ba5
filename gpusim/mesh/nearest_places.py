"""Where on a face, flat or curved, the nearest place to a point is."""

from __future__ import annotations

import numpy as np

from gpusim.arrays.array_types import Float, Long
from gpusim.mesh.boundary import Faces
from gpusim.mesh.shape_functions import FACE_TYPES, shape_functions, shape_gradients


def nearest_places(faces: Faces, face: Long, points: Float) -> tuple[Float, Float, Float]:
    """The place on each face numbered ``face`` (n,), extended beyond its sides, that is the nearest
    to the point (n, 3).

    Returns
    -------
    outside : (n,) how far outside the face it lies, in reference coordinates; <= 0 within.
    distance : (n,) of place and point.
    shares : (n, w) what the nodes of each row of ``faces.nodes`` have in the place.
    """
    outside, distance = np.full(len(face), np.inf), np.full(len(face), np.inf)
    shares = np.zeros((len(face), faces.nodes.shape[1]))
    chosen = faces[face]
    for name, rows in chosen.kinds():
        columns = list(FACE_TYPES[name])
        place = faces.points[chosen.nodes[rows][:, columns]]
        outside[rows], distance[rows], part = _nearest(name, place, points[rows])
        shares[rows[:, None], columns] = part
    return outside, distance, shares


def _nearest(name: str, nodes: Float, point: Float) -> tuple[Float, Float, Float]:
    """The same for faces (n, k, 3) of one type, whose k shape functions come last. Gauss-Newton
    iteration, all at once."""
    triangle = name.startswith("tri")
    xi = np.full((len(point), 2), 1.0 / 3.0 if triangle else 0.0)
    left = np.arange(len(point))
    for _ in range(30):
        own, at = nodes[left], xi[left]
        slope = np.einsum("nka,nkd->nad", own, shape_gradients(name, at))
        gap = point[left] - np.einsum("nk,nka->na", shape_functions(name, at), own)
        step = np.einsum("nda,na->nd", np.linalg.pinv(slope), gap)
        xi[left] = np.clip(at + step, -3.0, 3.0)
        # a place beside its face stays at a limit: that is no reason to go on with all the others
        left = left[np.abs(xi[left] - at).max(axis=1) >= 1e-13]
        if not left.size:
            break
    share = shape_functions(name, xi)
    a, b = xi.T
    outside = (
        np.maximum(np.maximum(-a, -b), a + b - 1.0)
        if triangle
        else np.maximum(np.abs(a), np.abs(b)) - 1.0
    )
    gap = point - np.einsum("nk,nka->na", share, nodes)
    return outside, np.linalg.norm(gap, axis=1), share
