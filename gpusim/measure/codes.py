"""Coded markers (ArUco, AprilTag): OpenCV reads their numbers, our own fit places their corners.

`cv2.aruco` sets corners to some hundredths of a pixel at best. Here each side of the dark square is
fitted as a straight border with the lens's blur and the pixels' area (`gpusim.measure.border`),
without its ends, where the next side is seen; corners are where neighbouring sides meet.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from gpusim.blas import one_blas_thread
from gpusim.errors import InputError
from gpusim.inputs import unmasked
from gpusim.measure.border import profile_and_slopes, slope_by_turn
from gpusim.measure.images import FloatArray, Image, check_image, eight_bit
from gpusim.measure.levenberg import fit_many

__all__ = ["Codes", "check_dictionary", "find_aruco"]

SHARE = 0.8  # of a side that is fitted
BAND = 0.6  # cells on either side of it, at most MOST px
MOST = 4.0
LEAST_CELL = 2.5  # px
PARAMETERS = 5  # offset, turn, variance of the blur, middle grey, half contrast
MIN_SIGMA, FIRST_SIGMA, MOST_SIGMA = 0.004, 0.5, 7.0  # px
FURTHEST = 2.0  # px that a side may lie from where OpenCV has it


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
    """

    number: npt.NDArray[np.int64]
    corners: FloatArray
    centre: FloatArray
    sigma: FloatArray
    missed: int

    def __len__(self) -> int:
        return len(self.number)


def check_dictionary(name: str, what: str) -> Any:
    """OpenCV's dictionary of that name, without DICT_. Raises InputError for others."""
    names = sorted(n[5:] for n in dir(cv2.aruco) if n.startswith("DICT_"))
    if name not in names:
        raise InputError(f"{what}: got {name!r}; expected one of {', '.join(names)}")
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{name}"))


@unmasked("image")
@one_blas_thread()
def find_aruco(image: npt.NDArray[Any], dictionary: str = "4X4_50") -> Codes:
    """The markers of a dictionary in a grey image of any depth.

    The ground around a marker must be lighter than its border for about a cell. Raises InputError
    for anything but a grey image, or an unknown dictionary.
    """
    known = check_dictionary(dictionary, "find_aruco dictionary")
    array = check_image(image, "image")
    found, numbers, _ = cv2.aruco.ArucoDetector(known).detectMarkers(eight_bit(array))
    if numbers is None or len(numbers) == 0:
        return _gathered(np.zeros(0, np.int64), np.zeros((0, 4, 2)), np.zeros((0, 4)), 0)
    number = np.asarray(numbers, dtype=np.int64).reshape(-1)
    rough = np.asarray(found, dtype=np.float64).reshape(-1, 4, 2)
    order = np.argsort(number, kind="stable")
    number, rough = number[order], rough[order]
    cells = int(known.markerSize) + 2
    lines, spread, good = _sides(array, rough, cells)
    keep = good.all(axis=1)
    return _gathered(number[keep], lines[keep], spread[keep], int((~keep).sum()))


def _gathered(
    number: npt.NDArray[np.int64], lines: FloatArray, spread: FloatArray, missed: int
) -> Codes:
    """Corners from the sides (M, 4, 3) a x + b y = c; side k goes from corner k to the next."""
    if not number.size:
        return Codes(number, np.zeros((0, 4, 2)), np.zeros((0, 2)), np.zeros(0), missed)
    before = np.roll(lines, 1, axis=1)
    system = np.stack([before[..., :2], lines[..., :2]], axis=2)
    right = np.stack([before[..., 2], lines[..., 2]], axis=2)
    corners: FloatArray = np.asarray(np.linalg.solve(system, right[..., None])[..., 0], np.float64)
    first, second = corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]
    between = corners[:, 1] - corners[:, 0]
    along = _cross(between, second) / _cross(first, second)
    centre: FloatArray = np.asarray(corners[:, 0] + along[:, None] * first)
    sigma: FloatArray = np.asarray(np.sqrt((spread**2).mean(axis=1)), dtype=np.float64)
    return Codes(number, corners, centre, sigma, missed)


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])


def _sides(
    image: Image, rough: FloatArray, cells: int
) -> tuple[FloatArray, FloatArray, npt.NDArray[np.bool_]]:
    """Fitted sides (M, 4, 3), the uncertainty of their offsets (M, 4), and which fits are good."""
    ends = np.roll(rough, -1, axis=1) - rough
    length = np.linalg.norm(ends, axis=2).ravel()
    middle = (rough + 0.5 * ends).reshape(-1, 2)
    direction = ends.reshape(-1, 2) / np.maximum(length, 1e-9)[:, None]
    angle = np.arctan2(-direction[:, 0], direction[:, 1])  # of the outer normal: clockwise sides
    cell = (length.reshape(-1, 4).min(axis=1) / cells).repeat(4)
    band = np.minimum(BAND * cell, MOST)
    good = cell >= LEAST_CELL
    samples = [
        _pixels(image, *one)
        for one in zip(middle, angle, 0.5 * SHARE * length, np.where(good, band, 1.0), strict=True)
    ]
    most = max(1, max(len(s) for s in samples))
    offset, grey, weight = (np.zeros((len(samples), most, k)) for k in (2, 1, 1))
    for k, own in enumerate(samples):
        offset[k, : len(own)] = own[:, :2]
        grey[k, : len(own), 0] = own[:, 2]
        weight[k, : len(own)] = 1.0
        good[k] &= len(own) >= 4 * PARAMETERS
    values, weights = grey[..., 0], weight[..., 0]
    start = np.zeros((len(samples), PARAMETERS))
    start[:, 1], start[:, 2] = angle, FIRST_SIGMA**2
    low, high = (
        np.array([f(s[:, 2]) if len(s) else 0.0 for s in samples]) for f in (np.min, np.max)
    )
    start[:, 3], start[:, 4] = 0.5 * (low + high), np.maximum(0.5 * (high - low), 1e-9)

    def model(p: FloatArray, rows: npt.NDArray[np.int64]) -> tuple[FloatArray, FloatArray]:
        normal = np.stack([np.cos(p[:, 1]), np.sin(p[:, 1])], axis=1)
        change = np.stack([-normal[:, 1], normal[:, 0]], axis=1)
        dx, dy = offset[rows, :, 0], offset[rows, :, 1]
        distance = dx * normal[:, :1] + dy * normal[:, 1:] - p[:, :1]
        profile = profile_and_slopes(distance, normal, np.minimum(p[:, 2], MOST_SIGMA**2))
        half = p[:, 4:5]
        slopes = [
            -half * profile[1],
            half * slope_by_turn(profile, normal, change, dx, dy),
            half * profile[2],
            np.ones_like(dx),
            profile[0],
        ]
        return p[:, 3:4] + half * profile[0] - values[rows], np.stack(slopes, axis=1)

    scale = np.array([1.0, 0.1, 10.0, 1.0, 1.0])
    scale[3:] = max(float(np.ptp(values)), 1e-9)
    lower = np.array([-np.inf, -np.inf, MIN_SIGMA**2, -np.inf, -np.inf])
    fit = fit_many(model, start, weights, scale, lower=lower, tolerance=1e-5)
    p = fit.parameters
    good &= fit.converged & (np.abs(p[:, 0]) <= FURTHEST) & (p[:, 4] > 0)
    good &= fit.rms <= 0.25 * np.maximum(p[:, 4], 1e-9)
    normal = np.stack([np.cos(p[:, 1]), np.sin(p[:, 1])], axis=1)
    right = p[:, 0] + (normal * middle).sum(axis=1)
    lines = np.column_stack([normal, right])
    # at its ends a side is known as its offset and its turn are
    spread = np.sqrt(fit.covariance[:, 0, 0] + (0.5 * length) ** 2 * fit.covariance[:, 1, 1])
    return lines.reshape(-1, 4, 3), spread.reshape(-1, 4), good.reshape(-1, 4)


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
