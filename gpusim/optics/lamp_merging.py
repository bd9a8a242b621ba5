"""Casters joined as one lamp sees them, for receivers on which its shadows are soft.

A receiver X sees an edge before the lamp's face at (p - p_X) / (s - s_X), see `lamp_view`: errors
of its p, q and s count by the difference in s between the two. What bends towards the lamp,
as a beam does that is pulled at, stays straight in its view. So rows of faces that no tolerance in
space would join become one, by the share of the lamp that this changes.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from gpusim.optics.casters import Casters, LampFaces
from gpusim.optics.lamp_grid import LampGrid
from gpusim.optics.lamp_view import LampView
from gpusim.optics.merging import merge_flat, neighbours

__all__ = ["FEWEST", "joined_grids"]

Numbers = npt.NDArray[np.int64]

SHARE = 5e-4
"""Of a lamp, by which what is seen of it may change; the lattice's step is four times that."""

FEWEST, WORTH = 100, 0.7
"""Faces that may hide a lamp, and the share left of them, which are worth another set."""


def joined_grids(
    grid: LampGrid, casters: Casters, faces: LampFaces, rises: list[float]
) -> list[tuple[Casters, LampGrid]]:
    """Sets of the casters ``faces`` that ``grid`` holds, with more and more of them joined.

    ``rises``: the least difference in s to receivers for which each is exact enough, ascending.
    """
    result = []
    for rise in rises:
        count = len(faces.face)
        if count < FEWEST:
            break
        own, joined = _joined(grid.view, casters, faces, SHARE * rise)
        if len(joined.face) < WORTH * count:
            casters, faces = own, joined
            result.append((own, LampGrid(grid.view, own, faces, grid.lowest, rise)))
    return result


def _joined(
    view: LampView, casters: Casters, faces: LampFaces, error: float
) -> tuple[Casters, LampFaces]:
    """The faces that may hide a lamp, joined where that moves their edges by no more than ``error``
    in s times the lamp's size."""
    p, q, s = view.place(*casters.points.T)
    points = np.stack([0.5 / view.half[0] * p, 0.5 / view.half[1] * q, 0.5 * s], axis=1)
    corners = casters.faces[faces.face]
    beside = neighbours(corners)[0]
    ahead = np.asarray(np.isfinite(p)[corners].all(axis=1))
    apart = ~ahead[:, None] | ~ahead[beside] | (faces.side[beside] != faces.side[:, None])
    beside[(beside >= 0) & apart] = -1
    tolerance = np.full(len(casters.points), error)
    merged = merge_flat(points, corners, tolerance, beside, plane=False)
    rim = np.zeros((len(merged.faces), 4), bool)
    face, place = np.nonzero(faces.rim & ~merged.inner)
    rim[merged.owner[face], place] = True
    member = faces.face[merged.member]
    edge, beside, ends = _outer(casters, faces.face, merged.owner)
    own = replace(
        casters,
        faces=merged.faces,
        normal=merged.total(casters.normal[faces.face]),
        both_sides=casters.both_sides[member],
        body=casters.body[member],
        edge=edge,
        beside=beside,
        ends=ends,
        into=np.full_like(casters.into, -1),
    )
    return own, LampFaces(np.arange(len(rim)), rim, faces.side[merged.member])


def _outer(casters: Casters, face: Numbers, owner: Numbers) -> tuple[Numbers, Numbers, Numbers]:
    """Of the edges of casters ``face`` (F,) those that aren't inside of what they are joined into,
    ``owner`` (F,): see `Casters`; nothing is told of what lies across others."""
    into = np.full(len(casters.faces) + 2, -1)
    into[face] = owner
    one, other = into[casters.edge[:, 0]], into[casters.beside]
    kept = np.flatnonzero((one >= 0) & (one != other) & (casters.beside != -2))
    # the k-th edges of what was joined lie on the k-th edge
    edge = np.column_stack([one[kept], casters.edge[kept, 1]])
    return edge, other[kept], casters.ends[kept]
