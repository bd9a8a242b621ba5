"""Triangles as a camera sees them, by the vertices that they share.

A vertex of a fine mesh is a corner of six triangles: what is found once per vertex takes a sixth of
the time and memory of what is found per corner. Corners that carry something else than their
neighbours' do (normals at a crease, another paint) have a vertex of their own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.optics.geometry.clipping import (
    CHORD,
    CHORD_INSIDE,
    MAX_BENT_EDGE,
    SURELY_SHORT,
    ClippedTriangles,
    ImagePlane,
    extent,
    twice_area,
    without_area,
)
from gpusim.optics.geometry.triangle_corners import CHUNK, at_corners
from gpusim.surface.frames import used_vertices


@dataclass(frozen=True, eq=False)
class IndexedTriangles:
    """``vertices`` (V, 11) carry what `gpusim.optics.geometry.view.View` says, at ``place`` (V, 2)
    px.

    ``corner`` (T, 3): vertices of the triangles; ``shows`` (T, 3): whether the edge from a corner
    to the next shows; ``source`` (T,): the triangle of the surface that each comes from.
    ``extent``: px, no box round a triangle has a longer side.
    """

    vertices: Float
    place: Float
    corner: Long
    shows: Bool
    source: Long
    extent: float

    @staticmethod
    def of(pieces: ClippedTriangles, place: Float) -> IndexedTriangles:
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

    def some(self, wanted: Bool, place: Float, extent: float) -> IndexedTriangles:
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

    def pieces(self, wanted: Bool) -> ClippedTriangles:
        """Those that are ``wanted`` (T,), corner by corner."""
        corner = self.corner if wanted.all() else self.corner[wanted]
        corners = at_corners(self.vertices, list(corner.T))
        return ClippedTriangles(corners, self.shows[wanted], self.source[wanted])


SHORT = 0.7
"""No edge of a triangle within a box of this side is longer than 1."""


def whole_triangles(
    triangles: IndexedTriangles, screen: ImagePlane, crossing: Bool
) -> tuple[IndexedTriangles, Bool]:
    """What is drawn as it is of triangles on the ideal image, at its place through the lens.

    ``crossing`` (n,): which have to be clipped. The flags (n,) tell which are done with: what isn't
    drawn of them is out of view.
    """
    # vertices behind the camera are those of triangles that are clipped
    ideal = place = np.where(np.isfinite(triangles.place), triangles.place, 0.0)
    bent = screen.camera.lens is not None
    limits = [SURELY_SHORT, SURELY_SHORT]
    if bent:
        place = np.empty((2, len(ideal))).T
        for first in range(0, len(ideal), CHUNK):
            place[first : first + CHUNK] = screen.bent(ideal[first : first + CHUNK])
        limits = [
            SHORT * min(np.sqrt(chord) * screen.straight, MAX_BENT_EDGE)
            for chord in (CHORD_INSIDE, CHORD)
        ]
    count = len(triangles.source)
    done, drawn, extent = np.empty(count, bool), np.empty(count, bool), 0.0
    for first in range(0, count, CHUNK):
        part = slice(first, first + CHUNK)
        corner = [triangles.corner[part, k] for k in range(3)]
        straight, through_lens = (
            [[np.take(at[:, axis], c, mode="clip") for c in corner] for axis in range(2)]
            for at in (ideal, place)
        )
        size = np.zeros(len(corner[0]))
        seen = ~without_area(*straight)
        for axis, (a, b, c) in enumerate(through_lens):
            low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
            np.maximum(size, high - low, out=size)
            if bent:
                seen &= (high > screen.image[0][axis]) & (low < screen.image[1][axis])
        if bent:
            seen &= twice_area(*straight) * twice_area(*through_lens) > 0.0
        done[part] = size <= np.where(triangles.shows[part].any(axis=1), limits[1], limits[0])
        done[part] &= ~crossing[part]
        drawn[part] = seen & done[part]
        extent = max(extent, float((size * drawn[part]).max()))
    return triangles.some(drawn, place, extent), done
