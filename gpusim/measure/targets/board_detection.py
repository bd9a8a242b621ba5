"""Find boards in an image: OpenCV tells their corners, our own fit places every one of them.

Chessboards are detected in a reduced picture (by the sector-based detector of Duda & Frese,
"Accurate detection and localization of checkerboard corners", BMVC 2018, or the older quad detector
where that one fails), since that only has to be right to some pixels. Corners of ChArUco boards are
told by the markers, so that partly hidden boards are fine. Sub-pixel positions come from
`gpusim.measure.targets.crossings` in the full image.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache, partial
from itertools import islice, product
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.measure.images import check_image, eight_bit
from gpusim.measure.targets.boards import Board, CharucoBoard, Chessboard, Sighting
from gpusim.measure.targets.crossings import fit_crossings
from gpusim.parallel.blas_threads import one_blas_thread
from gpusim.validation import require, unmasked

DETECTION_SIZES = (1000, 1800, 500, 3200)  # px on the longer side, tried in this order
ATTEMPTS = 3  # detections that are tried while a whole line of corners is missing
NOISY_SIZE = 2**20  # px in a picture, above which the quad detector gets it smoothed
MIN_STEP = 6.0  # px between corners
MIN_SHARE = 0.5  # of the corners that have to be fitted
RIM_SHARE = 0.85  # of the white rim around a marker: what the fit of a corner may see


@unmasked("image")
@one_blas_thread()
def find_chessboard(
    image: npt.NDArray[Any],
    board: Chessboard,
    region: tuple[int, int, int, int] | None = None,
) -> Sighting:
    """The inner corners of ``board`` in a grey image.

    Corners are good to 0.001 px on sharp area-sampled images without noise. Corners whose fit
    fails (covered, clipped, smeared) are left out. A board that isn't found gives a sighting
    without points that says why. Where it can be told, the first corner is the one beside the
    dark field (`Chessboard.unique`). ``region`` (left, top, right, bottom), px: where the board
    is looked for, the whole image unless given.

    Raises
    ------
    InputError
        Not a grey image, or a region outside of it.

    Examples
    --------
    >>> board = gs.measure.Chessboard(columns=7, rows=6, square=0.015)
    >>> gs.measure.find_chessboard(gs.export.read_image("board-0.png"), board).image.shape
    (30, 2)
    """
    array = check_image(image, "image")
    x0, y0, x1, y1 = region or (0, 0, array.shape[1], array.shape[0])
    fits = 0 <= x0 < x1 <= array.shape[1] and 0 <= y0 < y1 <= array.shape[0]
    expected = f"left < right <= {array.shape[1]} and top < bottom <= {array.shape[0]}"
    require(fits, "find_chessboard region", region, expected)
    height, width = array.shape
    across, down = board.corners
    nothing = (width, height), across * down
    best = Sighting.none(*nothing, "no board found")
    looked_at = eight_bit(array[y0:y1, x0:x1])
    for rough in islice(_detections(looked_at, board.corners, max(array.shape)), ATTEMPTS):
        seen = _fitted(array, board, rough + np.array([x0, y0]))
        if len(seen.image) > len(best.image) or not len(best.image):
            best = seen
        # a grid that is off by one line has no corners along another one
        if len(best.image) > across * down - min(across, down):
            break
    return best


def _fitted(array: npt.NDArray[Any], board: Chessboard, rough: Float) -> Sighting:
    """The corners near rough ones (N, 2), in row order, and which of the board's they are."""
    height, width = array.shape
    across, down = board.corners
    nothing = (width, height), across * down
    grid = _upright(rough.reshape(down, across, 2))
    index = np.stack(np.meshgrid(np.arange(across), np.arange(down)), axis=-1).reshape(-1, 2)
    flat = grid.reshape(-1, 2)
    first, second, _ = grid_steps(flat, index)
    shortest = min(np.linalg.norm(first, axis=1).min(), np.linalg.norm(second, axis=1).min())
    if not shortest >= MIN_STEP:
        return Sighting.none(*nothing, "fields too small")
    fit = fit_crossings(array, flat, first, second, index=index)
    if not np.count_nonzero(fit.ok) >= MIN_SHARE * len(flat):
        return Sighting.none(*nothing, "corners not sharp")
    # the field between corner (i, j) and the next ones is dark where i + j is even
    fits = (index.sum(axis=1) % 2 == 0) == (fit.contrast < 0)
    places = board.points()
    if 2 * np.count_nonzero(fits & fit.ok) < np.count_nonzero(fit.ok):
        # upside down; or a board that can't be told from itself and begins with a light field
        fits = ~fits
        places = places[::-1] if board.unique else places
    ok = fit.ok & fits
    if not np.count_nonzero(ok) >= MIN_SHARE * len(flat):
        return Sighting.none(*nothing, "colours don't fit a board")
    return Sighting.fitted(places, fit, ok, (width, height), len(places), board.turns)


def _detections(
    grey: npt.NDArray[np.uint8], corners: tuple[int, int], longest: int
) -> Iterator[Float]:
    """Rough corner positions (N, 2) in row order, as one detector after the other sees them.

    ``longest``: side of the whole image, which decides the sizes; a part of it is as much reduced.
    """
    # each detector over all sizes: the sector-based one first, the quad detector as a last resort
    sizes = [size for size in DETECTION_SIZES if size < 0.9 * longest] or [longest]
    if longest <= DETECTION_SIZES[-1] and longest not in sizes:
        sizes.append(longest)
    # whole pixels are put together: exact, and many times faster than any other share
    factors = list(dict.fromkeys(max(1, round(longest / size)) for size in sizes))
    # the first size nearly always does, and reducing costs as much as detecting
    reduced = cache(partial(_reduced, grey))
    detectors = (
        (cv2.findChessboardCornersSB, 0),
        (cv2.findChessboardCornersSB, cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_NORMALIZE_IMAGE),
        (cv2.findChessboardCorners, cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE),
    )
    for (detect, flags), factor in product(detectors, factors):
        picture = reduced(factor)
        if detect is cv2.findChessboardCorners and picture.size > NOISY_SIZE:
            # of noise, which equalising spreads over all grey levels, it makes so many quads that
            # comparing each with each takes half a minute, if there is no whole board to end it
            picture = np.asarray(cv2.GaussianBlur(picture, (0, 0), 1.0), dtype=np.uint8)
        found, points = detect(picture, corners, flags=flags)
        if found:
            yield _full_size(points, factor)


def _reduced(grey: npt.NDArray[np.uint8], factor: int) -> npt.NDArray[np.uint8]:
    """The mean of each factor x factor pixels; without what is left over at the far borders."""
    if factor == 1:
        return grey
    height, width = (size // factor for size in grey.shape)
    whole = grey[: height * factor, : width * factor]
    small = cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA)
    return np.asarray(small, dtype=np.uint8)


def _full_size(points: npt.NDArray[Any], factor: int) -> Float:
    flat = np.asarray(points, dtype=np.float64).reshape(-1, 2)
    result: Float = (flat + 0.5) * factor - 0.5
    return result


def _upright(grid: Float) -> Float:
    """The grid (rows, columns, 2) turned so that it isn't mirrored: down is right of across."""
    across, down = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
    mirrored = across[0] * down[1] - across[1] * down[0] < 0
    return grid[:, ::-1] if mirrored else grid


@unmasked("image")
@one_blas_thread()
def find_charuco(image: npt.NDArray[Any], board: CharucoBoard) -> Sighting:
    """The inner corners of ``board`` in a grey image; board places as in `Chessboard`.

    A board that isn't found gives a sighting without points that says why. Raises InputError for
    anything else.

    Examples
    --------
    >>> board = gs.measure.CharucoBoard(columns=4, rows=3, square=0.04, marker=0.026)
    >>> gs.measure.find_charuco(gs.export.read_image("charuco.png"), board).image[0].round(2)
    array([47.5, 43.5])
    """
    array = check_image(image, "image")
    across = board.columns - 1
    total = across * (board.rows - 1)
    resolution = array.shape[1], array.shape[0]
    rough, numbers, _, _ = board.detector().detectBoard(eight_bit(array))
    if numbers is None or len(numbers) < 4:
        return Sighting.none(resolution, total, "no board found")
    number = np.asarray(numbers).reshape(-1).astype(np.int64)
    index = np.stack([number % across, number // across], axis=1)
    near = np.asarray(rough, dtype=np.float64).reshape(-1, 2)
    first, second, known = grid_steps(near, index)
    share = RIM_SHARE * 0.5 * (1.0 - board.marker / board.square)
    fit = fit_crossings(array, near, first, second, share=share, index=index)
    # the square between corner (i, j) and the next ones is dark where i + j is even
    dark = index.sum(axis=1) % 2 == 0
    ok = fit.ok & known & ((fit.contrast < 0) == dark)
    if not np.count_nonzero(ok) >= 4:
        return Sighting.none(resolution, total, "corners not sharp")
    places = np.column_stack([index * board.square, np.zeros(len(index))])
    return Sighting.fitted(places, fit, ok, resolution, total)


def find_board(
    image: npt.NDArray[Any], board: Board, region: tuple[int, int, int, int] | None = None
) -> Sighting:
    """As `find_charuco` or `find_chessboard`, which alone gains by a ``region``."""
    if isinstance(board, CharucoBoard):
        return find_charuco(image, board)
    return find_chessboard(image, board, region)


def grid_steps(points: Float, index: Long) -> tuple[Float, Float, Bool]:
    """Steps (N, 2) in px to the next point across and down, from neighbours in a grid.

    ``index`` (N, 2) is each point's column and row. The third result tells which points have a
    neighbour in both directions; the steps of others are zero.
    """
    place = {(int(i), int(j)): k for k, (i, j) in enumerate(index)}
    steps = np.zeros((2, len(points), 2))
    known = np.ones(len(points), dtype=bool)
    for k, (i, j) in enumerate(index):
        for axis, (di, dj) in enumerate(((1, 0), (0, 1))):
            ahead, behind = place.get((i + di, j + dj)), place.get((i - di, j - dj))
            ends = (k if ahead is None else ahead, k if behind is None else behind)
            if ends[0] == ends[1]:
                known[k] = False
                continue
            count = (ahead is not None) + (behind is not None)
            steps[axis, k] = (points[ends[0]] - points[ends[1]]) / count
    return steps[0], steps[1], known
