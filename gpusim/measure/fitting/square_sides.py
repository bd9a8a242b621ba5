"""The straight sides of dark squares: borders with the lens's blur and the pixels' area, fitted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.measure.fitting.edge_profile import profile_and_slopes, slope_by_turn
from gpusim.measure.fitting.levenberg_marquardt import fit_many
from gpusim.measure.fitting.plumb_lines import Straighten, straight_offsets
from gpusim.measure.images import FloatArray, Image

__all__ = ["SideSamples", "Sides", "fit_sides", "side_samples"]

SHARE = 0.8  # of a side that is fitted
BAND = 0.6  # cells on either side of it, at most MAX_BAND px
MAX_BAND = 4.0
MIN_CELL = 2.5  # px
PARAMETERS = 5  # offset, turn, variance of the blur, middle grey, half contrast
MIN_SIGMA, FIRST_SIGMA, MAX_SIGMA = 0.004, 0.5, 7.0  # px
FURTHEST = 2.0  # px that a side may lie from where it was expected


@dataclass(frozen=True, eq=False)
class SideSamples:
    """Pixels near S sides: ``middle`` (S, 2), ``angle`` of the outer normal and ``length`` (S,)
    of each; ``offset`` (S, P, 2) of the pixels from its middle, ``grey`` and ``weight`` (S, P);
    ``enough`` (S,): whether they are."""

    middle: FloatArray
    angle: FloatArray
    length: FloatArray
    offset: FloatArray
    grey: FloatArray
    weight: FloatArray
    enough: npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Sides:
    """S fitted sides.

    Attributes
    ----------
    middle, normal : (S, 2) float64; a side is where normal . (x - middle) is ``offset`` (S,), px.
    spread : (S,) float64, standard uncertainty at a side's ends, px.
    bend, bend_sigma : (S,) float64, curvature that the straight fit leaves, towards the normal, and
        its uncertainty, 1/px.
    good : (S,) bool.
    """

    middle: FloatArray
    normal: FloatArray
    offset: FloatArray
    spread: FloatArray
    bend: FloatArray
    bend_sigma: FloatArray
    good: npt.NDArray[np.bool_]


def side_samples(image: Image, corners: FloatArray, cells: int) -> SideSamples:
    """The pixels near the sides of M squares of ``cells`` cells, side k from corner k to the next.

    ``corners`` (M, 4, 2) px, clockwise as seen.
    """
    ends = np.roll(corners, -1, axis=1) - corners
    length = np.linalg.norm(ends, axis=2).ravel()
    middle = (corners + 0.5 * ends).reshape(-1, 2)
    direction = ends.reshape(-1, 2) / np.maximum(length, 1e-9)[:, None]
    angle = np.arctan2(-direction[:, 0], direction[:, 1])
    cell = (length.reshape(-1, 4).min(axis=1) / cells).repeat(4)
    band = np.minimum(BAND * cell, MAX_BAND)
    enough = cell >= MIN_CELL
    samples = [
        _pixels(image, *one)
        for one in zip(
            middle, angle, 0.5 * SHARE * length, np.where(enough, band, 1.0), strict=True
        )
    ]
    most = max(1, max(len(own) for own in samples))
    offset, grey, weight = (np.zeros((len(samples), most, k)) for k in (2, 1, 1))
    for k, own in enumerate(samples):
        offset[k, : len(own)] = own[:, :2]
        grey[k, : len(own), 0] = own[:, 2]
        weight[k, : len(own)] = 1.0
        enough[k] &= len(own) >= 4 * PARAMETERS
    return SideSamples(middle, angle, length, offset, grey[..., 0], weight[..., 0], enough)


def fit_sides(samples: SideSamples, straighten: Straighten | None = None) -> Sides:
    """Fit all sides as straight borders, in coordinates that ``straighten`` makes straight."""
    offset, grey, weight = samples.offset, samples.grey, samples.weight
    if straighten is not None:
        offset = straight_offsets(straighten, samples.middle, offset)
    used = weight > 0
    low, high = (
        np.where(used.any(axis=1), edge(np.where(used, grey, none), axis=1), 0.0)
        for edge, none in ((np.min, np.inf), (np.max, -np.inf))
    )
    start = np.zeros((len(offset), PARAMETERS))
    start[:, 1], start[:, 2] = samples.angle, FIRST_SIGMA**2
    start[:, 3], start[:, 4] = 0.5 * (low + high), np.maximum(0.5 * (high - low), 1e-9)

    def model(p: FloatArray, rows: npt.NDArray[np.int64]) -> tuple[FloatArray, FloatArray]:
        normal = np.stack([np.cos(p[:, 1]), np.sin(p[:, 1])], axis=1)
        change = np.stack([-normal[:, 1], normal[:, 0]], axis=1)
        dx, dy = offset[rows, :, 0], offset[rows, :, 1]
        distance = dx * normal[:, :1] + dy * normal[:, 1:] - p[:, :1]
        profile = profile_and_slopes(distance, normal, np.minimum(p[:, 2], MAX_SIGMA**2))
        half = p[:, 4:5]
        slopes = [
            -half * profile[1],
            half * slope_by_turn(profile, normal, change, dx, dy),
            half * profile[2],
            np.ones_like(dx),
            profile[0],
        ]
        return p[:, 3:4] + half * profile[0] - grey[rows], np.stack(slopes, axis=1)

    scale = np.array([1.0, 0.1, 10.0, 1.0, 1.0])
    scale[3:] = max(float(np.ptp(grey)), 1e-9)
    lower = np.array([-np.inf, -np.inf, MIN_SIGMA**2, -np.inf, -np.inf])
    fit = fit_many(model, start, weight, scale, lower=lower, tolerance=1e-5)
    p = fit.parameters
    good = samples.enough & fit.converged & (np.abs(p[:, 0]) <= FURTHEST) & (p[:, 4] > 0)
    good &= fit.rms <= 0.25 * np.maximum(p[:, 4], 1e-9)
    normal = np.stack([np.cos(p[:, 1]), np.sin(p[:, 1])], axis=1)
    # at its ends a side is known as its offset and its turn are
    spread = np.sqrt(
        fit.covariance[:, 0, 0] + (0.5 * samples.length) ** 2 * fit.covariance[:, 1, 1]
    )
    bend, sigma = np.zeros(len(p)), np.full(len(p), np.inf)
    left, slopes = model(p, np.arange(len(p)))
    for k in np.flatnonzero(good):
        bend[k], sigma[k] = _bend(offset[k], normal[k], left[k], slopes[k], weight[k])
    return Sides(samples.middle, normal, p[:, 0], spread, bend, sigma, good)


def _bend(
    offset: FloatArray, normal: FloatArray, left: FloatArray, slopes: FloatArray, weight: FloatArray
) -> tuple[float, float]:
    """A curvature that explains what a fit leaves (P,), beside its own parameters; its sigma."""
    along = offset[:, 1] * normal[0] - offset[:, 0] * normal[1]
    used = weight > 0
    # a border that is bent towards its normal is further out by half the curvature times along^2
    own = (slopes[0] * 0.5 * along**2)[used]
    others = slopes[:, used].T
    own -= others @ np.linalg.lstsq(others, own, rcond=None)[0]
    square = float(own @ own)
    if not square > 0:
        return 0.0, np.inf
    freedom = max(int(used.sum()) - PARAMETERS - 1, 1)
    bend = -float(own @ left[used]) / square
    rest = left[used] + bend * own
    return bend, float(np.sqrt(rest @ rest / freedom / square)) + 1e-12


def _pixels(
    image: Image, middle: FloatArray, angle: float, reach: float, band: float
) -> FloatArray:
    """Pixels (P, 3) near a side: offset from its middle, and grey value; none at the border."""
    height, width = image.shape
    normal = np.array([np.cos(angle), np.sin(angle)])
    size = reach * np.abs(normal[::-1]) + band * np.abs(normal)
    x0, y0 = np.floor(middle - size).astype(int)
    x1, y1 = np.ceil(middle + size).astype(int)
    if x0 < 0 or y0 < 0 or x1 >= width or y1 >= height:
        return np.zeros((0, 3))
    row, column = np.mgrid[y0 : y1 + 1, x0 : x1 + 1]
    dx, dy = column - middle[0], row - middle[1]
    across, along = dx * normal[0] + dy * normal[1], dy * normal[0] - dx * normal[1]
    near = (np.abs(across) <= band) & (np.abs(along) <= reach)
    grey = image[y0 : y1 + 1, x0 : x1 + 1].astype(np.float64)
    return np.column_stack([dx[near], dy[near], grey[near]])
