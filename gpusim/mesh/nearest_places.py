"""Where on faces, flat or curved, the nearest place to a point is."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from gpusim.arrays.array_types import Float, Long
from gpusim.mesh.boundary import Faces
from gpusim.mesh.shape_functions import FACE_TYPES, shape_functions, shape_gradients

# faces of about one size that are looked at for each point
_CANDIDATES = 12
# how far outside of a face, in its reference coordinates, a point may lie
_OUTSIDE = 1e-3
# of a face's size: a place as near as this isn't looked for any further
_TOUCHING = 1e-9


def nearest_on_surface(faces: Faces, points: Float) -> tuple[Long, Float, Float]:
    """The face that each point (n, 3) lies on or nearest to, of those whose sides it lies within.

    Returns
    -------
    face : (n,) its number.
    distance : (n,) of the point and its place on the face; inf where no face is below the point.
    shares : (n, w) what the nodes of the face's row of ``faces.nodes`` have in the place.
    """
    size = np.sqrt(faces.areas)
    face, distance = np.zeros(len(points), dtype=np.int64), np.full(len(points), np.inf)
    shares, badness = np.zeros((len(points), faces.nodes.shape[1])), distance.copy()
    for candidate, least in zip(*_candidates(faces, points), strict=True):
        enough = np.maximum(least, _TOUCHING * size[candidate])
        at = np.flatnonzero(~(badness <= enough))
        which = candidate[at]
        outside, gap, share = nearest_places(faces, which, points[at])
        # of two faces side by side the one that holds the point is better
        worse = np.hypot(gap, size[which] * np.maximum(outside, 0.0))
        better = np.flatnonzero((outside <= _OUTSIDE) & (worse < badness[at]))
        at, which = at[better], which[better]
        face[at], distance[at], shares[at] = which, gap[better], share[better]
        badness[at] = worse[better]
    return face, distance, shares


def _candidates(faces: Faces, points: Float) -> tuple[Long, Float]:
    """(c, n) faces to look at, and how near they are at best; those first that are near for their
    size: beside a large face the nearest centres may all be those of small ones, so that each size
    has a search of its own."""
    radius = np.linalg.norm(faces.corners - faces.centroids[:, None], axis=2).max(axis=1)
    doubling = np.ceil(np.log2(np.where(radius > 0.0, radius, 1.0)))
    found, away, least = [], [], []
    for one in np.unique(doubling):
        alike = np.flatnonzero(doubling == one)
        count = min(_CANDIDATES, len(alike))
        distance, number = cKDTree(faces.centroids[alike]).query(points, k=[*range(1, count + 1)])
        found.append(alike[number])
        away.append(distance / 2.0**one)
        least.append(distance - 2.0**one)
    order = np.argsort(np.concatenate(away, axis=1), axis=1, kind="stable")
    face, nearest = (
        np.take_along_axis(np.concatenate(part, axis=1), order, axis=1).T for part in (found, least)
    )
    return face, nearest


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
