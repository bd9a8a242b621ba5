"""Receivers and faces of one surface that lie side by side as a lamp sees them.

On a bent sheet of small triangles those beside a receiver overlap the box around it, and so may
hide the lamp as far as `gpusim.optics.lamp_grid` tells. An edge of either that has one of them on
each side says that they don't (the separating axes of convex shapes). The area between an edge
and a point is linear in the lamp's point: at the four corners of its face it tells about all of
it, also where the two share corners.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.optics.corners import parts

__all__ = ["apart"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]
Places = tuple[Array, Array, Array]

TOUCH = 1e-9
"""Of a receiver's size, by which it may overlap a face from rounding."""


def apart(
    half: tuple[float, float], receivers: Places, box: Numbers, faces: Places, caster: Numbers
) -> Flags:
    """(n,) whether receivers ``box`` and faces ``caster`` (n,) lie side by side for a lamp with
    ``half`` its size; p, q and s (`gpusim.optics.lamp_view`) of the corners of ``receivers``
    (4, R), and of ``faces`` (F, 4)."""
    result = np.zeros(len(box), bool)
    sizes = np.ptp(receivers[0], axis=0) + np.ptp(receivers[1], axis=0)
    for part in parts(len(box)):
        one = [np.take(values, box[part], axis=1) for values in receivers]
        other = [np.ascontiguousarray(np.take(values, caster[part], axis=0).T) for values in faces]
        size = sizes[box[part]]
        left = np.arange(len(size))
        for turn in range(8):
            shapes = (one, other) if turn < 4 else (other, one)
            found = _parts(half, *shapes, turn % 4, size)
            result[part.start + left[found]] = True
            # fewer and fewer are left for the other edges
            rest = np.flatnonzero(~found)
            left, size = left[rest], size[rest]
            one, other = ([np.take(v, rest, axis=1) for v in shape] for shape in (one, other))
    return result


def _parts(
    half: tuple[float, float], own: list[Array], other: list[Array], k: int, size: Array
) -> Flags:
    """(n,) whether the ``k``-th edges of shapes have these on one side and the others on the other,
    seen from all of the lamp; p, q and s (4, n) of both."""
    start, end = k, (k + 1) % 4
    result = np.zeros(len(size), bool)
    left = np.arange(len(size))
    # which way round shapes go may differ; it is the same from all of the lamp where they part
    sides = [np.ones(len(size), bool), np.ones(len(size), bool)]
    corners = ((1, 1), (1, -1), (-1, 1), (-1, -1)) if any(half) else ((0, 0),)
    for across, along in corners:
        p, q = (
            [shape[axis] - sign * reach * shape[2] for shape in (own, other)]
            for axis, sign, reach in ((0, across, half[0]), (1, along, half[1]))
        )
        x, y = p[0][end] - p[0][start], q[0][end] - q[0][start]
        slack = TOUCH * size * (np.abs(x) + np.abs(y))
        known = slack > 0.0
        ends = []
        for u, v in zip(p, q, strict=True):
            height = x * (v - q[0][start]) - y * (u - p[0][start])
            ends.append((height.min(axis=0), height.max(axis=0)))
        (low, high), (other_low, other_high) = ends
        sides[0] &= known & (low >= -slack) & (other_high <= slack)
        sides[1] &= known & (high <= slack) & (other_low >= -slack)
        # most don't part from one corner: fewer are left for the others
        rest = np.flatnonzero(sides[0] | sides[1])
        if len(rest) < len(left):
            left, size = left[rest], size[rest]
            sides = [side[rest] for side in sides]
            own, other = ([np.take(v, rest, axis=1) for v in shape] for shape in (own, other))
    result[left] = True
    return result
