"""How much more the views of a calibration differ than by independent errors of their points.

A covariance from the residuals takes every point's error for its own. Where neighbours err alike (a
lens model that lacks a term, corners that share a bias, a board that isn't flat) parameters are
less certain than that says, as the pull of whole views on them shows: the clustered variance of
Liang and Zeger, "Longitudinal data analysis using generalized linear models", Biometrika 73 (1986),
here one factor for all parameters, since some ten views don't tell one for each.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gpusim.measure.images import FloatArray

__all__ = ["view_scatter"]


def view_scatter(
    normals: Sequence[FloatArray], gradients: Sequence[FloatArray], variance: float, own: int
) -> float:
    """Mean squared pull of the views on the parameters they share, over that of independent errors.

    Parameters
    ----------
    normals, gradients : per view (Q, Q) and (Q,), at the minimum; the last ``own`` parameters are
        the view's alone, the others are shared by all.
    variance : of a residual, px^2.
    """
    shared = []
    for normal, gradient in zip(normals, gradients, strict=True):
        rest, mine = slice(None, -own), slice(-own, None)
        right = np.column_stack([normal[mine, rest], gradient[mine]])
        taken = normal[rest, mine] @ np.linalg.pinv(normal[mine, mine], hermitian=True) @ right
        shared.append((normal[rest, rest] - taken[:, :-1], gradient[rest] - taken[:, -1]))
    total = np.sum([normal for normal, _ in shared], axis=0)
    scale = 1.0 / np.sqrt(np.maximum(np.diag(total), 1e-300))
    inverse = np.linalg.pinv(total * np.outer(scale, scale), hermitian=True) * np.outer(
        scale, scale
    )
    pull = sum(float(gradient @ inverse @ gradient) for _, gradient in shared)
    # the pulls add up to nothing, so that a view which tells most of a parameter pulls little
    parts = [inverse @ normal for normal, _ in shared]
    expected = variance * sum(float(np.trace(part - part @ part)) for part in parts)
    return pull / expected if expected > 0 else 1.0
