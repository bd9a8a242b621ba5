"""Find the centres of 2x2 checker markers: Harris response, symmetry check, exact edge fit.

The cross of a 2x2 checker is where two straight black-white borders meet. Harris finds it to a
pixel; a ring of samples around it must be equal at opposite sides and opposite at right angles;
then a model of two crossing borders, each integrated over the square pixel, is fitted to the grey
values. ``cv2.cornerSubPix`` isn't used: on perfect images it is off by 0.035-0.08 px.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import scipy

from gpusim.arrays.array_types import Bool, Float, Single
from gpusim.field_summary import field_summary
from gpusim.measure.images import Image, check_image, check_points
from gpusim.measure.targets.cross_fit import fit_crosses
from gpusim.measure.targets.noise import allowed_residual, noise_level
from gpusim.parallel.blas_threads import one_blas_thread
from gpusim.validation import require, unmasked

MIN_RESPONSE = 0.01  # lowest Harris response over the highest of the image
MAX_RESIDUAL = 0.15  # RMS of what a fit leaves over the contrast, besides the picture's noise
HARRIS_K = 0.04
RING = 48  # samples per ring
MIN_HALF_TURN = 0.5  # correlation of a ring with itself turned by 180 degrees
MAX_QUARTER_TURN = -0.4  # and by 90 degrees
SAME_START = 1.0  # px: two starts nearer to each other end at the same marker
MIN_STEP = 0.02  # contrast of a marker over the grey range of the image
# least-squares quadratic over 5x5 pixels: value, slopes, and second derivatives xx, xy, yy
_X, _Y = (axis.ravel() for axis in np.meshgrid(np.arange(-2.0, 3.0), np.arange(-2.0, 3.0)))
QUADRATIC = np.linalg.pinv(
    np.column_stack([np.ones(25), _X, _Y, 0.5 * _X**2, _X * _Y, 0.5 * _Y**2])
)


class MarkerStatus(IntEnum):
    """What became of an expected marker. Only ``FOUND`` ones carry numbers.

    Examples
    --------
    >>> image = gs.export.read_image("markers.png")
    >>> found = gs.measure.locate_markers(image, [[80, 20]], size_px=(15, 25), search_px=5)
    >>> gs.measure.MarkerStatus(found.status[0]).name
    'NOT_FOUND'
    """

    FOUND = 0
    NOT_FOUND = 1
    OUTSIDE = 2  # the place where it is expected lies outside the image
    AMBIGUOUS = 3  # two markers within the search radius, or one claimed twice


@dataclass(frozen=True)
class Markers:
    """M markers; rows of a marker that wasn't found are NaN.

    Attributes
    ----------
    points : (M, 2) float64, centres x, y, px.
    size : (M, 2) float64, widths along the two borders, px (NaN where an end isn't seen).
    angle : (M,) float64, direction of the border nearest to +x, rad in [-pi/4, pi/4), turning
        from +x to +y (down in the image).
    contrast : (M,) float64, half the step between white and black in grey levels; positive if
        the quadrant between +x and +y (turned by ``angle``) is white.
    residual : (M,) float64, RMS of the border fit over ``|contrast|``.
    status : (M,) int8, values of ``MarkerStatus``.

    Examples
    --------
    >>> found = gs.measure.find_markers(gs.export.read_image("markers.png"), size_px=(15, 25))
    >>> found.points.round(2), int(found.ok.sum())
    (array([[ 39.5,  59.5],
           [119.5,  59.5]]), 2)
    """

    points: Float
    size: Float
    angle: Float
    contrast: Float
    residual: Float
    status: npt.NDArray[np.int8]
    __repr__ = field_summary

    @property
    def ok(self) -> Bool:
        """(M,) bool: the markers that were found."""
        return np.asarray(self.status == MarkerStatus.FOUND)


@unmasked("image")
@one_blas_thread()
def find_markers(
    image: npt.NDArray[Any],
    size_px: tuple[float, float],
    *,
    min_response: float = MIN_RESPONSE,
    max_residual: float = MAX_RESIDUAL,
) -> Markers:
    """Find every 2x2 checker marker whose width lies in ``size_px`` = (lowest, highest), >= 10 px.

    Centres are good to 0.01 px on sharp area-sampled images, row by row from the top left.
    ``min_response`` is the lowest Harris response over the highest of the image, ``max_residual``
    what a fit may leave over the contrast; more in noisy pictures, by their noise.

    Examples
    --------
    >>> image = gs.export.read_image("markers.png")
    >>> gs.measure.find_markers(image, size_px=(15, 25)).points.round(2)
    array([[ 39.5,  59.5],
           [119.5,  59.5]])
    """
    array = check_image(image, "image")
    low, high = _check_size(size_px)
    fits = 0 < min_response < 1 and 0 < max_residual < 1
    require(fits, "min_response, max_residual", f"{min_response!r}, {max_residual!r}", "0..1")
    (crosses,) = _crosses(array, [_Window(array)], low, high, min_response, max_residual)
    return _markers(crosses, np.zeros(len(crosses), dtype=np.int8))


@dataclass(frozen=True)
class _Window:
    """A part of an image where markers are looked for: its first pixel x, y, and its size; with
    ``near`` = (x, y, distance) in the image only what may end within that distance."""

    pixels: Image
    corner: tuple[int, int] = (0, 0)
    near: tuple[float, float, float] | None = None


def _crosses(
    image: Image,
    windows: Sequence[_Window],
    low: float,
    high: float,
    min_response: float,
    max_residual: float,
) -> list[Float]:
    """The markers of each window as `fit_crosses` gives them."""
    greys = [_grey(window.pixels) for window in windows]
    places = [
        _candidates(grey, window, low, min_response) if span > 0 else np.zeros((0, 2))
        for window, (grey, span) in zip(windows, greys, strict=True)
    ]
    fits = fit_crosses(image, np.concatenate([np.zeros((0, 2)), *places]), low, high)
    owner = np.repeat(np.arange(len(windows)), [len(one) for one in places])
    markers = []
    for k, (grey, span) in enumerate(greys):
        crosses = fits[(owner == k) & np.isfinite(fits[:, 0])]
        most: float | Float = max_residual
        if not (crosses[:, 4] <= max_residual).all():
            most = allowed_residual(max_residual, span * noise_level(grey), crosses[:, 3])
        markers.append(_distinct(crosses[crosses[:, 4] <= most], low))
    return markers


def _candidates(grey: Single, window: _Window, size: float, min_response: float) -> Float:
    """Places (K, 2) in the image that look like the centre of a marker, ``size`` px wide at least;
    ``grey`` is the window's."""
    smooth = np.asarray(cv2.GaussianBlur(grey, (0, 0), size / 8.0), dtype=np.float32)
    # as far as a fit may move, and as two that are one may lie apart
    x0, y0 = window.corner
    x, y, distance = window.near or (0.0, 0.0, np.inf)
    limit, centre = distance + max(2.0, 0.2 * size) + 0.25 * size, (x - x0, y - y0)
    kept: list[tuple[float, float]] = []
    for corner in _corner_pixels(grey, size, min_response):
        if np.hypot(corner[0] - centre[0], corner[1] - centre[1]) > limit + max(2.0, size / 3):
            continue
        place = _saddle(smooth, corner, size)
        if place is None or np.hypot(place[0] - centre[0], place[1] - centre[1]) > limit:
            continue
        # several peaks of the response lead to one saddle
        if any(np.hypot(place[0] - x, place[1] - y) < SAME_START for x, y in kept):
            continue
        if _checkered(grey, place, size):
            kept.append(place)
    return np.array(kept).reshape(-1, 2) + window.corner


@unmasked("image")
@one_blas_thread()
def locate_markers(
    image: npt.NDArray[Any],
    expected: npt.ArrayLike,
    size_px: tuple[float, float],
    search_px: float,
) -> Markers:
    """Find the marker near each expected position (M, 2); the result keeps that order.

    A marker further away than ``search_px`` is ``NOT_FOUND``; two within it are ``AMBIGUOUS``,
    and so is one marker that is the nearest of two expected positions.

    Examples
    --------
    >>> image = gs.export.read_image("markers.png")
    >>> found = gs.measure.locate_markers(image, [[120, 60]], size_px=(15, 25), search_px=5)
    >>> found.points.round(2)
    array([[119.5,  59.5]])
    """
    array = check_image(image, "image")
    places = check_points(expected, "expected")
    low, high = _check_size(size_px)
    require(0 < search_px < np.inf, "search_px", repr(search_px), "px > 0")
    count = len(places)
    status = np.full(count, MarkerStatus.NOT_FOUND, dtype=np.int8)
    crosses = np.full((count, 7), np.nan)
    height, width = array.shape
    reach = search_px + high
    rows: list[int] = []
    windows: list[_Window] = []
    for i, (x, y) in enumerate(places):
        if not (0 <= x <= width - 1 and 0 <= y <= height - 1):
            status[i] = MarkerStatus.OUTSIDE
            continue
        x0, y0 = max(int(x - reach), 0), max(int(y - reach), 0)
        window = array[y0 : int(y + reach) + 2, x0 : int(x + reach) + 2]
        if min(window.shape) < 7:
            continue
        rows.append(i)
        windows.append(_Window(window, (x0, y0), (x, y, search_px)))
    near = _crosses(array, windows, low, high, MIN_RESPONSE, MAX_RESIDUAL)
    for i, nearby in zip(rows, near, strict=True):
        close = nearby[np.hypot(*(nearby[:, :2] - places[i]).T) <= search_px]
        if len(close) > 1:
            status[i] = MarkerStatus.AMBIGUOUS
        elif len(close):
            status[i] = MarkerStatus.FOUND
            crosses[i] = close[0]
    apart = np.hypot(*np.moveaxis(crosses[:, None, :2] - crosses[None, :, :2], -1, 0))
    np.fill_diagonal(apart, np.inf)
    status[(apart < 0.25 * low).any(axis=1)] = MarkerStatus.AMBIGUOUS
    return _markers(np.where((status == MarkerStatus.FOUND)[:, None], crosses, np.nan), status)


def _check_size(size_px: tuple[float, float]) -> tuple[float, float]:
    low, high = float(size_px[0]), float(size_px[1])
    expected = "(lowest, highest) marker width, at least 10 px"
    require(10 <= low <= high < np.inf, "size_px", size_px, expected)
    return low, high


def _grey(image: Image) -> tuple[Single, float]:
    """The image with grey range 0..1 as float32, and its range."""
    low, high = float(image.min()), float(image.max())
    span = high - low
    if not span > 0:
        return np.zeros(image.shape, dtype=np.float32), 0.0
    return ((image.astype(np.float32) - np.float32(low)) / np.float32(span)), span


def _corner_pixels(grey: Single, size: float, min_response: float) -> list[tuple[int, int]]:
    """Pixels (x, y) where the Harris response is the highest within a third of a marker."""
    block = max(3, round(size / 5))
    response = cv2.cornerHarris(grey, block, 3, HARRIS_K)
    reach = 2 * max(1, round(size / 6)) + 1
    highest = cv2.dilate(response, np.ones((reach, reach), dtype=np.uint8))
    peak = (response >= highest) & (response > min_response * float(response.max()))
    rows, columns = np.nonzero(peak)
    return [(int(x), int(y)) for x, y in zip(columns, rows, strict=True)]


def _saddle(smooth: Single, corner: tuple[int, int], size: float) -> tuple[float, float] | None:
    """Walk from a Harris corner to the saddle point (x, y) of the smoothed image, within size / 3.

    The response is flat around a checker's centre and its peak up to 2 px off.
    """
    height, width = smooth.shape
    trail = [corner]
    for _ in range(6):
        column, row = trail[-1]
        if not (2 <= column < width - 2 and 2 <= row < height - 2):
            return None
        patch = smooth[row - 2 : row + 3, column - 2 : column + 3].astype(np.float64).ravel()
        _, by_x, by_y, xx, xy, yy = QUADRATIC @ patch
        bend = xx * yy - xy * xy
        if not bend < 0:
            return None
        dx = np.clip((xy * by_y - yy * by_x) / bend, -2, 2)
        dy = np.clip((xy * by_x - xx * by_y) / bend, -2, 2)
        following = column + round(float(dx)), row + round(float(dy))
        if following in trail:
            near = np.hypot(column - corner[0], row - corner[1]) <= max(2.0, size / 3)
            swing = trail[trail.index(following) :]  # to and fro, where the picture is flat
            x, y = np.mean(swing, axis=0) if len(swing) > 1 else (column + dx, row + dy)
            return (float(x), float(y)) if near else None
        trail.append(following)
    return None


def _checkered(grey: Single, place: tuple[float, float], size: float) -> bool:
    """Whether the rings around a place (x, y) look like a 2x2 checker.

    In a marker 10 px wide, half a pixel beside its centre, the smaller ring no longer does.
    """
    column, row = place
    height, width = grey.shape
    angle = np.arange(RING) * (2 * np.pi / RING)
    for share in (0.22, 0.32):
        radius = share * size
        reach = int(np.ceil(radius)) + 1
        if not (reach <= column < width - reach and reach <= row < height - reach):
            return False
        ring = scipy.ndimage.map_coordinates(
            grey,
            [row + radius * np.sin(angle), column + radius * np.cos(angle)],
            order=1,
        ).astype(np.float64)
        ring -= ring.mean()
        energy = float(ring @ ring)
        if not energy > RING * MIN_STEP**2:
            return False
        half_turn = float(ring @ np.roll(ring, RING // 2)) / energy
        quarter_turn = float(ring @ np.roll(ring, RING // 4)) / energy
        if not (half_turn >= MIN_HALF_TURN and quarter_turn <= MAX_QUARTER_TURN):
            return False
    return True


def _distinct(fits: Float, size: float) -> Float:
    """Drop the poorer one of two fits that ended at the same place; row by row."""
    kept: list[int] = []
    for k in np.argsort(fits[:, 4], kind="stable"):
        if (np.hypot(*(fits[kept, :2] - fits[k, :2]).T) > 0.25 * size).all():
            kept.append(int(k))
    best = fits[kept]
    return np.asarray(best[np.lexsort([best[:, 0], np.rint(best[:, 1] / size)])])


def _markers(fits: Float, status: npt.NDArray[np.int8]) -> Markers:
    angle, contrast, residual = fits[:, 2:5].T.copy()
    return Markers(fits[:, :2].copy(), fits[:, 5:].copy(), angle, contrast, residual, status)
