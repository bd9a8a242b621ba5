"""Where two straight black-white borders cross: the model that markers and chessboards share.

Grey value of the pixel at d = (x - x0, y - y0)::

    I(d) = (1 + g . d) (m + c S(n1 . d, n1) S(n2 . d, n2))

S is the border profile -1..1: a step convolved with the pixel square seen along the border's
normal n (a trapezoid: two boxes of widths |n_x| and |n_y|) and with a Gaussian of width sigma (the
lens). The product of two such integrals is the integral of the product wherever only one border
crosses the pixel; the few pixels at the centre where both do are left out. The factor 1 + g . d
takes up an uneven light.

The nine parameters: x0, y0 (px), the angles of both borders (rad; the second is measured from +y),
m, c, g (1/px), and sigma^2 (px^2): a perfectly sharp image is fitted in as few steps as a blurred
one, since the grey values change in proportion to a variance even where it is small.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.measure.border import profile_and_slopes, slope_by_turn
from gpusim.measure.images import FloatArray
from gpusim.measure.levenberg import ManyFits, fit_many

Rows = npt.NDArray[np.int64]

__all__ = ["CENTRE", "PARAMETERS", "fit_junctions", "frames", "residual_and_slopes"]

PARAMETERS = 9
CENTRE = 1.5  # px: both borders within this distance: the pixel isn't used
MIN_VARIANCE, MOST_VARIANCE = 0.004**2, 60.0**2  # px^2
# as good as sharp, yet it rounds off the kink where a border lies between two columns of pixels:
# from far off, fits there take 10 steps, without any blur 60 to and fro
ROUNDING = 0.02**2
# sizes of a step that move a centre by about a pixel
SCALE = np.array([1.0, 1.0, 0.1, 0.1, 1.0, 1.0, 0.1, 0.1, 10.0])
TOLERANCE, ROUGH = 2e-5, 1e-3  # px; the last step is far longer than what is left to go
ITERATIONS = 40
POLISH = 5  # iterations without that


def frames(p: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Directions (C, 2) of both borders and their normals, of parameters (C, 9).

    The quadrant where both normals point is the white one.
    """
    along_1 = np.stack([np.cos(p[:, 2]), np.sin(p[:, 2])], axis=1)
    along_2 = np.stack([-np.sin(p[:, 3]), np.cos(p[:, 3])], axis=1)
    normal_1 = np.stack([-along_1[:, 1], along_1[:, 0]], axis=1)
    normal_2 = np.stack([along_2[:, 1], -along_2[:, 0]], axis=1)
    return along_1, along_2, normal_1, normal_2


def residual_and_slopes(
    p: FloatArray, x: FloatArray, y: FloatArray, grey: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Model less grey value (C, P) at pixels x, y, and its derivatives (C, 9, P)."""
    along_1, along_2, normal_1, normal_2 = frames(p)
    dx, dy = x - p[:, :1], y - p[:, 1:2]
    variance = np.clip(p[:, 8], MIN_VARIANCE, MOST_VARIANCE)
    first, second = (
        profile_and_slopes(dx * normal[:, :1] + dy * normal[:, 1:], normal, variance)
        for normal in (normal_1, normal_2)
    )
    light = 1.0 + p[:, 6:7] * dx + p[:, 7:8] * dy
    both = first[0] * second[0]
    pattern = p[:, 4:5] + p[:, 5:6] * both
    scale = p[:, 5:6] * light
    by_1, by_2 = scale * second[0], scale * first[0]
    slope_1, slope_2 = by_1 * first[1], by_2 * second[1]
    slopes = np.empty((len(p), PARAMETERS, x.shape[1]))
    for i in range(2):
        slopes[:, i] = (
            -slope_1 * normal_1[:, i : i + 1]
            - slope_2 * normal_2[:, i : i + 1]
            - p[:, 6 + i : 7 + i] * pattern
        )
    # turning a border takes normal_1 to -along_1, and normal_2 to along_2
    slopes[:, 2] = by_1 * slope_by_turn(first, normal_1, -along_1, dx, dy)
    slopes[:, 3] = by_2 * slope_by_turn(second, normal_2, along_2, dx, dy)
    slopes[:, 4] = light
    slopes[:, 5] = light * both
    slopes[:, 6] = dx * pattern
    slopes[:, 7] = dy * pattern
    slopes[:, 8] = by_1 * first[2] + by_2 * second[2]
    return light * pattern - grey, slopes


def fit_junctions(
    x: FloatArray,
    y: FloatArray,
    grey: FloatArray,
    weight: FloatArray,
    start: FloatArray,
    *,
    rough: bool = False,
) -> ManyFits:
    """Fit C junctions at once, from ``start`` (C, 9).

    ``x``, ``y``, ``grey``, ``weight`` (C, P): positions and grey values of the pixels, weight 0
    for those that don't count. ``rough`` fits are a start for another: right to a thousandth.
    """

    def fit(rows: Rows, first: FloatArray, least: float, tolerance: float, most: int) -> ManyFits:
        own = x[rows], y[rows], grey[rows]

        def model(p: FloatArray, which: Rows) -> tuple[FloatArray, FloatArray]:
            return residual_and_slopes(p, *(values[which] for values in own))

        lower = np.array([-np.inf] * 8 + [least])
        return fit_many(
            model, np.maximum(first, lower), weight[rows], SCALE,
            lower=lower, tolerance=tolerance, iterations=most,
        )  # fmt: skip

    found = fit(np.arange(len(start)), start, ROUNDING, ROUGH, ITERATIONS)
    if rough:
        return found
    sharp = found.parameters[:, 8] <= ROUNDING
    for rows, least, most in (
        (np.flatnonzero(~sharp), ROUNDING, ITERATIONS),
        (np.flatnonzero(sharp), MIN_VARIANCE, POLISH),
    ):
        if not rows.size:
            continue
        fine = fit(rows, found.parameters[rows], least, TOLERANCE, most)
        for name in ("parameters", "rms", "covariance"):
            getattr(found, name)[rows] = getattr(fine, name)
        if least == ROUNDING:
            found.converged[rows] &= fine.converged
    return found
