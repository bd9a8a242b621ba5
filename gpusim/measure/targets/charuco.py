"""Find a ChArUco board: OpenCV tells the corners by their markers, our own fit places them.

Partly hidden boards are fine, since every corner has a number.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.measure.images import check_image, eight_bit
from gpusim.measure.targets.boards import Sighting, grid_steps
from gpusim.measure.targets.coded_markers import check_dictionary
from gpusim.measure.targets.crossings import fit_crossings
from gpusim.parallel.blas_threads import one_blas_thread
from gpusim.validation import unmasked

__all__ = ["CharucoBoard", "find_charuco"]

RIM_SHARE = 0.85  # of the white rim around a marker: what the fit of a corner may see


@dataclass(frozen=True)
class CharucoBoard:
    """``columns`` x ``rows`` squares of side ``square``, markers of side ``marker`` (same unit).

    ``dictionary`` as OpenCV names it, without DICT_. The square at the upper left is dark.

    Examples
    --------
    >>> gs.measure.CharucoBoard(columns=4, rows=3, square=0.04, marker=0.026).corners
    (3, 2)
    """

    columns: int
    rows: int
    square: float
    marker: float
    dictionary: str = "4X4_50"

    def __post_init__(self) -> None:
        if not (self.columns >= 3 and self.rows >= 3):
            raise InputError(f"CharucoBoard; got {self.columns} x {self.rows}; expected 3 x 3 up")
        if not 0 < self.marker < self.square < np.inf:
            raise InputError(
                f"CharucoBoard: got marker {self.marker}, square {self.square}; expected "
                "0 < marker < square"
            )
        markers = len(check_dictionary(self.dictionary, "CharucoBoard dictionary").bytesList)
        if self.columns * self.rows // 2 > markers:
            raise InputError(
                f"CharucoBoard dictionary: got {self.dictionary} of {markers} markers; expected at "
                f"least {self.columns * self.rows // 2} for {self.columns} x {self.rows} squares"
            )

    @property
    def corners(self) -> tuple[int, int]:
        """Inner corners across and down."""
        return self.columns - 1, self.rows - 1

    def detector(self) -> Any:
        """OpenCV's detector of this board."""
        dictionary = check_dictionary(self.dictionary, "CharucoBoard dictionary")
        size = self.columns, self.rows
        return cv2.aruco.CharucoDetector(
            cv2.aruco.CharucoBoard(size, self.square, self.marker, dictionary)
        )


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
    return Sighting(
        board=places[ok].astype(np.float64),
        image=fit.points[ok],
        sigma=fit.sigma[ok],
        contrast=fit.contrast[ok],
        blur=fit.blur[ok],
        resolution=resolution,
        missed=total - int(np.count_nonzero(ok)),
    )
