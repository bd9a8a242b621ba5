"""The sides of casters' outlines in a lamp's view, as lines."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["side_lines", "told_by"]

Array = npt.NDArray[np.float64]


def side_lines(p: Array, q: Array) -> list[tuple[Array, Array, Array]]:
    """Of each side of outlines with corners (n, 4): normal outwards in p and q, and its place.

    All normals of a face are 0 where it reaches behind the lamp, or its outline isn't convex.
    """
    start = np.stack([p, q], axis=2)
    way = np.roll(start, -1, axis=1) - start
    after = np.roll(way, -1, axis=1)
    turns = way[..., 0] * after[..., 1] - way[..., 1] * after[..., 0]
    sign = np.sign(turns.sum(axis=1))
    normal = sign[:, None, None] * np.stack([way[..., 1], -way[..., 0]], axis=2)
    convex = np.all(turns * sign[:, None] >= 0.0, axis=1)  # false for NaN
    sound = convex & np.all(np.isfinite(normal), axis=(1, 2))
    known = np.reshape(sound, (-1, 1, 1))
    start, normal = np.where(known, start, 0.0), np.where(known, normal, 0.0)
    place = np.sum(normal * start, axis=2)
    return [(normal[:, k, 0].copy(), normal[:, k, 1].copy(), place[:, k].copy()) for k in range(4)]


def told_by(lines: list[tuple[Array, Array, Array]]) -> npt.NDArray[np.bool_]:
    """(n,) of which `side_lines` tells something."""
    return np.asarray(np.any([(p != 0.0) | (q != 0.0) for p, q, _ in lines], axis=0))
