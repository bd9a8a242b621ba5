"""Pixels that one sheet of triangles covers whole: none of its triangles hides another there.

A sheet ends at borders and outlines alone. Where none of these passes through a pixel, every sheet
over it covers all of it, and the pixel's centre lies in one triangle of each. On fine meshes that
is so for most pixels along borders of paint: nothing has to be sorted there, and no pair of
triangles tested.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.optics.geometry.view import View

__all__ = ["centred", "outlines"]

Numbers = npt.NDArray[np.int64]


def outlines(view: View) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
    """Which edges of a view may be a sheet's end, and which have been listed before, (E,) each.

    Those that are no end have a triangle on either side, which goes along them the other way: the
    two don't overlap in the image.
    """
    triangle, k = view.edge_source.T
    start, end = view.corner[triangle, k], view.corner[triangle, (k + 1) % 3]
    ends = ~_paired(start, end)
    again = ~ends & (start > end)
    # triangles that have been cut don't share vertices, but these lie in the same places
    left = np.flatnonzero(ends)
    at = np.concatenate([start[left], end[left]])
    few = view.table.some(at)
    number = _numbered([*few.place.T, few.position[:, 2]])
    start, end = number[: len(left)], number[len(left) :]
    ends[left] = ~_paired(start, end)
    again[left] = ~ends[left] & (start > end)
    return ends, again


def _paired(start: Numbers, end: Numbers) -> npt.NDArray[np.bool_]:
    """(E,): whether exactly one other edge lies between the same vertices, the other way round."""
    low, high = np.minimum(start, end), np.maximum(start, end)
    key = low * (int(high.max(initial=0)) + 1) + high
    order = np.argsort(key, kind="stable")
    key, forward = key[order], (start < end)[order]
    same = np.zeros(len(key) + 1, bool)
    same[1:-1] = key[1:] == key[:-1]
    # no edge before the first one of the two, nor after the second
    two = np.flatnonzero(same[1:-1] & ~same[:-2] & ~same[2:])
    two = two[forward[two] != forward[two + 1]]
    result = np.zeros(len(key), bool)
    result[order[two]] = result[order[two + 1]] = True
    return result


def _numbered(columns: list[npt.NDArray[np.float64]]) -> Numbers:
    """(n,): equal numbers where all ``columns`` (n,) are equal."""
    order = np.lexsort(columns)
    new = np.zeros(len(order), bool)
    for column in columns:
        new[1:] |= column[order[1:]] != column[order[:-1]]
    result = np.empty(len(order), np.int64)
    result[order] = np.cumsum(new)
    return result


def centred(corners: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
    """(n,): in which of triangles (n, 3, 2) the origin lies, or on whose sides.

    Rounding leaves no gap between neighbours: both find the same numbers of their common side.
    """
    x, y = np.asfortranarray(corners).T
    sides = [x[i] * y[j] - y[i] * x[j] for i, j in ((1, 2), (2, 0), (0, 1))]
    low = np.minimum(np.minimum(sides[0], sides[1]), sides[2])
    high = np.maximum(np.maximum(sides[0], sides[1]), sides[2])
    result: npt.NDArray[np.bool_] = (low >= 0.0) | (high <= 0.0)
    return result
