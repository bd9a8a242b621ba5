"""What a surface's triangles carry at their corners: places, normals, paint coordinates."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.optics.camera import Camera
from gpusim.optics.corners import NORMAL, POSITION, REFERENCE, ST
from gpusim.optics.outline import sharp_normals
from gpusim.surface.plane import PaintFrame
from gpusim.surface.surface import Surface

__all__ = ["corner_table", "turned_corners"]

Array = npt.NDArray[np.float64]


def turned_corners(
    triangles: npt.NDArray[np.int64], kept: npt.NDArray[np.int64], front: npt.NDArray[np.bool_]
) -> list[npt.NDArray[np.int64]]:
    """The vertices (n,) at each corner of triangles ``kept``; those that look away turned round."""
    corner = [np.take(triangles[:, k], kept) for k in range(3)]
    away = np.flatnonzero(~front[kept])
    corner[1][away], corner[2][away] = corner[2][away], corner[1][away]
    return corner


def corner_table(
    surface: Surface,
    points: Array,
    area: Array,
    smooth: tuple[Array, npt.NDArray[np.bool_]] | None,
    kept: npt.NDArray[np.int64],
    corner: list[npt.NDArray[np.int64]],
    front: npt.NDArray[np.bool_],
    camera: Camera,
) -> Array:
    """Corners (n, 3, 11) of the triangles ``kept``, whose vertices are ``corner``.

    A view of (3, 11, n), so that whatever passes over one column reads nothing else. ``area``
    (3, T): normals, by area. ``smooth``: what `gpusim.optics.outline.smooth_normals` found of them,
    if they are asked for.
    """
    triangles = surface.topology.triangles
    turned = ~front[kept]
    away = np.flatnonzero(turned)
    columns = np.empty((3, 11, len(kept)))
    columns[:, ST] = 0.0
    if smooth is None:
        columns[:, NORMAL] = 0.0
    table = np.moveaxis(columns, 2, 0)

    def fill(first: int, values: Array) -> None:
        """From values (n, V) at the vertices."""
        for axis, column in enumerate(values):
            column = np.ascontiguousarray(column)
            for k in range(3):
                np.take(column, corner[k], out=columns[k, first + axis], mode="clip")

    fill(POSITION.start, points.T)
    fill(REFERENCE.start, surface.rest.T)
    if smooth is not None:
        angle, to_world = surface.smooth_angle, camera.camera_from_world[:3, :3].T
        normal, sharp = smooth
        fill(NORMAL.start, to_world @ normal)
        if sharp.any():
            rows, k = np.nonzero(np.stack([sharp[c] for c in corner], axis=1))
            vertex = np.stack(corner, axis=1)[rows, k]
            own = sharp_normals(area, triangles, sharp, kept[rows], vertex, angle)
            table[rows, k, NORMAL] = own @ to_world.T
        if len(away):
            columns[:, NORMAL] *= np.where(turned, -1.0, 1.0)
    region = surface.regions[surface.topology.source[kept]] if surface.extents else kept
    for number in surface.extents:
        rows = np.flatnonzero(region == number)
        frame = surface.paint_frame(number)
        if len(rows) == len(kept) and isinstance(frame, PaintFrame):
            fill(ST.start, frame.coordinates(surface.rest).T)
            continue
        own = frame.of_triangles(surface.rest[triangles[kept[rows]]], kept[rows])
        own[turned[rows]] = own[turned[rows]][:, [0, 2, 1]]
        table[rows, :, ST] = own
    return table
