"""Edges of elements over a picture, where they are seen."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from gpusim.optics.frame import Frame
from gpusim.surface.surface import Surface

__all__ = ["visible_edges"]

PIECES = 4
"""Of an edge, each shown or not."""

SHORTEST = 3.0
"""px on average; shorter edges would fill the picture."""


def visible_edges(frame: Frame, surfaces: Sequence[Surface]) -> npt.NDArray[np.float64]:
    """Pieces (n, 2, 2) of the edges of all faces that a frame shows, in its pixel coordinates.

    A piece is seen if the pixel at its middle shows a face that it is an edge of.

    Examples
    --------
    >>> from gpusim.view.mesh_lines import visible_edges
    >>> wall = gs.Surface([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2, 3]])
    >>> camera = gs.Camera.from_lens((36, 24), 12, (60, 40), (0, 0, 2), (0, 0, 0), up=(0, 1, 0))
    >>> visible_edges(gs.render([wall], camera, backend="numpy"), [wall]).shape
    (16, 2, 2)
    """
    camera, view = frame.view.camera, frame.view
    ids = frame.ids()
    shown = np.full(ids.shape, -1, np.int64)
    shown[ids > 0] = view.face[ids[ids > 0].astype(np.int64) - 1]
    found = [np.zeros((0, 2, 2))]
    first = 0
    for surface in surfaces:
        ends, faces = _edges(surface.faces)
        faces = faces + first
        first += len(surface.faces)
        share = np.linspace(0.0, 1.0, 2 * PIECES + 1)[:, None, None]
        a, b = (surface.points[ends[:, k]] - view.origin for k in (0, 1))
        places = camera.project((1.0 - share) * a + share * b)
        length = np.linalg.norm(places[-1] - places[0], axis=1)
        some = length[np.isfinite(length)]
        if not len(some) or not some.mean() >= SHORTEST:
            continue
        for piece in range(PIECES):
            start, middle, stop = places[2 * piece : 2 * piece + 3]
            inside = np.isfinite(middle).all(axis=1)
            inside &= ((middle > -0.5) & (middle < np.array(ids.shape[::-1]) - 0.5)).all(axis=1)
            own = np.flatnonzero(inside)
            column, row = np.rint(middle[own]).astype(int).T
            own = own[(faces[own] == shown[row, column][:, None]).any(axis=1)]
            found.append(np.stack([start[own], stop[own]], axis=1))
    return np.concatenate(found)


def _edges(faces: npt.NDArray[np.int32]) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Ends (E, 2) of all edges, each once, and the faces (E, 2) at them (-1: none)."""
    following = np.roll(faces, -1, axis=1)
    triangle = faces[:, 3] < 0
    following[triangle, 2] = faces[triangle, 0]
    ends = np.stack([faces, following], axis=2).reshape(-1, 2).astype(np.int64)
    number = np.repeat(np.arange(len(faces)), 4)
    own = (ends >= 0).all(axis=1)
    ends, number = np.sort(ends[own], axis=1), number[own]
    order = np.lexsort((ends[:, 0], ends[:, 1]))
    ends, number = ends[order], number[order]
    new = np.r_[True, (ends[1:] != ends[:-1]).any(axis=1)]
    at = np.flatnonzero(new)
    stop = np.r_[at[1:], len(ends)]
    last = np.where(stop - at > 1, number[stop - 1], -1)
    return ends[at], np.stack([number[at], last], axis=1)
