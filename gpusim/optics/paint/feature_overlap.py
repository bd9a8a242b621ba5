"""Whether features of a pattern keep apart, as their sum takes for granted."""

from __future__ import annotations

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import InputError
from gpusim.surface.features import Features


def refuse_overlap(features: Features, low: Float, high: Float) -> None:
    """Raises InputError if two features, whose boxes are ``low`` to ``high`` (F, 2), overlap.

    Those of higher layers may.
    """
    order = np.argsort(low[:, 0], kind="stable")
    if features.layer is not None:
        order = order[features.layer[order] == 0]
    low, high = low[order], high[order]
    shrink = 1e-9 * (high - low)
    low, high = low + shrink, high - shrink
    until = np.searchsorted(low[:, 0], high[:, 0])
    for i in np.flatnonzero(until > np.arange(len(low)) + 1):
        span = slice(i + 1, until[i])
        hit = (low[span, 1] < high[i, 1]) & (high[span, 1] > low[i, 1])
        for j in np.flatnonzero(hit) + i + 1:
            if _apart(features, int(order[i]), int(order[j])):
                continue
            raise InputError(
                f"paint features {order[i]} and {order[j]} overlap; got boxes around "
                f"{features.position[order[i]].tolist()} and {features.position[order[j]].tolist()}"
                "; expected features that keep apart"
            )


def _apart(features: Features, i: int, j: int) -> bool:
    """Whether two features whose boxes overlap don't (patches by separating axes).

    Sectors count as discs.
    """
    if features.kind[i] != 0:
        i, j = j, i
    slack = 1e-9 * float(max(features.size[i].max(), features.size[j].max()))
    if features.kind[i] != 0:
        gap = np.hypot(*(features.position[i] - features.position[j]))
        return bool(gap >= features.size[i, 0] + features.size[j, 0] - slack)
    if features.kind[j] != 0:
        relative = _turn(features.position[j] - features.position[i], -features.angle[i])
        outside = relative - np.clip(relative, 0.0, features.size[i] * features.squares[i])
        return bool(np.hypot(*outside) >= features.size[j, 0] - slack)
    corners = []
    for k in (i, j):
        extent = features.size[k] * features.squares[k]
        box = extent * np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
        corners.append(features.position[k] + _turn(box, features.angle[k]))
    for angle in (features.angle[i], features.angle[j]):
        a, b = (_turn(points, -angle) for points in corners)
        if (a.max(axis=0) <= b.min(axis=0) + slack).any():
            return True
        if (b.max(axis=0) <= a.min(axis=0) + slack).any():
            return True
    return False


def _turn(points: Float, angle: float) -> Float:
    """Points (…, 2) turned about the origin by ``angle``."""
    cos, sin = np.cos(angle), np.sin(angle)
    x, y = points[..., 0], points[..., 1]
    return np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)
