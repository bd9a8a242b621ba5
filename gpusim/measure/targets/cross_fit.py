"""Fit the crosses of square 2x2 checker markers: the junction of their borders, and its ends.

A marker is fitted twice, as the corners of boards are (`gpusim.measure.targets.crossings`): in its
inner part first, which tells where the marker ends, then as far out as it goes.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import scipy

from gpusim.arrays.array_types import Bool, Float
from gpusim.measure.targets.border_junction import frames
from gpusim.measure.targets.crossings import WindowFits, fit_windows

SAMPLES = 64  # on the ring that gives the first angle
MAX_SIGMA = 3.0  # px
END_MARGIN = 1.2  # px kept from the marker's own border: half a pixel's diagonal and a bit …
END_SIGMAS = 2.5  # … and the reach of the lens blur
END_STEP = 0.1  # px between the samples that tell where a border ends
MIN_REACH = 3.0  # px from the centre, so that small markers keep enough pixels
MAX_MOVE = 3.0  # px from the start of a fit
MAX_SKEW, MAX_TURN = 0.35, 1.2  # rad: of the borders to each other, from +x
CHUNK = 1 << 20  # pixels fitted at once


def fit_crosses(image: npt.NDArray[Any], places: Float, low: float, high: float) -> Float:
    """Fit the markers whose centres are near ``places`` (K, 2) px, of ``low`` to ``high`` px.

    Returns (K, 7): centre x, y (px), angle (rad), contrast and residual as in ``Markers``, widths
    along both borders (px); NaN where no cross of that size is.
    """
    chunk = max(1, int(CHUNK / (1.5 * high + 7.0) ** 2))
    parts = [places[k : k + chunk] for k in range(0, len(places), chunk)]
    return np.concatenate([np.zeros((0, 7)), *(_fitted(image, one, low, high) for one in parts)])


def _fitted(image: npt.NDArray[Any], places: Float, low: float, high: float) -> Float:
    """As `fit_crosses`, of as many as are fitted at once."""
    span, count = float(image.max()) - float(image.min()), len(places)
    angle = _first_angles(image, places, 0.27 * low)
    inner = np.full((count, 2), max(MIN_REACH, 0.5 * low - END_MARGIN))
    known = np.isfinite(angle)
    steps = _steps(np.where(known, angle, 0.0), np.where(known, angle, 0.0), inner)
    share = np.ones(count)
    coarse = fit_windows(image, places, steps, share, span, high, rough=True)
    # a start for another fit need not have settled
    good = known & _plausible(coarse, places)
    fits = np.full((count, 7), np.nan)
    rows = np.flatnonzero(good)
    p, start = coarse.parameters[rows], places[rows]
    ends = _ends(image, p, low, high)
    width = ends[:, 0::2] + ends[:, 1::2]
    blur = coarse.blur[rows]
    with np.errstate(invalid="ignore"):
        sized = ((width >= low - 1.0) & (width <= high + 1.0)).all(axis=1)
        sized &= (np.abs(ends[:, 0::2] - ends[:, 1::2]) <= 0.2 * width).all(axis=1)
    rows = rows[sized]
    p, start, ends, width, blur = (v[sized] for v in (p, start, ends, width, blur))
    margin = (END_MARGIN + END_SIGMAS * blur) / np.cos(p[:, 2] - p[:, 3])
    reach = np.maximum(MIN_REACH, np.minimum(ends[:, 0::2], ends[:, 1::2]) - margin[:, None])
    steps = _steps(p[:, 2], p[:, 3], reach)
    fine = fit_windows(image, p[:, :2], steps, np.ones(len(rows)), span, high, before=p)
    good = _plausible(fine, p[:, :2]) & fine.settled
    good &= np.linalg.norm(fine.parameters[:, :2] - start, axis=1) <= max(2.0, 0.2 * low)
    p = fine.parameters
    angle, contrast = 0.5 * (p[:, 2] + p[:, 3]), p[:, 5]
    found = [p[:, :2], angle, contrast * span, fine.rms / np.abs(contrast), width]
    fits[rows[good]] = np.column_stack(found)[good]
    return fits


def _steps(first: Float, second: Float, length: Float) -> Float:
    """Vectors (K, 2, 2) along borders at angles (K,), the second from +y, of ``length`` (K, 2)."""
    along_1 = np.stack([np.cos(first), np.sin(first)], axis=1)
    along_2 = np.stack([-np.sin(second), np.cos(second)], axis=1)
    return np.stack([along_1, along_2], axis=1) * length[:, :, None]


def _plausible(fit: WindowFits, start: Float) -> Bool:
    """Which fits (K,) are near their start, and of a cross with contrast."""
    p = fit.parameters
    with np.errstate(invalid="ignore"):
        return np.asarray(
            (np.abs(p[:, 5]) > 1e-3)
            & (p[:, 8] < MAX_SIGMA**2)
            & (np.abs(p[:, 2] - p[:, 3]) < MAX_SKEW)
            & (np.abs(p[:, 2]) < MAX_TURN)
            & (np.linalg.norm(p[:, :2] - start, axis=1) < MAX_MOVE)
        )


def _sampled(image: npt.NDArray[Any], x: Float, y: Float) -> Float:
    """Grey values at positions (…), linearly between pixels; NaN outside."""
    values = scipy.ndimage.map_coordinates(
        image, [y, x], output=np.float64, order=1, mode="constant", cval=np.nan
    )
    return np.asarray(values)


def _first_angles(image: npt.NDArray[Any], centre: Float, radius: float) -> Float:
    """Angle of the border nearest to +x, from a ring's 2nd harmonic."""
    turn = np.arange(SAMPLES) * (2 * np.pi / SAMPLES)
    ring = _sampled(
        image, centre[:, :1] + radius * np.cos(turn), centre[:, 1:] + radius * np.sin(turn)
    )
    # c sin(2 (turn - angle)) has the harmonic c exp(-2i angle) / 2i
    angle = -0.5 * (np.angle(ring @ np.exp(-2j * turn)) + 0.5 * np.pi)
    return np.asarray(angle - np.round(angle / (0.5 * np.pi)) * 0.5 * np.pi)


def _ends(image: npt.NDArray[Any], p: Float, low: float, high: float) -> Float:
    """How far each border goes on: (+1, -1, +2, -2) in px (K, 4); NaN where none is seen.

    That is where the step across it falls to half of what it is inside.
    """
    along_1, along_2, normal_1, normal_2 = frames(p)
    along = np.stack([along_1, -along_1, along_2, -along_2], axis=1)
    normal = np.stack([normal_1, normal_1, normal_2, normal_2], axis=1)
    t = np.arange(0.15 * low, 0.7 * high, END_STEP)
    sides = []
    for side in (0.2 * low, -0.2 * low):
        at = (p[:, None, :2] + side * normal)[..., None] + along[..., None] * t
        sides.append(_sampled(image, at[:, :, 0], at[:, :, 1]))
    step = sides[0] - sides[1]
    inside = step[..., t <= 0.3 * low].mean(axis=-1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        share = step / inside
        below = ~(share >= 0.5)
    k = np.argmax(below, axis=-1)
    ended = below.any(axis=-1) & (k > 0)
    before, after = (
        np.take_along_axis(share, index[..., None], axis=-1)[..., 0]
        for index in (np.maximum(k - 1, 0), k)
    )
    with np.errstate(invalid="ignore", divide="ignore"):
        end = t[np.maximum(k - 1, 0)] + END_STEP * (before - 0.5) / (before - after)
    return np.where(ended & np.isfinite(after), end, np.nan)
