"""Shape functions: how the pixels of one subset move.

A warp maps the local position s = (a, b), the offset from the subset's point divided by the half
width h of the subset (so s lies in about [-1, 1]^2), to a displacement in pixels::

    displacement_i(s) = c_i0 + c_i1 a + c_i2 b + c_i3 a^2/2 + c_i4 a b + c_i5 b^2/2

Every coefficient is in pixels, which keeps the normal equations well scaled. The four shapes use
the first 1, 3, 3 or 6 coefficients; a rigid warp ties its linear ones to one rotation.
"""

from __future__ import annotations

from typing import get_args

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.choices import Shape as Shape

SHAPES: tuple[Shape, ...] = get_args(Shape)
COEFFICIENTS: dict[Shape, int] = {"translation": 1, "rigid": 3, "affine": 3, "quadratic": 6}
UNKNOWNS: dict[Shape, int] = {"translation": 2, "rigid": 3, "affine": 6, "quadratic": 12}


def basis(a: Float, b: Float, count: int) -> Float:
    """The first ``count`` basis functions (count, ...) at local positions ``a``, ``b``."""
    terms = [np.ones_like(a), a, b, 0.5 * a * a, a * b, 0.5 * b * b]
    return np.stack(terms[:count])


def steepest_descent(shape: Shape, by_x: Float, by_y: Float, a: Float, b: Float) -> Float:
    """Change of the grey value by each unknown, (unknowns, ...), grey levels per pixel."""
    if shape == "rigid":
        return np.stack([by_x, by_y, by_y * a - by_x * b])
    terms = basis(a, b, COEFFICIENTS[shape])
    return np.concatenate([by_x * terms, by_y * terms])


def step_coefficients(shape: Shape, step: Float) -> Float:
    """Spread a step of the unknowns (B, unknowns) over the warp coefficients (B, 2, 6)."""
    result = np.zeros((step.shape[0], 2, 6))
    if shape == "rigid":
        result[:, 0, 0] = step[:, 0]
        result[:, 1, 0] = step[:, 1]
        result[:, 0, 2] = -step[:, 2]
        result[:, 1, 1] = step[:, 2]
        return result
    count = COEFFICIENTS[shape]
    result[:, :, :count] = step.reshape(-1, 2, count)
    return result


def compose_inverse(shape: Shape, c: Float, step: Float, half: float) -> Float:
    """The warp ``c`` after the inverse of the small warp ``step`` (both (B, 2, 6)).

    c(x - step(x)) to first order in the step, cut after the second-order terms: exact once the
    step has gone to zero, which is where the iteration stops. A rigid warp is put back on the
    rotations afterwards.
    """
    result = c - step
    for j, (linear, first, second) in enumerate(((1, 3, 4), (2, 4, 5))):
        l0 = c[:, :, linear] / half
        l1 = c[:, :, first] / half
        l2 = c[:, :, second] / half
        d = step[:, j, :, None].transpose(1, 0, 2)  # (6, B, 1): the same for both components
        result[:, :, 0] -= l0 * d[0]
        result[:, :, 1] -= l0 * d[1] + l1 * d[0]
        result[:, :, 2] -= l0 * d[2] + l2 * d[0]
        result[:, :, 3] -= l0 * d[3] + 2.0 * l1 * d[1]
        result[:, :, 4] -= l0 * d[4] + l1 * d[2] + l2 * d[1]
        result[:, :, 5] -= l0 * d[5] + 2.0 * l2 * d[2]
    if shape == "rigid":
        return nearest_rotation(result, half)
    result[:, :, COEFFICIENTS[shape] :] = 0.0
    return result


def nearest_rotation(c: Float, half: float) -> Float:
    """Replace the linear part of each warp (B, 2, 6) by the rotation nearest to it."""
    cosine = 2.0 * half + c[:, 0, 1] + c[:, 1, 2]
    sine = c[:, 1, 1] - c[:, 0, 2]
    length = np.hypot(cosine, sine)
    result = np.zeros_like(c)
    result[:, :, 0] = c[:, :, 0]
    # 1 - cos from the sine: no cancellation at small angles
    shrink = -half * sine**2 / (length * (length + cosine))
    result[:, 0, 1] = shrink
    result[:, 1, 2] = shrink
    result[:, 0, 2] = -half * sine / length
    result[:, 1, 1] = half * sine / length
    return result
