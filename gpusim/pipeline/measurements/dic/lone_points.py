"""Points that few others are near: whether they were found where they really are.

A subset may match in a wrong place by chance, where the right one is hard to find, as after a large
turn. Subsets beside it, which share no pixel with it, don't match there then.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import scipy

from gpusim import measure
from gpusim.arrays.array_types import Float, Long

NEAR, COMPANY = 3.0, 4
"""Subsets within which there are so many points, itself among them, of one that is lone."""
BESIDE = np.array([[x, y] for y in (-1, 0, 1) for x in (-1, 0, 1) if x or y], float)
"""Where subsets beside one are, in subsets."""
AGREED, LEAST = 0.25, 2
"""Subsets by which one may be away from where the point says, to agree; so many have to tell
something before that none agrees says anything. At the end of a thin beam one can, no more."""
SILENT = measure.Status.OUTSIDE, measure.Status.NO_TEXTURE, measure.Status.SATURATED


def without_chance_matches(
    found: measure.DicResult, match: Callable[..., measure.DicResult]
) -> measure.DicResult:
    """What was found, with lone points as ``LOW_CORRELATION`` that nothing beside them confirms,
    though there is something. ``match``: the same pictures at ``points``, from a ``guess``."""
    company = scipy.spatial.cKDTree(found.points).query_ball_point(
        found.points, NEAR * found.subset, return_length=True
    )
    lone = np.flatnonzero(found.ok & (company <= COMPANY))
    if not lone.size:
        return found
    offset = np.tile(found.subset * BESIDE, (len(lone), 1))
    guess = _carried(found, np.repeat(lone, len(BESIDE)), offset)
    seen = match(points=guess.points, guess=guess)
    away = np.linalg.norm(seen.displacement - guess.displacement, axis=1)
    agree, tell = (
        one.reshape(len(lone), -1).sum(axis=1)
        for one in (away <= AGREED * found.subset, ~np.isin(seen.status, SILENT))
    )
    lost = np.zeros(len(found.points), dtype=bool)
    lost[lone[(agree == 0) & (tell >= LEAST)]] = True
    gone: dict[str, Any] = {
        name: np.where(lost.reshape(-1, *[1] * (values.ndim - 1)), np.nan, values)
        for name in ("displacement", "gradient", "zncc", "sigma")
        for values in [getattr(found, name)]
    }
    status = np.where(lost, np.int8(measure.Status.LOW_CORRELATION), found.status)
    return replace(found, **gone, status=status)


def _carried(found: measure.DicResult, rows: Long, offset: Float) -> measure.DicResult:
    """What points (G,) of a result say of places an ``offset`` (G, 2) px away."""
    gradient = found.gradient[rows]
    moved = found.displacement[rows] + np.einsum("gij,gj->gi", gradient, offset)
    rest: dict[str, Any] = {
        name: getattr(found, name)[rows] for name in ("zncc", "sigma", "iterations", "status")
    }
    points = found.points[rows] + offset
    return replace(found, points=points, displacement=moved, gradient=gradient, **rest)
