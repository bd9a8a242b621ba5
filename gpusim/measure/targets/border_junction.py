"""Straight black-white borders and where two of them cross: what markers and chessboards show.

A step seen through a Gaussian lens and integrated over the pixel's square, which a border at an
angle sees as a trapezoid: two boxes of widths |n_x| and |n_y| of the border's unit normal n. Two
box integrals of the Gaussian step are second differences of its second antiderivative; the profile
S of a border runs from -1 to 1. Of a crossing, the grey value of the pixel at d = (x - x0, y - y0)
is::

    I(d) = (1 + g . d) (m + c S(n1 . d, n1) S(n2 . d, n2))

The product of two such integrals is the integral of the product wherever only one border crosses
the pixel; the few pixels at the centre where both do are left out. The factor 1 + g . d takes up an
uneven light.

The nine parameters: x0, y0 (px), the angles of both borders (rad; the second is measured from +y),
m, c, g (1/px), and sigma^2 (px^2): a perfectly sharp image is fitted in as few steps as a blurred
one, since the grey values change in proportion to a variance even where it is small.
"""

from __future__ import annotations

import numpy as np
import scipy

from gpusim.arrays.array_types import Float, Long
from gpusim.measure.targets.levenberg_marquardt import ManyFits, fit_many

FLAT_SIGMAS = 7.0  # 1 - 1e-12 of the Gaussian step
MIN_BOX = 1e-3  # px, narrower sides of the pixel box are widened to this


PARAMETERS = 9
CENTRE = 1.5  # px: both borders within this distance: the pixel isn't used
MIN_VARIANCE, MAX_VARIANCE = 0.004**2, 60.0**2  # px^2
# as good as sharp, yet it rounds off the kink where a border lies between two columns of pixels:
# from far off, fits there take 10 steps, without any blur 60 to and fro
ROUNDING = 0.02**2
# sizes of a step that move a centre by about a pixel
SCALE = np.array([1.0, 1.0, 0.1, 0.1, 1.0, 1.0, 0.1, 0.1, 10.0])
TOLERANCE, ROUGH = 2e-5, 1e-3  # px; the last step is far longer than what is left to go
ITERATIONS = 40
POLISH = 5  # iterations without that


def profile_and_slopes(distance: Float, normal: Float, variance: Float | float) -> Float:
    """The profile -1..1 and its derivatives by the distance, the variance, |normal_x|, |normal_y|:
    (5, B, P).

    ``distance`` (B, P) in px from each of B borders to the pixel centres, ``normal`` (B, 2) its
    unit normal, ``variance`` (B,) of the blur in px^2, above 0. The variance, not sigma: a profile
    changes with it in proportion even where it is small.
    """
    sides = np.maximum(np.abs(normal), MIN_BOX)
    sigma = np.broadcast_to(np.sqrt(variance), len(normal))
    half = 0.5 * (sides[:, 0] + sides[:, 1]), 0.5 * (sides[:, 0] - sides[:, 1])
    # further away the profile is flat to the last digits
    near = np.flatnonzero(np.abs(distance) < (half[0] + FLAT_SIGMAS * sigma)[:, None])
    border = near // distance.shape[1]
    offset = np.stack([half[0], half[1], -half[1], -half[0]])
    z = distance.ravel()[near] + offset[:, border]
    blur = sigma[border]
    q = z / blur
    step = scipy.special.ndtr(q)
    density = np.exp(-0.5 * q * q) * (blur / np.sqrt(2 * np.pi))
    # antiderivatives of the step; the second one is z^2/2 for z >> sigma, 0 for z << -sigma
    once = z * step + density
    twice = z * once + blur * blur * step
    wide, narrow = sides[border].T
    area = wide * narrow
    # sums over the four ends of the trapezoid, halved in ``twice``
    inner, outer = once[1] + once[2], once[0] + once[3]
    across, along = once[0] - once[3], once[1] - once[2]
    total = 0.5 * (twice[0] - twice[1] - twice[2] + twice[3])
    profile = np.zeros((5, *distance.shape))
    np.sign(distance, out=profile[0])
    profile.reshape(5, -1)[:, near] = (
        2.0 * total / area - 1.0,
        2.0 * (outer - inner) / area,
        (step[0] - step[1] - step[2] + step[3]) / area,
        (across - along - 2.0 * total / wide) / area,
        (across + along - 2.0 * total / narrow) / area,
    )
    return profile


def slope_by_turn(
    profile: Float,
    normal: Float,
    change: Float,
    dx: Float,
    dy: Float,
) -> Float:
    """Derivative of a border profile by its angle; ``change`` (B, 2) is that of the ``normal``."""
    _, by_distance, _, by_wide, by_narrow = profile
    # of the pixel box's sides, where they aren't held at their least width
    box = np.sign(normal) * change * (np.abs(normal) > MIN_BOX)
    result: Float = (
        by_distance * (dx * change[:, :1] + dy * change[:, 1:])
        + by_wide * box[:, :1]
        + by_narrow * box[:, 1:]
    )
    return result


def frames(p: Float) -> tuple[Float, Float, Float, Float]:
    """Directions (C, 2) of both borders and their normals, of parameters (C, 9).

    The quadrant where both normals point is the white one.
    """
    along_1 = np.stack([np.cos(p[:, 2]), np.sin(p[:, 2])], axis=1)
    along_2 = np.stack([-np.sin(p[:, 3]), np.cos(p[:, 3])], axis=1)
    normal_1 = np.stack([-along_1[:, 1], along_1[:, 0]], axis=1)
    normal_2 = np.stack([along_2[:, 1], -along_2[:, 0]], axis=1)
    return along_1, along_2, normal_1, normal_2


def residual_and_slopes(p: Float, x: Float, y: Float, grey: Float) -> tuple[Float, Float]:
    """Model less grey value (C, P) at pixels x, y, and its derivatives (C, 9, P)."""
    along_1, along_2, normal_1, normal_2 = frames(p)
    dx, dy = x - p[:, :1], y - p[:, 1:2]
    variance = np.clip(p[:, 8], MIN_VARIANCE, MAX_VARIANCE)
    first, second = (
        profile_and_slopes(dx * normal[:, :1] + dy * normal[:, 1:], normal, variance)
        for normal in (normal_1, normal_2)
    )
    light = p[:, 6:7] * dx + p[:, 7:8] * dy + 1.0
    both = first[0] * second[0]
    pattern = p[:, 4:5] + p[:, 5:6] * both
    by_first, by_second = (p[:, 5:6] * light * other[0] for other in (second, first))
    moved_1, moved_2 = by_first * first[1], by_second * second[1]
    # turning a border takes normal_1 to -along_1, and normal_2 to along_2
    slopes = [
        -p[:, 6:7] * pattern - moved_1 * normal_1[:, :1] - moved_2 * normal_2[:, :1],
        -p[:, 7:8] * pattern - moved_1 * normal_1[:, 1:] - moved_2 * normal_2[:, 1:],
        by_first * slope_by_turn(first, normal_1, -along_1, dx, dy),
        by_second * slope_by_turn(second, normal_2, along_2, dx, dy),
        light,
        light * both,
        dx * pattern,
        dy * pattern,
        by_first * first[2] + by_second * second[2],
    ]
    return light * pattern - grey, np.stack(slopes, axis=1)


def fit_junctions(
    x: Float,
    y: Float,
    grey: Float,
    weight: Float,
    start: Float,
    *,
    rough: bool = False,
) -> ManyFits:
    """Fit C junctions at once, from ``start`` (C, 9).

    ``x``, ``y``, ``grey``, ``weight`` (C, P): positions and grey values of the pixels, weight 0
    for those that don't count. ``rough`` fits are a start for another: right to a thousandth.
    """

    def fit(rows: Long, first: Float, least: float, tolerance: float, most: int) -> ManyFits:
        def model(p: Float, which: Long) -> tuple[Float, Float]:
            own = rows[which]
            return residual_and_slopes(p, x[own], y[own], grey[own])

        lower = np.array([-np.inf] * 8 + [least])
        return fit_many(
            model, np.maximum(first, lower), weight[rows], SCALE,
            lower=lower, tolerance=tolerance, iterations=most,
        )  # fmt: skip

    junctions = fit(np.arange(len(start)), start, ROUNDING, ROUGH, ITERATIONS)
    if rough:
        return junctions
    sharp = junctions.parameters[:, 8] <= ROUNDING
    for rows, least, most in (
        (np.flatnonzero(~sharp), ROUNDING, ITERATIONS),
        (np.flatnonzero(sharp), MIN_VARIANCE, POLISH),
    ):
        if not rows.size:
            continue
        fine = fit(rows, junctions.parameters[rows], least, TOLERANCE, most)
        for name in ("parameters", "rms", "covariance"):
            getattr(junctions, name)[rows] = getattr(fine, name)
        if least == ROUNDING:
            junctions.converged[rows] &= fine.converged
    return junctions
