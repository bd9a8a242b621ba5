"""Fit two crossing black-white borders, each integrated exactly over the square pixel.

Grey value of the pixel at d = (x - x0, y - y0)::

    I(d) = (1 + g . d) (m + c S(n1 . d, n1) S(n2 . d, n2))

S is the border profile -1..1: a step convolved with the pixel square seen along the border's
normal n (a trapezoid: two boxes of widths |n_x| and |n_y|) and with a Gaussian of width sigma (the
lens). The product of two such integrals is the integral of the product wherever only one border
crosses the pixel; the few pixels at the centre where both do are left out. The factor 1 + g . d
takes up an uneven light.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import ndimage
from scipy.optimize import least_squares

from gpusim.measure.border import profile_and_slopes, slope_by_turn
from gpusim.measure.images import FloatArray

__all__ = ["Cross", "border_profile", "fit_cross"]

SAMPLES = 64  # on the ring that gives the first angle
CENTRE = 1.5  # px: both borders within this distance: the pixel isn't used
END_MARGIN = 1.2  # px kept from the marker's own border: half a pixel's diagonal and a bit …
END_SIGMAS = 2.5  # … and the reach of the lens blur
MIN_REACH = 3.0  # px from the centre, so that small markers keep enough pixels
MIN_SIGMA, MOST_SIGMA = 0.004, 100.0  # px
COARSE, FINE = 1e-4, 1e-8  # relative step at which a fit ends


@dataclass(frozen=True)
class Cross:
    """Centre x, y (px), angle (rad), contrast and residual as in ``Markers``, size (2) in px."""

    x: float
    y: float
    angle: float
    contrast: float
    residual: float
    size: tuple[float, float]


def border_profile(distance: FloatArray, normal: FloatArray, sigma: float) -> FloatArray:
    """Mean over the pixel of sign(signed distance to a straight border), -1..1.

    ``distance`` in px at the pixel centres, ``normal`` the unit normal (2,), ``sigma`` the
    Gaussian blur in px.
    """
    return profile_and_slopes(distance, normal, sigma)[0]


def fit_cross(
    grey: npt.NDArray[np.float32], pixel: tuple[int, int], low: float, high: float
) -> Cross | None:
    """Fit the marker whose centre is near ``pixel`` = (x, y), of width ``low`` to ``high`` px.

    Returns None if no cross of that size is there. Fitted twice: in the inner part first, which
    gives the borders' ends, then as far out as the marker goes.
    """
    column, row = pixel
    reach = int(np.ceil(0.75 * high)) + 3
    x0, y0 = max(column - reach, 0), max(row - reach, 0)
    patch = grey[y0 : row + reach + 1, x0 : column + reach + 1].astype(np.float64)
    start = np.array([column - x0, row - y0], dtype=np.float64)
    angle, contrast = _first_angle(patch, start, 0.27 * low)
    level = float(patch[_near(patch, start, 0.35 * low)].mean())
    first = np.array([*start, angle, angle, level, contrast, 0.0, 0.0, 0.3])
    inner = max(MIN_REACH, 0.5 * low - END_MARGIN)
    coarse = _fit(patch, first, (inner, inner), COARSE)
    if coarse is None:
        return None
    ends = _ends(patch, coarse, low, high)
    if ends is None:
        return None
    margin = (END_MARGIN + END_SIGMAS * abs(float(coarse[8]))) / np.cos(coarse[2] - coarse[3])
    reach_1 = max(MIN_REACH, min(ends[0:2]) - margin)
    reach_2 = max(MIN_REACH, min(ends[2:4]) - margin)
    fine = _fit(patch, coarse, (reach_1, reach_2), FINE)
    if fine is None or np.hypot(*(fine[:2] - start)) > max(2.0, 0.2 * low):
        return None
    usable = _region(patch, fine, (reach_1, reach_2))
    rms = float(np.sqrt(np.mean(_residual(fine, usable)[0] ** 2)))
    return Cross(
        float(fine[0] + x0),
        float(fine[1] + y0),
        float(0.5 * (fine[2] + fine[3])),
        float(fine[5]),
        rms / abs(float(fine[5])),
        (ends[0] + ends[1], ends[2] + ends[3]),
    )


def _near(patch: FloatArray, centre: FloatArray, radius: float) -> npt.NDArray[np.bool_]:
    y, x = np.indices(patch.shape)
    return np.asarray(np.hypot(x - centre[0], y - centre[1]) <= radius)


def _first_angle(patch: FloatArray, centre: FloatArray, radius: float) -> tuple[float, float]:
    """Angle of the border nearest to +x and the signed contrast, from a ring's 2nd harmonic."""
    turn = np.arange(SAMPLES) * (2 * np.pi / SAMPLES)
    where = [centre[1] + radius * np.sin(turn), centre[0] + radius * np.cos(turn)]
    ring = ndimage.map_coordinates(patch, where, order=1, mode="nearest")
    harmonic = np.sum(ring * np.exp(-2j * turn)) / SAMPLES
    # c sin(2 (turn - angle)) has the harmonic c exp(-2i angle) / 2i; the square wave has 4/pi more
    angle = -0.5 * (np.angle(harmonic) + 0.5 * np.pi)
    contrast = 2.0 * abs(harmonic) * np.pi / 4.0
    turns = round(angle / (0.5 * np.pi))
    return float(angle - turns * 0.5 * np.pi), float(contrast if turns % 2 == 0 else -contrast)


def _frame(p: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Directions of both borders and their normals; quadrant n1 > 0, n2 > 0 is the white one."""
    along_1 = np.array([np.cos(p[2]), np.sin(p[2])])
    along_2 = np.array([-np.sin(p[3]), np.cos(p[3])])
    normal_1 = np.array([-along_1[1], along_1[0]])
    normal_2 = np.array([along_2[1], -along_2[0]])
    return along_1, along_2, normal_1, normal_2


def _region(
    patch: FloatArray, p: FloatArray, reach: tuple[float, float]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Pixels (x, y) and grey values inside the marker, without those at the crossing."""
    grid = np.indices(patch.shape).astype(np.float64)
    y, x = grid[0], grid[1]
    along_1, along_2, normal_1, normal_2 = _frame(p)
    dx, dy = x - p[0], y - p[1]
    # how far along both borders: a marker seen at an angle is a parallelogram
    sine = along_1[0] * along_2[1] - along_1[1] * along_2[0]
    far_1 = np.abs(dx * normal_2[0] + dy * normal_2[1]) / sine
    far_2 = np.abs(dx * normal_1[0] + dy * normal_1[1]) / sine
    use = (far_1 <= reach[0]) & (far_2 <= reach[1])
    off_1 = np.abs(dx * normal_1[0] + dy * normal_1[1])
    off_2 = np.abs(dx * normal_2[0] + dy * normal_2[1])
    use &= ~((off_1 < CENTRE) & (off_2 < CENTRE))
    return x[use], y[use], patch[use]


def _residual(
    p: FloatArray, region: tuple[FloatArray, FloatArray, FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Model less grey value (n,), and its derivatives by the nine parameters (n, 9)."""
    x, y, grey = region
    along_1, along_2, normal_1, normal_2 = _frame(p)
    dx, dy = x - p[0], y - p[1]
    sigma = float(np.clip(abs(p[8]), MIN_SIGMA, MOST_SIGMA))
    first, second = (
        profile_and_slopes(dx * normal[0] + dy * normal[1], normal, sigma)
        for normal in (normal_1, normal_2)
    )
    light = 1.0 + p[6] * dx + p[7] * dy
    pattern = p[4] + p[5] * first[0] * second[0]
    scale = p[5] * light
    by_1, by_2 = scale * second[0], scale * first[0]
    jacobian = np.empty((9, x.size))
    for i in range(2):
        jacobian[i] = (
            -by_1 * first[1] * normal_1[i] - by_2 * second[1] * normal_2[i] - p[6 + i] * pattern
        )
    # turning a border takes normal_1 to -along_1, and normal_2 to along_2
    jacobian[2] = by_1 * slope_by_turn(first, normal_1, -along_1, dx, dy)
    jacobian[3] = by_2 * slope_by_turn(second, normal_2, along_2, dx, dy)
    jacobian[4] = light
    jacobian[5] = light * first[0] * second[0]
    jacobian[6] = dx * pattern
    jacobian[7] = dy * pattern
    by_sigma = by_1 * first[2] + by_2 * second[2]
    jacobian[8] = by_sigma * np.sign(p[8]) * (abs(p[8]) > MIN_SIGMA)
    return light * pattern - grey, jacobian.T


def _fit(
    patch: FloatArray, start: FloatArray, reach: tuple[float, float], tolerance: float
) -> FloatArray | None:
    """Least squares from ``start``; None if it doesn't settle on a cross with contrast."""
    region = _region(patch, start, reach)
    if region[0].size < 16:
        return None
    # MINPACK asks for the residual and, where it was accepted, for its derivatives
    last: tuple[bytes, FloatArray, FloatArray] = (b"", *_residual(start, region))

    def evaluate(p: FloatArray) -> tuple[bytes, FloatArray, FloatArray]:
        nonlocal last
        key = p.tobytes()
        if key != last[0]:
            last = (key, *_residual(p, region))
        return last

    def residual(p: FloatArray) -> FloatArray:
        return evaluate(p)[1]

    def jacobian(p: FloatArray) -> FloatArray:
        return evaluate(p)[2]

    fit = least_squares(
        residual,
        start,
        jac=jacobian,
        method="lm",
        xtol=tolerance,
        ftol=1e-3 * tolerance,
        max_nfev=100,
    )
    p: FloatArray = np.asarray(fit.x, dtype=np.float64)
    settled = fit.success and np.isfinite(p).all() and abs(p[5]) > 1e-3 and abs(p[8]) < 3.0
    straight = abs(p[2] - p[3]) < 0.35 and abs(p[2]) < 1.2
    moved = float(np.hypot(*(p[:2] - start[:2])))
    return p if settled and straight and moved < 3.0 else None


def _ends(
    patch: FloatArray, p: FloatArray, low: float, high: float
) -> tuple[float, float, float, float] | None:
    """How far each border goes on: (+1, -1, +2, -2) in px; None unless that fits a marker."""
    along_1, along_2, normal_1, normal_2 = _frame(p)
    ends = []
    for along, normal in ((along_1, normal_1), (along_2, normal_2)):
        for sign in (1.0, -1.0):
            ends.append(_end(patch, p[:2], sign * along, normal, low, high))
    for one, other in ((ends[0], ends[1]), (ends[2], ends[3])):
        width = one + other
        if not (low - 1.0 <= width <= high + 1.0 and abs(one - other) <= 0.2 * width):
            return None
    return ends[0], ends[1], ends[2], ends[3]


def _end(
    patch: FloatArray,
    centre: FloatArray,
    along: FloatArray,
    normal: FloatArray,
    low: float,
    high: float,
) -> float:
    """Distance at which the step across a border falls to half of what it is inside; or NaN."""
    t = np.arange(0.15 * low, 0.7 * high, 0.1)
    offset = 0.2 * low
    sides = []
    for side in (offset, -offset):
        x = centre[0] + t * along[0] + side * normal[0]
        y = centre[1] + t * along[1] + side * normal[1]
        sides.append(ndimage.map_coordinates(patch, [y, x], order=1, mode="constant", cval=np.nan))
    step = sides[0] - sides[1]
    inside = float(np.mean(step[t <= 0.3 * low]))
    if not abs(inside) > 0:
        return float("nan")
    share = step / inside
    below = np.flatnonzero(~(share >= 0.5))
    if below.size == 0 or below[0] == 0 or not np.isfinite(share[below[0]]):
        return float("nan")
    k = int(below[0])
    return float(t[k - 1] + 0.1 * (share[k - 1] - 0.5) / (share[k - 1] - share[k]))
