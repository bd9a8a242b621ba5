"""Whether a view is one layer: no pixel's centre lies in two of its triangles.

Where all triangles of an oriented mesh look the same way, a pixel's centre lies in as many of them
as the mesh's border winds round it. A border that winds once or not at all round every one is that
of a single layer, and nothing has to be found in front of anything else.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.arrays.ragged import expand
from gpusim.surface.topology import Topology

__all__ = ["FEWEST", "border_of", "one_layer", "sides_from", "snapped", "winds_once"]

Whole = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

FEWEST = 2000
"""Triangles from which on it is worth while to find out."""

STEPS = 256
"""Of a pixel, to which devices snap places (lib/raster/pixel_box.wgsl)."""

FIXED = 65536
"""Of a pixel, to which places are snapped before."""

CLOSE = 1e-3
"""Of a step, by which a crossing may be off from rounding."""


def one_layer(
    topology: Topology, front: Flags, keep: Flags, place: npt.NDArray[np.float64], rows: int
) -> bool:
    """Whether the triangles of a surface that are to ``keep`` (T,), of which some look to the
    ``front`` (T,), are one layer in an image of ``rows``; vertices at ``place`` (P, 2) px."""
    if not topology.oriented or not keep.any():
        return False
    whole = bool(keep.all())
    facing = front if whole else front[keep]
    if facing.any() and not facing.all():
        return False
    starts, ends = border_of(topology, None if whole else keep)
    return winds_once(snapped(place[np.stack([starts, ends], axis=1)]), rows)


def snapped(place: npt.NDArray[np.float64]) -> Whole:
    """Places, px, in the steps that devices snap them to."""
    at = np.rint(place * FIXED).astype(np.int64)
    return (at + FIXED // STEPS // 2) // (FIXED // STEPS)


def border_of(topology: Topology, keep: Flags | None) -> tuple[Whole, Whole]:
    """Vertices that sides without a neighbour begin and end at, of all triangles or of those to
    ``keep`` (T,)."""
    edge = np.flatnonzero(~topology.manifold)
    triangle = topology.first[edge]
    if keep is not None:
        # besides, an edge without one of its two triangles is one of those that aren't kept
        lost = np.zeros(len(topology.first), bool)
        lost[topology.edge[np.flatnonzero(~keep)]] = True
        edge = np.concatenate([edge, np.flatnonzero(lost & topology.manifold)])
        first, second = topology.first[edge], topology.second[edge]
        triangle = np.where(keep[first], first, second)
        alone = keep[triangle] & ~(keep[first] & keep[second] & topology.manifold[edge])
        edge, triangle = edge[alone], triangle[alone]
    return sides_from(topology, edge, triangle)


def sides_from(topology: Topology, edge: Whole, triangle: Whole) -> tuple[Whole, Whole]:
    """Vertices that edges (n,) begin and end at, the way round their triangles (n,)."""
    k = np.argmax(topology.edge[triangle] == edge[:, None], axis=1)
    return topology.triangles[triangle, k], topology.triangles[triangle, (k + 1) % 3]


def winds_once(segments: Whole, rows: int) -> bool:
    """Whether closed chains of segments (n, 2, 2), in steps of a pixel, wind once at most, and all
    the same way, round the centres of an image's pixels."""
    a, b = segments[:, 0], segments[:, 1]
    low, high = np.minimum(a[:, 1], b[:, 1]), np.maximum(a[:, 1], b[:, 1])
    # centres on a segment's upper end count as crossed, as rasterisers have it
    first = np.maximum(-(-low // STEPS), 0)
    stop = np.minimum(-(-high // STEPS), rows)
    segment, step = expand(np.maximum(stop - first, 0))
    row = first[segment] + step
    start, side = a[segment], (b - a)[segment]
    # only segments with a height have rows
    x = start[:, 0] + (STEPS * row - start[:, 1]) * side[:, 0] / side[:, 1]
    order = np.lexsort((x, row))
    x, row = x[order], row[order]
    winds = np.cumsum(np.sign(side[order, 1]))
    # between a crossing and the next one of the row, where that holds a centre
    holds = np.ceil((x[:-1] - CLOSE) / STEPS) <= np.floor((x[1:] + CLOSE) / STEPS)
    found = winds[:-1][holds & (row[1:] == row[:-1])]
    return bool(((found == 0) | (found == 1)).all() or ((found == 0) | (found == -1)).all())
