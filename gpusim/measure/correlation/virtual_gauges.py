"""Virtual gauges: what an extensometer and a strain gauge would read, from displacements of a few
subsets."""

from __future__ import annotations

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.measure.correlation.strain import StrainKind, strain_of_tangents
from gpusim.validation import require, require_one_of, unmasked

_LEAST = 3
"""Subsets to which planes are fitted."""


@unmasked()
def extensometer(ends: Float, displacement: Float) -> tuple[float, float, float]:
    """Length between two ends now, how much it has grown, and the engineering strain (l - l0) / l0.

    Parameters
    ----------
    ends : (2, D), where the ends were, px or mm.
    displacement : (2, D), how far they went, in the same unit.

    Examples
    --------
    >>> gs.measure.extensometer(np.array([[10.0, 20], [60, 20]]), np.array([[0.0, 3], [1, 3]]))
    (51.0, 1.0, 0.02)
    """
    shapes = np.shape(ends), np.shape(displacement)
    require(shapes[0] == shapes[1] and len(shapes[0]) == 2 and shapes[0][0] == 2, "ends",
            f"shapes {shapes[0]} and {shapes[1]}", "ends and displacement (2, D)")  # fmt: skip
    before, change = ends[1] - ends[0], displacement[1] - displacement[0]
    start, now = np.linalg.norm(before), np.linalg.norm(before + change)
    # l^2 - l0^2 without the difference of large numbers
    longer = change @ (2.0 * before + change) / (now + start)
    return float(now), float(longer), float(longer / start)


@unmasked()
def gauge(
    pixels: Float, places: Float, displacement: Float, kind: StrainKind = "green-lagrange"
) -> Float:
    """Mean strain of a patch of a surface, (2, 2): planes are fitted to where its subsets were and
    to how far they went. x lies along the surface as the picture's rows do, y at right angles, on
    the side of the picture's y (down).

    Parameters
    ----------
    pixels : (N, 2) px, subsets in the reference picture.
    places, displacement : (N, 2), in the picture or on a plane, or (N, 3), in space; NaN where a
        subset was lost. NaN is returned if less than three are left, or they lie on a line.
    kind : "green-lagrange" or "hencky".

    Examples
    --------
    >>> pixels = np.array([[10.0, 10], [20, 10], [10, 20], [20, 20]])
    >>> gs.measure.gauge(pixels, pixels, pixels * [0.02, 0.0]).round(6) + 0.0
    array([[0.0202, 0.    ],
           [0.    , 0.    ]])
    """
    require_one_of("kind", kind, ("green-lagrange", "hencky"))
    shapes = [np.shape(one) for one in (pixels, places, displacement)]
    fits = shapes[0][1:] == (2,) and shapes[1] == shapes[2] and shapes[1][:1] == shapes[0][:1]
    require(fits and shapes[1][1:] in ((2,), (3,)), "gauge", f"shapes {shapes}",
            "pixels (N, 2), places and displacement (N, 2) or (N, 3)")  # fmt: skip
    known = np.isfinite(np.hstack([pixels, places, displacement])).all(axis=1)
    offset = pixels[known] - pixels[known].mean(axis=0) if known.any() else pixels[known]
    if known.sum() < _LEAST or np.linalg.matrix_rank(offset) < 2:
        return np.full((2, 2), np.nan)
    basis = np.column_stack([np.ones(len(offset)), offset])
    tangents = [
        np.linalg.lstsq(basis, np.pad(values[known], ((0, 0), (0, 3 - values.shape[1]))))[0][1:].T
        for values in (places, displacement)
    ]
    return np.asarray(strain_of_tangents(tangents[0][None], tangents[1][None], kind)[0][0])
