"""Displacements of points over time, from a sequence of pictures.

Pictures are read one at a time; of each nothing is kept but the displacements. A subset is looked
for where it would be if it went on as between the two pictures before.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Bool, Float
from gpusim.field_summary import field_summary
from gpusim.files.frame_source import Frames, FrameSource, read_frames
from gpusim.measure.correlation.matching import Status
from gpusim.measure.correlation.start_values import global_shift
from gpusim.measure.images import Image, check_image, check_points
from gpusim.measure.vibration.displacement_methods import LocalPhase, LucasKanade
from gpusim.measure.vibration.sampling import picture_alike, sampling_rate
from gpusim.measure.vibration.shifted_subsets import Method, ShiftedSubsets
from gpusim.parallel.blas_threads import one_blas_thread
from gpusim.validation import checked, finite_numbers, real_numbers, require, require_one_of

DisplacementMethod = Literal["lucas-kanade", "gradient", "phase"]
METHODS: dict[str, Method] = {
    "lucas-kanade": LucasKanade(),
    "gradient": LucasKanade(steps=1),
    "phase": LocalPhase(),
}
SMALLEST, LARGEST = 7, 255  # px
MOST_LOST = 0.5  # share of points; beyond, the motion of the whole picture is looked for


@dataclass(frozen=True)
class PointSeries:
    """Displacements of P points in T pictures.

    Attributes
    ----------
    times : (T,) float64, s; NaN if nobody said.
    points : (P, 2) float64, x, y in the reference, px.
    displacement : (T, P, 2) float64, px; NaN where a point wasn't found.
    status : (P,) int8, values of ``Status``: ``OK``, or why a point was first not found.
    method : how they were found.
    line_time : s from one row's exposure to the next's; ``times`` are those of the first row.

    Examples
    --------
    >>> frames = gs.read_frames(["before.png", "after.png"], times=[0, 0.5])
    >>> series = gs.measure.point_series(frames, [[80, 60]])
    >>> series.displacement[1].round(2) + 0.0
    array([[0.25, 0.  ]])
    """

    times: Float
    points: Float
    displacement: Float
    status: npt.NDArray[np.int8]
    method: str
    line_time: float = 0.0
    __repr__ = field_summary

    @classmethod
    @checked
    def of(
        cls, times: npt.ArrayLike, points: npt.ArrayLike, displacement: npt.ArrayLike
    ) -> PointSeries:
        """Of displacements (T, P, 2) px that were measured in any other way; NaN: not found."""
        when, places = real_numbers(times, "times"), check_points(points, "points")
        require(when.ndim == 1, "times: wrong shape", when.shape, "(T,)")
        moved = real_numbers(displacement, "displacement")
        shape = (len(when), len(places), 2)
        require(moved.shape == shape, "displacement: wrong shape", moved.shape, f"{shape}")
        known = np.isfinite(moved).all(axis=(0, 2))
        status = np.where(known, Status.OK, Status.NO_GUESS).astype(np.int8)
        return cls(when, places, moved, status, "given")

    @property
    def ok(self) -> Bool:
        """(P,) bool: the points that were found in all pictures."""
        return np.asarray(self.status == Status.OK)

    @property
    def delays(self) -> Float:
        """(P,) s from the time of a picture to that of each point's row."""
        return self.line_time * self.points[:, 1]

    @property
    def rate_Hz(self) -> float:
        """Pictures a second. InputError if times aren't known, or not even."""
        return sampling_rate(self.times)


@checked
@one_blas_thread()
def point_series(
    frames: Frames | FrameSource,
    points: npt.ArrayLike,
    *,
    method: DisplacementMethod = "lucas-kanade",
    subset: int = 21,
    direction: npt.ArrayLike | None = None,
    reference: Image | None = None,
    progress: Callable[[int, Float], None] | None = None,
) -> PointSeries:
    """Follow points through a sequence of pictures, each against one reference.

    Parameters
    ----------
    frames : pictures, as `read_frames` takes them; read one at a time.
    points : (P, 2) x, y in the reference; subsets lie around the nearest pixels.
    method : "lucas-kanade": subsets, iterated; "gradient": its first step alone, for motions that
        are small beside the pattern; "phase": local phase of Gabor filters of a quarter of
        the subset, which changes of light don't touch.
    subset : odd width of the square subsets, px.
    direction : (2,) along which points move, if that is known: an edge shows no more than
        the motion across it. None: any; points that show one direction alone aren't measured.
    reference : (H, W) picture at rest; None: the first.
    progress : called with each picture's number and its displacements (P, 2).

    Raises
    ------
    InputError
        An argument is wrong, or a picture isn't of the reference's size. A point that can't be
        measured is no error: see ``status``.

    Examples
    --------
    >>> frames = gs.read_frames(["before.png", "after.png"])
    >>> series = gs.measure.point_series(frames, [[80, 60], [1, 1]], method="phase")
    >>> [gs.measure.Status(status).name for status in series.status]
    ['OK', 'OUTSIDE']
    """
    require_one_of("method", method, get_args(DisplacementMethod))
    fits = subset % 2 == 1 and SMALLEST <= subset <= LARGEST
    require(fits, "subset", subset, f"an odd whole number of px, {SMALLEST}..{LARGEST}")
    source = frames if isinstance(frames, FrameSource) else read_frames(frames)
    first = check_image(source[0] if reference is None else reference, "reference")
    places = check_points(points, "points")
    subsets = ShiftedSubsets(first, places, subset, _directions(direction), METHODS[method])
    displacement = np.full((len(source), len(places), 2), np.nan)
    status = subsets.status.copy()
    start = before = np.zeros((len(places), len(subsets.directions)))
    for number in range(len(source)):
        picture = picture_alike(source, number, first)
        distance, found = _found(subsets, first, picture, start)
        displacement[number] = distance @ subsets.directions
        status = np.where(status == Status.OK, found, status)
        if progress is not None:
            progress(number, displacement[number])
        known = np.isfinite(distance)
        last, before = before, np.where(known, distance, before)
        start = np.where(known, 2.0 * before - last, before) if number else before
    return PointSeries(source.times.copy(), places, displacement, status, method, source.line_time)


def _found(
    subsets: ShiftedSubsets, first: Image, picture: Image, start: Float
) -> tuple[Float, npt.NDArray[np.int8]]:
    """As `ShiftedSubsets.found`; what isn't found is looked for again where the others went, or,
    where most aren't found, from the motion of the whole picture."""
    distance, status = subsets.found(picture, start)
    lost = (status != Status.OK) & (subsets.status == Status.OK)
    if lost.any():
        if lost.sum() > MOST_LOST * (subsets.status == Status.OK).sum():
            shift = global_shift(first, picture) @ subsets.directions.T
        else:
            shift = np.nanmedian(distance, axis=0)
        again, status_again = subsets.found(picture, np.tile(shift, (len(start), 1)))
        lost &= status_again == Status.OK
        distance[lost], status[lost] = again[lost], Status.OK
    return distance, status


def _directions(direction: npt.ArrayLike | None) -> Float:
    """Unit vectors (U, 2) of the motions that are looked for."""
    if direction is None:
        return np.eye(2)
    vector = finite_numbers(direction, "direction", [(2,)], "(2,): x and y")
    length = float(np.hypot(*vector))
    require(length > 0, "direction", vector.tolist(), "a vector that isn't 0")
    return np.asarray(vector[None] / length)
