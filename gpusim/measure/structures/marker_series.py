"""Markers of a first picture followed through those after it.

Each is looked for where it would be if it went on as between the two pictures before, and within
half its own width; what isn't there is looked for again around its last place, as far as its
neighbours allow, since all markers look alike. So one that was hidden is found again where it got
lost.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float
from gpusim.measure.correlation.matching import DicResult, Status
from gpusim.measure.structures.marker_crosses import (
    LEAST_WIDTH,
    SEARCH_SHARE,
    CrossFits,
    find_crosses,
)
from gpusim.measure.targets.checker_markers import find_markers
from gpusim.parallel.blas_threads import one_blas_thread
from gpusim.validation import require

FURTHEST = 0.45, 5.0  # that a lost marker is looked for: of the way to its neighbour, and widths
SIZES = 0.8, 1.25  # widths over those in the picture before, where a marker is looked for first
SAME_PLACE = 0.25  # of a width: two markers can't be so near to each other


def first_markers(picture: npt.NDArray[np.generic], size_px: tuple[float, float]) -> CrossFits:
    """All checker markers of a picture whose widths lie in ``size_px``, row by row. InputError if
    there are none."""
    fits = LEAST_WIDTH <= size_px[0] <= size_px[1] < np.inf
    require(fits, "`markers_px`", size_px, f"(lowest, highest) width, at least {LEAST_WIDTH:g} px")
    found = find_markers(picture, size_px)
    seen = np.isfinite(found.size).any(axis=1)
    widths = np.nanmax(found.size[seen], axis=1, initial=size_px[0])
    crosses = find_crosses(picture, found.points[seen], widths)
    expected = f"some {size_px[0]:g} to {size_px[1]:g} px wide in the first picture"
    require(crosses.known.any(), "markers", "none", expected)
    return crosses.rows(crosses.known)


@one_blas_thread()
def followed_markers(
    pictures: Iterable[npt.NDArray[np.generic]], first: CrossFits
) -> Iterator[DicResult]:
    """The markers ``first`` of the first of the ``pictures`` in all of them, one picture after the
    other; what isn't found has the status LOW_CORRELATION."""
    widths = _widths(first)
    apart = _distances(first.points)
    reach = np.minimum(FURTHEST[0] * apart.min(axis=1, initial=np.inf) / widths, FURTHEST[1])
    before, last, count = first.points, first.points, len(widths)
    for number, picture in enumerate(pictures):
        found = first
        if number:
            found = find_crosses(picture, 2.0 * last - before, widths, SEARCH_SHARE, SIZES)
        lost = ~found.known
        if lost.any():
            near = np.where(lost[:, None], last, np.nan)
            again = find_crosses(picture, near, widths, float(reach[lost].min()))
            claimed = _distances(np.where(lost[:, None], again.points, found.points))
            lost &= ~(claimed < SAME_PLACE * widths[:, None]).any(axis=1)  # false for NaN
            found = found.where(~lost, again)
        status = np.where(found.known, Status.OK, Status.LOW_CORRELATION).astype(np.int8)
        sigma = np.hypot(first.sigma, found.sigma) if number else np.zeros(count)
        yield DicResult(
            first.points, found.points - first.points, np.zeros((count, 2, 2)),
            np.full(count, np.nan), sigma, np.zeros(count, np.int32), status, subset=0,
        )  # fmt: skip
        known = found.known[:, None]
        now = np.where(known, found.points, last)
        before, last = np.where(known, last, now), now
        widths = np.where(found.known, _widths(found), widths)


def _widths(crosses: CrossFits) -> Float:
    return np.asarray(2.0 * np.linalg.norm(crosses.arms, axis=2).max(axis=1))


def _distances(points: Float) -> Float:
    """(M, M) of each to the others, infinite to itself."""
    apart = np.linalg.norm(points[:, None] - points, axis=2)
    np.fill_diagonal(apart, np.inf)
    return np.asarray(apart)
