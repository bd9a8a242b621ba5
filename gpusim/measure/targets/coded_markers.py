"""Coded markers (ArUco, AprilTag): OpenCV reads their numbers, our own fit places their corners.

`cv2.aruco` sets corners to some hundredths of a pixel at best. Here each side of the dark square is
fitted as a border with the lens's blur and the pixels' area
(`gpusim.measure.fitting.square_sides`), without its ends, where the next side is seen; corners are
where neighbouring sides meet. Behind a lens that bends them they would meet some tenths of a pixel
from there, which is taken off.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.field_summary import field_summary
from gpusim.measure.fitting.plumb_lines import (
    PlumbField,
    Straighten,
    field_of_bends,
    straight_offsets,
)
from gpusim.measure.fitting.square_sides import Sides, SideSamples, fit_sides, side_samples
from gpusim.measure.images import FloatArray, check_image, eight_bit
from gpusim.parallel.blas_threads import one_blas_thread
from gpusim.validation import unmasked

__all__ = ["Codes", "check_dictionary", "find_aruco"]

ROUNDS = 4  # fits of the sides, of how the lens bends them, and again
STEPS = 5  # from where straight sides would meet to where bent ones do


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

    number: npt.NDArray[np.int64]
    corners: FloatArray
    centre: FloatArray
    sigma: FloatArray
    missed: int
    __repr__ = field_summary

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
    found, numbers, _ = cv2.aruco.ArucoDetector(known).detectMarkers(eight_bit(array))
    if numbers is None or len(numbers) == 0:
        return Codes(np.zeros(0, np.int64), np.zeros((0, 4, 2)), np.zeros((0, 2)), np.zeros(0), 0)
    number = np.asarray(numbers, dtype=np.int64).reshape(-1)
    rough = np.asarray(found, dtype=np.float64).reshape(-1, 4, 2)
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


def _gathered(number: npt.NDArray[np.int64], sides: Sides, straighten: Straighten | None) -> Codes:
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
    centre: FloatArray = about + away
    sigma: FloatArray = np.asarray(np.sqrt((spread**2).mean(axis=1)), dtype=np.float64)
    return Codes(number, corners, centre, sigma, missed)


def _solved(system: FloatArray, right: FloatArray) -> FloatArray:
    """Places (M, 4, 2) where two lines meet: systems (M, 4, 2, 2) and right sides (M, 4, 2)."""
    return np.asarray(np.linalg.solve(system, right[..., None])[..., 0])


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
