"""Polygons as triangles and quadrilaterals within them, cut at their dents; normals."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float, Long
from gpusim.errors import InputError

_FARTHEST = 1e15
_FLAT = 1e-12
"""Of a face's area: a dent that is less is a straight corner."""


def check_corners(where: str, points: Float, corners: npt.NDArray[np.integer]) -> None:
    """Refuse points (P, 3) that aren't finite, and corners of faces at points that aren't there."""
    if not (np.abs(points) < _FARTHEST).all():
        raise InputError(
            f"{where}: a coordinate isn't finite; expected numbers below {_FARTHEST:g}"
        )
    if corners.size and not 0 <= corners.min() <= corners.max() < len(points):
        wrong = corners.max() if corners.max() >= len(points) else corners.min()
        raise InputError(f"{where}: a face names point {wrong}; got {len(points)} points, from 0")


def unit_normals(corners: Float) -> Float:
    """(T, 3) of triangles (T, 3, 3), to where they look counter-clockwise; zero without an area."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1)
    normal /= np.where(length > 0.0, length, 1.0)[:, None]
    return normal


def cut_at_dents(points: Float, faces: npt.NDArray[np.integer]) -> tuple[Long, Long]:
    """Faces (F, 4), -1 as a triangle's last corner, of which no quadrilateral has a dent, and the
    face (F,) that each is of.

    A dented one becomes two triangles. A dent is where the outline, seen along the face's mean
    normal, turns the other way; a quadrilateral that is bent has none.
    """
    quads = np.flatnonzero(faces[:, 3] >= 0)
    a, b, c, d = (points[faces[quads, k]] for k in range(4))
    at_b, at_c, at_d = np.cross(b - a, c - a), np.cross(c - b, d - b), np.cross(c - a, d - a)
    area = at_b + at_d
    size = np.einsum("ij,ij->i", area, area)
    # of the corners b and d, and c and a, between two of which a diagonal lies
    shares = np.stack([np.einsum("ij,ij->i", one, area) for one in (at_b, at_c)], axis=1)
    dented = np.minimum(shares, size[:, None] - shares) < -_FLAT * size[:, None]
    source = np.arange(len(faces))
    if not dented.any():
        return faces.astype(np.int64), source
    # a diagonal from a dent lies within; where both cross the outline, none is better
    one = dented.any(axis=1)
    cut, turned = faces[quads[one]], dented[one, 0] & ~dented[one, 1]
    cut = np.where(turned[:, None], np.roll(cut, -1, axis=1), cut)
    halves = np.concatenate([cut[:, [0, 1, 2]], cut[:, [0, 2, 3]]])
    whole = np.delete(faces, quads[one], axis=0)
    rows = np.concatenate([whole, np.column_stack([halves, np.full(len(halves), -1)])])
    source = np.concatenate([np.delete(source, quads[one]), np.tile(quads[one], 2)])
    order = np.argsort(source, kind="stable")
    return rows[order].astype(np.int64), source[order]


def cut_polygons(where: str, points: Float, corners: Long, sizes: Long) -> tuple[Long, Long]:
    """Polygons one after another as triangles and quadrilaterals without dents.

    Parameters
    ----------
    where : what they are of, for messages.
    points : (P, 3).
    corners : (C,) numbers of the points at all corners of all polygons.
    sizes : (F,) how many corners each has, at least 3.

    Returns
    -------
    rows : (R, 4) which of the C corners each is of, -1 as a triangle's last.
    source : (R,) the polygon that it is of.

    Raises
    ------
    InputError
        As `check_corners`.
    """
    check_corners(where, points, corners)
    first = np.cumsum(sizes) - sizes
    three, four = (np.flatnonzero(sizes == size) for size in (3, 4))
    halves, of_quad = cut_at_dents(points[corners], first[four][:, None] + np.arange(4))
    triangles = first[three][:, None] + np.arange(3)
    rows = [np.column_stack([triangles, np.full(len(three), -1)]), halves]
    source = [three, four[of_quad]]
    for polygon in np.flatnonzero(sizes > 4).tolist():
        entry = np.arange(first[polygon], first[polygon] + sizes[polygon])
        triangles = entry[_ears(points[corners[entry]])]
        rows.append(np.column_stack([triangles, np.full(len(triangles), -1)]))
        source.append(np.full(len(triangles), polygon))
    of_row = np.concatenate(source)
    order = np.argsort(of_row, kind="stable")
    return np.concatenate(rows)[order], of_row[order]


def _ears(points: Float) -> Long:
    """Triangles (n - 2, 3) of a polygon (n, 3), by cutting off ears (Meisters, "Polygons have
    ears", 1975): seen along the axis that is nearest to its normal, which bends no corner over."""
    relative = points - points[0]
    normal = np.cross(relative, np.roll(relative, -1, axis=0)).sum(axis=0)
    axis = int(np.argmax(np.abs(normal)))
    flat = relative[:, [(axis + 1) % 3, (axis + 2) % 3]]
    flat = flat if normal[axis] > 0.0 else flat[:, ::-1]
    left = np.arange(len(points))
    triangles = []
    while len(left) > 3:
        before, after = np.roll(left, 1), np.roll(left, -1)
        turn = _turn(flat[before], flat[left], flat[after])
        ears = (k for k in np.flatnonzero(turn > 0.0).tolist()
                if not _holds(flat[[before[k], left[k], after[k]]], flat[left]))  # fmt: skip
        ear = next(ears, int(np.argmax(turn)))  # one that crosses itself may have none
        triangles.append([before[ear], left[ear], after[ear]])
        left = np.delete(left, ear)
    return np.array([*triangles, left])


def _turn(a: Float, b: Float, c: Float) -> Float:
    """Twice the area (…) of triangles, above 0 for those counter-clockwise."""
    u, v = b - a, c - a
    turn: Float = u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]
    return turn


def _holds(triangle: Float, points: Float) -> bool:
    """Whether some of the points (n, 2) lie in it or on its sides, but not at its corners."""
    others = points[~(points[:, None] == triangle).all(axis=2).any(axis=1)]
    inside = np.ones(len(others), bool)
    for a, b in zip(triangle, np.roll(triangle, -1, axis=0), strict=True):
        inside &= _turn(a, b, others) >= 0.0
    return bool(inside.any())
