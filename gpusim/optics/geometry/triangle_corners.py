"""Arrays over the corners of triangles, a few thousand at a time or a column after another.

Passes over whole columns of large arrays, or along short axes of them, cost many times more than
the arithmetic.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gpusim.arrays.array_types import Float, Long
from gpusim.errors import InputError
from gpusim.optics.camera.pinhole import Camera

POSITION, ST, NORMAL, REFERENCE = slice(0, 3), slice(3, 5), slice(5, 8), slice(8, 11)
"""Columns of the attribute table that travels through clipping and splitting."""

CHUNK = 1 << 14
"""Triangles worked on at a time, so that they stay in the processor's cache."""


def parts(count: int) -> Iterator[slice]:
    """`CHUNK` at a time of so many."""
    for first in range(0, count, CHUNK):
        yield slice(first, min(first + CHUNK, count))


def in_camera(camera: Camera, points: Float) -> Float:
    """World points (n, 3) in camera coordinates, a view of (3, n): no matrix product, whose
    rounding depends on where in the array a point is."""
    T = camera.camera_from_world
    columns = np.empty((3, len(points)))
    for part in parts(len(points)):
        x, y, z = (np.ascontiguousarray(points[part, k]) for k in range(3))
        for k, column in enumerate(columns[:, part]):
            np.multiply(x, T[k, 0], out=column)
            column += T[k, 1] * y
            column += T[k, 2] * z
            column += T[k, 3]
    return columns.T


def at_corners(values: Float, corner: list[Long]) -> Float:
    """Values (P, V) at the corners of triangles: (n, 3, V), a view of (3, V, n)."""
    columns = np.empty((3, values.shape[1], len(corner[0])))
    for axis in range(values.shape[1]):
        column = np.ascontiguousarray(values[:, axis])
        for k in range(3):
            np.take(column, corner[k], out=columns[k, axis], mode="clip")
    return np.moveaxis(columns, 2, 0)


def barycentric_planes(corners: Float, camera: Camera) -> Float:
    """(T, 3, 3): row i holds the coefficients of b_i as an affine function of [x, y, 1]."""
    planes, D = np.empty((3, 3, len(corners))), camera.ray_matrix()
    for part in parts(len(corners)):
        a, b, c = (corners[part, k, POSITION].T for k in range(3))
        normals = [_cross(b, c), _cross(c, a), _cross(a, b)]
        volume = products(a, normals[0])
        if not np.all(volume != 0.0):
            raise InputError("a triangle is seen exactly edge-on; it should have been dropped")
        scale = 1.0 / volume
        for rows, (x, y, z) in zip(planes, normals, strict=True):
            # the ray matrix is upper triangular
            rows[0, part] = x * D[0, 0] * scale
            rows[1, part] = (x * D[0, 1] + y * D[1, 1]) * scale
            rows[2, part] = (x * D[0, 2] + y * D[1, 2] + z * D[2, 2]) * scale
    return np.moveaxis(planes, 2, 0)


def _cross(u: Float, v: Float) -> list[Float]:
    """Components (n,) of the cross products of vectors (3, n)."""
    return [u[i] * v[j] - u[j] * v[i] for i, j in ((1, 2), (2, 0), (0, 1))]


def products(vectors: Float, others: Float | list[Float]) -> Float:
    """Scalar products (n,) of vectors (3, n) with one (3,) or as many (3, n)."""
    result: Float = vectors[0] * others[0] + vectors[1] * others[1] + vectors[2] * others[2]
    return result


def corner_mean(values: Float) -> Float:
    """Mean over the corners of (T, 3, …); NumPy's own is slow along so short an axis."""
    result: Float = (values[:, 0] + values[:, 1] + values[:, 2]) / 3.0
    return result


def corner_range(values: Float) -> tuple[Float, Float]:
    """Lowest and highest over the corners of (T, 3, …)."""
    a, b, c = values[:, 0], values[:, 1], values[:, 2]
    return np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
