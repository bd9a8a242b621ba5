"""Fit the crosses of square 2x2 checker markers: the junction of their borders, and its ends.

All markers of an image are fitted at once with the model of
`gpusim.measure.targets.border_junction`, each twice: in its inner part first, which tells where the
marker ends, then as far out as it goes.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gpusim.arrays.array_types import Bool, Float, Long, Single
from gpusim.measure.targets.border_junction import CENTRE, fit_junctions, frames

SAMPLES = 64  # on the ring that gives the first angle
FIRST_SIGMA, MAX_SIGMA = 0.3, 3.0  # px
END_MARGIN = 1.2  # px kept from the marker's own border: half a pixel's diagonal and a bit …
END_SIGMAS = 2.5  # … and the reach of the lens blur
END_STEP = 0.1  # px between the samples that tell where a border ends
MIN_REACH = 3.0  # px from the centre, so that small markers keep enough pixels
MIN_PIXELS = 16
MAX_MOVE = 3.0  # px from the start of a fit
MAX_SKEW, MAX_TURN = 0.35, 1.2  # rad: of the borders to each other, from +x
CHUNK = 1 << 20  # pixels fitted at once


def fit_crosses(places: Sequence[tuple[Single, float, float]], low: float, high: float) -> Float:
    """Fit the markers whose centres are near places (grey image, x, y), of ``low`` to ``high`` px.

    The images may be one or many. Returns (K, 7): centre x, y (px), angle (rad), contrast and
    residual as in ``Markers``, widths along both borders (px); NaN where no cross of that size is.
    """
    reach = int(np.ceil(0.75 * high)) + 3
    size = 2 * reach + 1
    fits = [np.zeros((0, 7))]
    chunk = max(1, CHUNK // size**2)
    for first in range(0, len(places), chunk):
        part = places[first : first + chunk]
        patches = np.full((len(part), size, size), np.nan)
        corner = np.empty((len(part), 2), dtype=np.int64)
        for patch, (grey, x, y), at in zip(patches, part, corner, strict=True):
            at[:] = round(x) - reach, round(y) - reach
            x0, y0 = np.maximum(at, 0)
            window = grey[y0 : at[1] + size, x0 : at[0] + size]
            inner = slice(y0 - at[1], y0 - at[1] + window.shape[0])
            patch[inner, x0 - at[0] : x0 - at[0] + window.shape[1]] = window
        start = np.array([[x, y] for _, x, y in part], dtype=np.float64) - corner.astype(np.float64)
        fits.append(_fit_patches(patches, corner, start, low, high))
    return np.concatenate(fits)


def _fit_patches(patches: Float, corner: Long, start: Float, low: float, high: float) -> Float:
    """Patches (K, S, S), NaN outside the image, whose first pixel lies at ``corner`` (K, 2)."""
    count = len(patches)
    angle, contrast = _first_angles(patches, start, 0.27 * low)
    first = np.column_stack([start, angle, angle, np.zeros(count), contrast,
                             np.zeros((count, 2)), np.full(count, FIRST_SIGMA**2)])  # fmt: skip
    first[:, 4] = _levels(patches, start, 0.35 * low)
    inner = np.full((count, 2), max(MIN_REACH, 0.5 * low - END_MARGIN))
    everything = np.asarray(np.isfinite(first).all(axis=1))
    coarse, _, good = _fit(patches, first, inner, everything, rough=True)
    ends = _ends(patches, coarse, good, low, high)
    width = ends[:, 0::2] + ends[:, 1::2]
    with np.errstate(invalid="ignore"):
        good &= ((width >= low - 1.0) & (width <= high + 1.0)).all(axis=1)
        good &= (np.abs(ends[:, 0::2] - ends[:, 1::2]) <= 0.2 * width).all(axis=1)
        margin = (END_MARGIN + END_SIGMAS * np.sqrt(coarse[:, 8])) / np.cos(
            coarse[:, 2] - coarse[:, 3]
        )
        reach = np.maximum(MIN_REACH, np.minimum(ends[:, 0::2], ends[:, 1::2]) - margin[:, None])
    fine, rms, good = _fit(patches, coarse, reach, good)
    with np.errstate(invalid="ignore"):
        good &= np.linalg.norm(fine[:, :2] - start, axis=1) <= max(2.0, 0.2 * low)
    angle, contrast = 0.5 * (fine[:, 2] + fine[:, 3]), fine[:, 5]
    fits = np.column_stack([fine[:, :2] + corner, angle, contrast, rms / np.abs(contrast), width])
    return np.where(good[:, None], fits, np.nan)


def _sampled(patches: Float, x: Float, y: Float) -> Float:
    """Each patch at its own positions (K, …), linearly between pixels; NaN outside."""
    which = np.arange(len(patches)).reshape(-1, *[1] * (x.ndim - 1))
    last = patches.shape[1] - 1
    inside = (x >= 0) & (x <= last) & (y >= 0) & (y <= last)
    x, y = np.where(inside, x, 0.0), np.where(inside, y, 0.0)
    column, row = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    # a neighbour that has no part in a value may be NaN
    beside, below = np.ceil(x).astype(np.int64), np.ceil(y).astype(np.int64)
    right, down = x - column, y - row
    upper = (1.0 - right) * patches[which, row, column] + right * patches[which, row, beside]
    lower = (1.0 - right) * patches[which, below, column] + right * patches[which, below, beside]
    return np.where(inside, (1.0 - down) * upper + down * lower, np.nan)


def _first_angles(patches: Float, centre: Float, radius: float) -> tuple[Float, Float]:
    """Angle of the border nearest to +x and the signed contrast, from a ring's 2nd harmonic."""
    turn = np.arange(SAMPLES) * (2 * np.pi / SAMPLES)
    ring = _sampled(
        patches, centre[:, :1] + radius * np.cos(turn), centre[:, 1:] + radius * np.sin(turn)
    )
    harmonic = ring @ np.exp(-2j * turn) / SAMPLES
    # c sin(2 (turn - angle)) has the harmonic c exp(-2i angle) / 2i; the square wave has 4/pi more
    angle = -0.5 * (np.angle(harmonic) + 0.5 * np.pi)
    contrast = 2.0 * np.abs(harmonic) * np.pi / 4.0
    turns = np.round(angle / (0.5 * np.pi))
    return angle - turns * 0.5 * np.pi, np.where(turns % 2 == 0, contrast, -contrast)


def _levels(patches: Float, centre: Float, radius: float) -> Float:
    """Mean grey value within ``radius`` of each centre; NaN where the image ends before."""
    y, x = np.indices(patches.shape[1:], dtype=np.float64)
    near = np.hypot(x - centre[:, 0, None, None], y - centre[:, 1, None, None]) <= radius
    total: Float = np.where(near, patches, 0.0).sum(axis=(1, 2))
    return np.asarray(total / near.sum(axis=(1, 2)))


def _fit(
    patches: Float,
    start: Float,
    reach: Float,
    wanted: Bool,
    *,
    rough: bool = False,
) -> tuple[Float, Float, Bool]:
    """Parameters (K, 9) and RMS (K,) from ``start``, and which settled on a cross with contrast."""
    p, rms = np.full_like(start, np.nan), np.full(len(start), np.nan)
    good = np.zeros(len(start), dtype=bool)
    rows = np.flatnonzero(wanted)
    if not rows.size:
        return p, rms, good
    x, y, grey, weight = _region(patches[rows], start[rows], reach[rows])
    enough = weight.sum(axis=1) >= MIN_PIXELS
    rows, x, y, grey, weight = (a[enough] for a in (rows, x, y, grey, weight))
    if not rows.size:
        return p, rms, good
    fit = fit_junctions(x, y, grey, weight, start[rows], rough=rough)
    p[rows], rms[rows] = fit.parameters, fit.rms
    fitted = p[rows]
    good[rows] = (
        # a start for another fit need not have settled
        (fit.converged | rough)
        & np.isfinite(fitted).all(axis=1)
        & (np.abs(fitted[:, 5]) > 1e-3)
        & (fitted[:, 8] < MAX_SIGMA**2)
        & (np.abs(fitted[:, 2] - fitted[:, 3]) < MAX_SKEW)
        & (np.abs(fitted[:, 2]) < MAX_TURN)
        & (np.linalg.norm(fitted[:, :2] - start[rows, :2], axis=1) < MAX_MOVE)
    )
    return p, rms, good


def _region(patches: Float, p: Float, reach: Float) -> tuple[Float, Float, Float, Float]:
    """Pixels inside each marker, without those at the crossing: x, y, grey, weight (K, P)."""
    y, x = np.indices(patches.shape[1:], dtype=np.float64)
    along_1, along_2, normal_1, normal_2 = (v[:, :, None, None] for v in frames(p))
    dx, dy = x - p[:, 0, None, None], y - p[:, 1, None, None]
    off_1 = np.abs(dx * normal_1[:, 0] + dy * normal_1[:, 1])
    off_2 = np.abs(dx * normal_2[:, 0] + dy * normal_2[:, 1])
    # how far along both borders: a marker seen at an angle is a parallelogram
    sine = along_1[:, 0] * along_2[:, 1] - along_1[:, 1] * along_2[:, 0]
    use = (off_2 <= reach[:, 0, None, None] * sine) & (off_1 <= reach[:, 1, None, None] * sine)
    use &= ~((off_1 < CENTRE) & (off_2 < CENTRE)) & np.isfinite(patches)
    which, row, column = np.nonzero(use)
    counts = np.bincount(which, minlength=len(patches))
    place = np.arange(which.size) - np.repeat(np.cumsum(counts) - counts, counts)
    packed = np.zeros((4, len(patches), max(1, int(counts.max(initial=0)))))
    packed[:, which, place] = column, row, patches[which, row, column], np.ones(which.size)
    return packed[0], packed[1], packed[2], packed[3]


def _ends(patches: Float, p: Float, good: Bool, low: float, high: float) -> Float:
    """How far each border goes on: (+1, -1, +2, -2) in px (K, 4); NaN where none is seen.

    That is where the step across it falls to half of what it is inside.
    """
    ends = np.full((len(p), 4), np.nan)
    rows = np.flatnonzero(good)
    if not rows.size:
        return ends
    along_1, along_2, normal_1, normal_2 = frames(p[rows])
    along = np.stack([along_1, -along_1, along_2, -along_2], axis=1)
    normal = np.stack([normal_1, normal_1, normal_2, normal_2], axis=1)
    t = np.arange(0.15 * low, 0.7 * high, END_STEP)
    sides = []
    for side in (0.2 * low, -0.2 * low):
        from_ = p[rows, None, :2] + side * normal
        at = from_[..., None] + along[..., None] * t
        sides.append(_sampled(patches[rows], at[:, :, 0], at[:, :, 1]))
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
    ends[rows] = np.where(ended & np.isfinite(after), end, np.nan)
    return ends
