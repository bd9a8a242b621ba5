"""Triangles as a camera sees them, by the vertices that they share.

A vertex of a fine mesh is a corner of six triangles: what is found once per vertex takes a sixth of
the time and memory of what is found per corner. Corners that carry something else than their
neighbours' do (normals at a crease, another paint) have a vertex of their own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.optics.geometry.clipping import ClippedTriangles, extent
from gpusim.optics.geometry.triangle_corners import at_corners
from gpusim.surface.frames import used_vertices

__all__ = ["IndexedTriangles"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class IndexedTriangles:
    """``vertices`` (V, 11) carry what `gpusim.optics.geometry.view.View` says, at ``place`` (V, 2)
    px.

    ``corner`` (T, 3): vertices of the triangles; ``shows`` (T, 3): whether the edge from a corner
    to the next shows; ``source`` (T,): the triangle of the surface that each comes from.
    ``extent``: px, no box round a triangle has a longer side.
    """

    vertices: Array
    place: Array
    corner: Numbers
    shows: npt.NDArray[np.bool_]
    source: Numbers
    extent: float

    @staticmethod
    def of(pieces: ClippedTriangles, place: Array) -> IndexedTriangles:
        """Pieces at ``place`` (T, 3, 2) px, none of which share a corner."""
        count = len(pieces.source)
        columns = np.empty((pieces.corners.shape[2], 3 * count))
        at = np.empty((2, 3 * count))
        for k in range(3):
            columns[:, k * count : (k + 1) * count] = pieces.corners[:, k].T
            at[:, k * count : (k + 1) * count] = place[:, k].T
        corner = np.arange(3 * count).reshape(3, count).T
        return IndexedTriangles(columns.T, at.T, corner, pieces.shows, pieces.source, extent(place))

    @staticmethod
    def joined(parts: Sequence[IndexedTriangles]) -> IndexedTriangles:
        """Several in one, in order."""
        parts = [part for part in parts if len(part.source)] or list(parts[:1])
        if len(parts) == 1:
            return parts[0]
        before = np.cumsum([0, *(len(part.place) for part in parts)])
        return IndexedTriangles(
            np.concatenate([part.vertices.T for part in parts], axis=1).T,
            np.concatenate([part.place.T for part in parts], axis=1).T,
            np.concatenate(
                [part.corner.T + n for part, n in zip(parts, before, strict=False)], axis=1
            ).T,
            np.concatenate([part.shows for part in parts]),
            np.concatenate([part.source for part in parts]),
            max(part.extent for part in parts),
        )

    def some(self, wanted: npt.NDArray[np.bool_], place: Array, extent: float) -> IndexedTriangles:
        """The triangles that are ``wanted`` (T,), and their vertices, at ``place`` (V, 2) px."""
        if wanted.all():
            return IndexedTriangles(
                self.vertices, place, self.corner, self.shows, self.source, extent
            )
        corner = self.corner[wanted]
        used = used_vertices(corner, len(place))
        number = np.zeros(len(place), np.int64)
        number[used] = np.arange(len(used))
        return IndexedTriangles(
            self.vertices.T[:, used].T, place.T[:, used].T, number[corner.T].T,
            self.shows[wanted], self.source[wanted], extent,
        )  # fmt: skip

    def pieces(self, wanted: npt.NDArray[np.bool_]) -> ClippedTriangles:
        """Those that are ``wanted`` (T,), corner by corner."""
        corner = self.corner if wanted.all() else self.corner[wanted]
        corners = at_corners(self.vertices, list(corner.T))
        return ClippedTriangles(corners, self.shows[wanted], self.source[wanted])
