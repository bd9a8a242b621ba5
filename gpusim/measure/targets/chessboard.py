"""Find a chessboard in an image: OpenCV's sector detector, then our own fit of every corner.

Detection works on a reduced picture (the sector-based detector of Duda & Frese, "Accurate detection
and localization of checkerboard corners", BMVC 2018, or the older quad detector where that one
fails), since it only has to be right to some pixels. Sub-pixel positions come from
`gpusim.measure.targets.crossings` in the full image.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.measure.images import FloatArray, check_image, eight_bit
from gpusim.measure.targets.boards import Chessboard, Sighting, grid_steps
from gpusim.measure.targets.crossings import fit_crossings
from gpusim.parallel.blas_threads import one_blas_thread
from gpusim.validation import unmasked

__all__ = ["find_chessboard"]

DETECTION_SIZES = (1000, 1800, 500, 3200)  # px on the longer side, tried in this order
ATTEMPTS = 3  # detections that are tried while a whole line of corners is missing
MIN_STEP = 6.0  # px between corners
MIN_SHARE = 0.5  # of the corners that have to be fitted


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
    if not (0 <= x0 < x1 <= array.shape[1] and 0 <= y0 < y1 <= array.shape[0]):
        raise InputError(
            f"find_chessboard region; got {region}; expected left < right <= {array.shape[1]} and "
            f"top < bottom <= {array.shape[0]}"
        )
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


def _fitted(array: npt.NDArray[Any], board: Chessboard, rough: FloatArray) -> Sighting:
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
    return Sighting(
        board=places[ok],
        image=fit.points[ok],
        sigma=fit.sigma[ok],
        contrast=fit.contrast[ok],
        blur=fit.blur[ok],
        resolution=(width, height),
        missed=int(np.count_nonzero(~ok)),
        turns=board.turns,
    )


def _detections(
    grey: npt.NDArray[np.uint8], corners: tuple[int, int], longest: int
) -> Iterator[FloatArray]:
    """Rough corner positions (N, 2) in row order, as one detector after the other sees them.

    ``longest``: side of the whole image, which decides the sizes; a part of it is as much reduced.
    """
    # each detector over all sizes: the sector-based one first, the quad detector as a last resort
    sizes = [size for size in DETECTION_SIZES if size < 0.9 * longest] or [longest]
    if longest <= DETECTION_SIZES[-1] and longest not in sizes:
        sizes.append(longest)
    # whole pixels are put together: exact, and many times faster than any other share
    factors = list(dict.fromkeys(max(1, round(longest / size)) for size in sizes))
    kept: dict[int, npt.NDArray[np.uint8]] = {}

    def reduced(factor: int) -> tuple[int, npt.NDArray[np.uint8]]:
        # the first size nearly always does, and reducing costs as much as detecting
        if factor not in kept:
            kept[factor] = _reduced(grey, factor)
        return factor, kept[factor]

    for flags in (0, cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_NORMALIZE_IMAGE):
        for factor, small in map(reduced, factors):
            found, points = cv2.findChessboardCornersSB(small, corners, flags=flags)
            if found:
                yield _full_size(points, factor)
    for factor, small in map(reduced, factors):
        flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
        found, points = cv2.findChessboardCorners(small, corners, flags=flags)
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


def _full_size(points: npt.NDArray[Any], factor: int) -> FloatArray:
    flat = np.asarray(points, dtype=np.float64).reshape(-1, 2)
    result: FloatArray = (flat + 0.5) * factor - 0.5
    return result


def _upright(grid: FloatArray) -> FloatArray:
    """The grid (rows, columns, 2) turned so that it isn't mirrored: down is right of across."""
    across, down = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
    mirrored = across[0] * down[1] - across[1] * down[0] < 0
    return grid[:, ::-1] if mirrored else grid
