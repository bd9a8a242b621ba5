"""What lies behind an open sheet that cuts a surface: neither seen there nor lit alike.

A wall that stands in a floor parts it into two that see other surroundings, along a line that is no
edge of a mesh. What is interpolated on one side must not know of the other one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from gpusim.arrays.ragged import batches, expand
from gpusim.optics.geometry.interpenetration import pierced
from gpusim.optics.geometry.view import View
from gpusim.surface.surface import Surface

__all__ = ["Discontinuities"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

TOUCH = 1e-3
"""Of the size of triangles of sheets, by which these reach what they end at."""

NEAR = 0.02
"""Of the size of pieces, by which places before a sheet count as being on it: more than nodes are
moved by (`gpusim.optics.ambient.sky_visibility.INSIDE`)."""

TOGETHER = 1 << 18
"""Pieces and sheets that are looked at together."""


@dataclass(frozen=True, eq=False)
class Discontinuities:
    """Sections of triangles, in order: ``first`` (T + 1,) of each; their boxes ``low`` and ``high``
    (S, 3) relative to the eye, and the planes (S, 4) of what cuts there, the eye before them."""

    first: Numbers
    low: Array
    high: Array
    planes: Array

    @staticmethod
    def of(view: View, surfaces: Sequence[Surface], corners: Array) -> Discontinuities | None:
        """Of triangles with ``corners`` (T, 3, 3) relative to the eye; None where no open surface
        cuts another one."""
        open_ = np.array([not surface.topology.closed for surface in surfaces])
        if not open_.any() or not view.count or view.body[0] == view.body[-1]:
            return None
        number = np.searchsorted(view.body, np.arange(len(surfaces) + 1))
        bodies = []
        for (a, b), sheet in zip(pairwise(number), open_, strict=True):
            own, middle = corners[a:b], corners[a:b].mean(axis=1, keepdims=True)
            # what only stands on another one parts it as well
            bodies.append(middle + (1.0 + TOUCH) * (own - middle) if sheet else own)
        segments, pair = pierced(bodies)
        own = np.concatenate([pair[:, 0], pair[:, 1]])
        other = np.concatenate([pair[:, 1], pair[:, 0]])
        segments = np.concatenate([segments, segments])
        kept = np.flatnonzero(open_[view.body[other]])
        kept = kept[np.argsort(own[kept], kind="stable")]
        if not len(kept):
            return None
        a, b, c = np.moveaxis(corners[other[kept]], 1, 0)
        normal = np.cross(b - a, c - a)
        normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
        offset = -np.sum(normal * a, axis=1)
        planes = np.column_stack([normal, offset]) * np.where(offset < 0.0, -1.0, 1.0)[:, None]
        first = np.searchsorted(own[kept], np.arange(view.count + 1))
        return Discontinuities(
            first, segments[kept].min(axis=1), segments[kept].max(axis=1), planes
        )

    def behind(self, triangle: Numbers, at: Array) -> Flags:
        """(P, N) which places ``at`` (P, N, 3) in pieces of triangles (P,) are behind something
        that cuts the piece, or on it; none of pieces of which all are."""
        result = np.zeros(at.shape[:2], bool)
        count = np.diff(self.first)[triangle]
        some = np.flatnonzero(count)
        low, high = at[some].min(axis=1), at[some].max(axis=1)
        size = (high - low).max(axis=1)
        for part in batches(count[some], TOGETHER):
            row, step = expand(count[some[part]])
            row += part.start
            section = self.first[triangle[some[row]]] + step
            slack = (NEAR * size[row])[:, None]
            meets = (self.low[section] <= high[row] + slack).all(axis=1)
            meets &= (self.high[section] >= low[row] - slack).all(axis=1)
            row, section = row[meets], section[meets]
            plane = self.planes[section]
            height = np.einsum("na,nka->nk", plane[:, :3], at[some[row]]) + plane[:, 3:]
            np.logical_or.at(result, some[row], height <= NEAR * size[row][:, None])
        result[result.all(axis=1)] = False
        return result
