"""Coded markers (ArUco, AprilTag): OpenCV reads their numbers, our own fit places their corners.

`cv2.aruco` sets corners to some hundredths of a pixel at best. Here each side of the dark square is
fitted as a border with the lens's blur and the pixels' area, without its ends, where the next side
is seen; corners are where neighbouring sides meet. Behind a lens that bends them they would meet
some tenths of a pixel from there, which is taken off.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.field_summary import field_summary
from gpusim.measure.images import Image, check_image, eight_bit
from gpusim.measure.targets.boards import check_dictionary
from gpusim.measure.targets.border_junction import profile_and_slopes, slope_by_turn
from gpusim.measure.targets.levenberg_marquardt import fit_many
from gpusim.measure.targets.plumb_lines import (
    PlumbField,
    Straighten,
    field_of_bends,
    straight_offsets,
)
from gpusim.parallel.blas_threads import one_blas_thread
from gpusim.validation import unmasked

SHARE = 0.8  # of a side that is fitted
BAND = 0.6  # cells on either side of it, at most MAX_BAND px
MAX_BAND = 4.0
MIN_CELL = 2.5  # px
PARAMETERS = 5  # offset, turn, variance of the blur, middle grey, half contrast
MIN_SIGMA, FIRST_SIGMA, MAX_SIGMA = 0.004, 0.5, 7.0  # px
FURTHEST = 2.0  # px that a side may lie from where it was expected
ROUNDS = 4  # fits of the sides, of how the lens bends them, and again
STEPS = 5  # from where straight sides would meet to where bent ones do


@dataclass(frozen=True, eq=False)
class SideSamples:
    """Pixels near S sides: ``middle`` (S, 2), ``angle`` of the outer normal and ``length`` (S,)
    of each; ``offset`` (S, P, 2) of the pixels from its middle, ``grey`` and ``weight`` (S, P);
    ``enough`` (S,): whether they are."""

    middle: Float
    angle: Float
    length: Float
    offset: Float
    grey: Float
    weight: Float
    enough: Bool


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

    middle: Float
    normal: Float
    offset: Float
    spread: Float
    bend: Float
    bend_sigma: Float
    good: Bool


def side_samples(image: Image, corners: Float, cells: int) -> SideSamples:
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
    most = max(1, max(len(pixels) for pixels in samples))
    offset, grey, weight = (np.zeros((len(samples), most, k)) for k in (2, 1, 1))
    for k, pixels in enumerate(samples):
        offset[k, : len(pixels)] = pixels[:, :2]
        grey[k, : len(pixels), 0] = pixels[:, 2]
        weight[k, : len(pixels)] = 1.0
        enough[k] &= len(pixels) >= 4 * PARAMETERS
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

    def model(p: Float, rows: Long) -> tuple[Float, Float]:
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
    residual, slopes = model(p, np.arange(len(p)))
    for k in np.flatnonzero(good):
        bend[k], sigma[k] = _bend(offset[k], normal[k], residual[k], slopes[k], weight[k])
    return Sides(samples.middle, normal, p[:, 0], spread, bend, sigma, good)


def _bend(
    offset: Float,
    normal: Float,
    residual: Float,
    slopes: Float,
    weight: Float,
) -> tuple[float, float]:
    """A curvature that explains what a fit leaves (P,), beside its own parameters; its sigma."""
    along = offset[:, 1] * normal[0] - offset[:, 0] * normal[1]
    used = weight > 0
    # a border that is bent towards its normal is further out by half the curvature times along^2
    bending = (slopes[0] * 0.5 * along**2)[used]
    others = slopes[:, used].T
    bending -= others @ np.linalg.lstsq(others, bending, rcond=None)[0]
    square = float(bending @ bending)
    if not square > 0:
        return 0.0, np.inf
    freedom = max(int(used.sum()) - PARAMETERS - 1, 1)
    bend = -float(bending @ residual[used]) / square
    remainder = residual[used] + bend * bending
    return bend, float(np.sqrt(remainder @ remainder / freedom / square)) + 1e-12


def _pixels(image: Image, middle: Float, angle: float, reach: float, band: float) -> Float:
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


@dataclass(frozen=True, eq=False)
class Codes:
    """M coded markers in an image, by rising number.

    Attributes
    ----------
    number : (M,) int64.
    corners : (M, 4, 2) float64, px: the marker's own upper left corner, then clockwise as seen.
    centre : (M, 2) float64, px, where the diagonals meet: the image of the marker's centre in any
        perspective, which the mean of the corners isn't.
    sigma : (M,) float64, standard uncertainty of a corner's coordinate from the fits, px.
    missed : markers that were read but too small or not sharp.

    Examples
    --------
    >>> codes = gs.measure.find_aruco(gs.export.read_image("charuco.png"))
    >>> codes.number, codes.corners.shape
    (array([0, 1, 2, 3, 4, 5]), (6, 4, 2))
    """

    number: Long
    corners: Float
    centre: Float
    sigma: Float
    missed: int
    __repr__ = field_summary

    def __len__(self) -> int:
        return len(self.number)


@unmasked("image")
@one_blas_thread()
def find_aruco(
    image: npt.NDArray[Any], dictionary: str = "4X4_50", straighten: Straighten | None = None
) -> Codes:
    """The markers of a dictionary in a grey image of any depth.

    The ground around a marker must be lighter than its border for about a cell. How far the lens
    bends the sides is taken from all of them together, unless ``straighten`` tells it: from pixels
    (…, 2) to places (…, 2) where straight lines are straight (`lens_mapping` of a calibrated
    camera). Raises InputError for anything but a grey image, or an unknown dictionary.

    Examples
    --------
    >>> gs.measure.find_aruco(gs.export.read_image("charuco.png"), "4X4_50").number
    array([0, 1, 2, 3, 4, 5])
    """
    known = check_dictionary(dictionary, "find_aruco dictionary")
    array = check_image(image, "image")
    detected, numbers, _ = cv2.aruco.ArucoDetector(known).detectMarkers(eight_bit(array))
    if numbers is None or len(numbers) == 0:
        return Codes(np.zeros(0, np.int64), np.zeros((0, 4, 2)), np.zeros((0, 2)), np.zeros(0), 0)
    number = np.asarray(numbers, dtype=np.int64).reshape(-1)
    rough = np.asarray(detected, dtype=np.float64).reshape(-1, 4, 2)
    order = np.argsort(number, kind="stable")
    number, rough = number[order], rough[order]
    cells = int(known.markerSize) + 2
    samples = side_samples(array, rough, cells)
    sides, straighten = _straightened(samples, (array.shape[1], array.shape[0]), straighten)
    return _gathered(number, sides, straighten)


def _straightened(
    samples: SideSamples, size: tuple[int, int], straighten: Straighten | None
) -> tuple[Sides, Straighten | None]:
    """The fitted sides; where they show that the lens bends them, in coordinates without that."""
    sides = fit_sides(samples, straighten)
    if straighten is not None:
        return sides, straighten
    field: PlumbField | None = None
    for _ in range(ROUNDS):
        rows = sides.good
        field = field_of_bends(
            sides.middle[rows], sides.normal[rows], sides.bend[rows], sides.bend_sigma[rows],
            size, field,
        )  # fmt: skip
        if field is None:
            return fit_sides(samples), None
        sides = fit_sides(samples, field)
    return sides, field


def _gathered(number: Long, sides: Sides, straighten: Straighten | None) -> Codes:
    """Corners where the sides, four each, meet; without markers that have a bad side."""
    keep = sides.good.reshape(-1, 4).all(axis=1)
    middle, normal = (v.reshape(-1, 4, 2)[keep] for v in (sides.middle, sides.normal))
    offset, spread = (v.reshape(-1, 4)[keep] for v in (sides.offset, sides.spread))
    number, missed = number[keep], int((~keep).sum())
    if not number.size:
        return Codes(number, np.zeros((0, 4, 2)), np.zeros((0, 2)), np.zeros(0), missed)
    every = normal, middle, offset
    pairs = [np.stack([np.roll(v, 1, axis=1), v], axis=2) for v in every]
    system, places, right = pairs
    corners = _solved(system, right + (system * places).sum(axis=-1))
    for _ in range(STEPS):
        if straighten is None:
            break
        away = corners[:, :, None, :] - places
        away = straight_offsets(straighten, places.reshape(-1, 2), away.reshape(-1, 1, 2))
        gap = right - (system * away.reshape(places.shape)).sum(axis=-1)
        corners = corners + _solved(system, gap)
    # diagonals are straight where sides are
    about = corners.mean(axis=1)
    flat = corners - about[:, None]
    if straighten is not None:
        flat = straight_offsets(straighten, about, flat)
    first, second = flat[:, 2] - flat[:, 0], flat[:, 3] - flat[:, 1]
    along = _cross(flat[:, 1] - flat[:, 0], second) / _cross(first, second)
    meet = flat[:, 0] + along[:, None] * first
    away = meet
    for _ in range(STEPS):
        if straighten is None:
            break
        away = away + meet - straight_offsets(straighten, about, away[:, None])[:, 0]
    centre: Float = about + away
    sigma: Float = np.asarray(np.sqrt((spread**2).mean(axis=1)), dtype=np.float64)
    return Codes(number, corners, centre, sigma, missed)


def _solved(system: Float, right: Float) -> Float:
    """Places (M, 4, 2) where two lines meet: systems (M, 4, 2, 2) and right sides (M, 4, 2)."""
    return np.asarray(np.linalg.solve(system, right[..., None])[..., 0])


def _cross(a: Float, b: Float) -> Float:
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
