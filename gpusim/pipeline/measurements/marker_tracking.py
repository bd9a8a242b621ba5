"""Markers found in a first image of a camera and followed into a last one.

What this sees is what a tester has: two images, where the markers were put on the unloaded
structure, and the camera's rough place (to know which marker is which).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim import measure
from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.arrays.grey import grey_of
from gpusim.errors import GpusimError
from gpusim.measure.structures.marker_crosses import (
    CrossFits,
    arms_of,
    find_crosses,
    fit_crosses,
    size_range,
)
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.sensor.sensor import Sensor
from gpusim.pipeline.measurements.marker_set import MarkerSet, check_widths
from gpusim.pipeline.measurements.results import rms
from gpusim.pipeline.pictures.exposure import level_warnings

SUBSET_SHARE = 0.95
LOST_SHARE = 0.45  # of the way to its neighbour, where a marker that got lost is looked for
TRIES = 30  # iterations; those that find a marker take 16 at most, others go on for ever
MOST_GAP = 0.2  # of a width, between a tracked subset and the fit of its cross


@dataclass(frozen=True, eq=False)
class MarkerTracks:
    """What became of M markers between two images, px; NaN where something wasn't measured.

    ``expected`` (M, 2) by the rough camera; ``points`` (M, 2) in the first image;
    ``displacement`` (M, 2); ``sigma`` (M,); ``status`` names (M,); ``clipped`` (M,) bool:
    saturated pixels within the marker; ``unrefined`` (M,) bool: measured, but without a fit of its
    cross in one of the images; ``subset`` px; ``tracking_px``: RMS difference between tracked
    subsets and the fitted crosses.
    """

    expected: Float
    points: Float
    displacement: Float
    sigma: Float
    status: npt.NDArray[np.str_]
    clipped: Bool
    unrefined: Bool
    subset: int
    tracking_px: float

    @property
    def found(self) -> Bool:
        """(M,) bool: seen in the first image."""
        return np.asarray(np.isfinite(self.points).all(axis=1))


@dataclass(frozen=True, eq=False)
class FirstPicture:
    """The M markers that were found in a camera's first ``picture``, to be followed into others.

    ``expected`` (M, 2) px by the rough camera, ``widths`` (M,) px.
    """

    marks: MarkerSet
    picture: npt.NDArray[Any]
    sensor: Sensor
    expected: Float
    widths: Float
    crosses: CrossFits

    @staticmethod
    def of(
        what: str, marks: MarkerSet, camera: Camera, picture: npt.NDArray[Any], sensor: Sensor
    ) -> FirstPicture:
        """Find the markers near where ``camera`` expects them: Harris corners, and a fit of the
        cross. Raises InputError for a marker that is too small, GpusimError if none is found."""
        expected = camera.project(marks.position)
        widths = check_widths(what, marks, camera)
        crosses = find_crosses(grey_of(picture), expected, widths)
        if not crosses.known[: marks.count].any():
            raise GpusimError(
                f"{what}: no marker of {sorted(set(marks.group_names[: marks.count]))} was found "
                f"in the first image of camera {camera.name!r}; expected {marks.count}"
                + "".join(f"; the image {text}" for text in level_warnings(picture, sensor))
            )
        return FirstPicture(marks, picture, sensor, expected, widths, crosses)

    def follow(self, picture: npt.NDArray[Any], subset: int | None = None) -> MarkerTracks:
        """Follow the markers into a ``picture``.

        IC-GN subsets follow them, and the crosses are fitted again: that is finer than the
        correlation of sharp squares.
        """
        reference, deformed = grey_of(self.picture), grey_of(picture)
        crosses, widths = self.crosses, self.widths
        points, arms = crosses.points, crosses.arms
        rows = np.flatnonzero(crosses.known)
        chains = _chains(rows, self.marks.count, len(points))
        side = subset or _odd(SUBSET_SHARE * float(widths[: self.marks.count].min()))
        tracked = measure.track(
            reference, deformed, points[rows],
            subset=side, groups=chains, search_px=_search(points[rows], chains, side),
            max_iterations=TRIES,
        )  # fmt: skip
        matched, sigma = np.full_like(points, np.nan), np.full(len(points), np.nan)
        matched[rows], sigma[rows] = tracked.displacement, tracked.sigma
        status = np.full(len(points), "NOT_FOUND", dtype=object)
        status[rows] = [measure.Status(s).name for s in tracked.status]
        # borders turn with their marker
        turn = np.tile(np.eye(2), (len(points), 1, 1))
        turn[rows] += np.where(np.isfinite(tracked.gradient), tracked.gradient, 0.0)
        arms = np.einsum("mij,maj->mai", turn, arms)
        tracks = _CrossTracks(points, matched, arms, widths, status)
        tracks.rescue(deformed, [rows[c] for c in chains])
        refined, own_sigma, _ = fit_crosses(deformed, points + matched, arms, crosses.blur)
        same = _unchanged(reference, deformed, points, matched, widths)
        refined = np.where(same[:, None], points, refined)
        own_sigma = np.where(same, crosses.sigma, own_sigma)
        gap = np.linalg.norm(refined - points - matched, axis=1)
        fine = np.asarray(gap <= MOST_GAP * widths)  # false for NaN
        moved = np.where(fine[:, None], refined - points, matched)
        sigma = np.where(fine, np.sqrt(2.0) * own_sigma, sigma)
        before, after = (self.sensor.saturated(one) for one in (self.picture, picture))
        clipped = np.array(
            [
                _clipped(before, points[i], widths[i])
                or _clipped(after, points[i] + matched[i], widths[i])
                for i in range(len(points))
            ]
        )
        unrefined = np.isfinite(moved).all(axis=1) & (crosses.rough | ~fine)
        return MarkerTracks(
            expected=self.expected,
            points=points,
            displacement=moved,
            sigma=sigma,
            status=status.astype(str),
            clipped=clipped,
            unrefined=unrefined,
            subset=side,
            tracking_px=rms(gap[fine]),
        )


@dataclass(frozen=True, eq=False)
class _CrossTracks:
    """Where correlation found crosses: ``points`` (M, 2) px in the first picture, ``matched``
    (M, 2) from there, ``arms`` (M, 2, 2), ``widths`` (M,) px, ``status`` (M,) words."""

    points: Float
    matched: Float
    arms: Float
    widths: Float
    status: npt.NDArray[Any]

    def rescue(self, image: npt.NDArray[Any], chains: Sequence[Long]) -> None:
        """Look for markers that correlation lost, in place: a turned one no longer looks the same.

        Along a member, the displacement is carried on from the neighbours before; the marker
        itself is found by its cross, nearer to there than to any other.
        """
        for chain in chains:
            for place, i in enumerate(chain[1:], start=1):
                before = [k for k in chain[:place][-2:] if self.status[k] == "OK"]
                if self.status[i] == "OK" or not before or before[-1] != chain[place - 1]:
                    continue
                gap = float(np.linalg.norm(self.points[i] - self.points[before[-1]]))
                guess = self.matched[before[-1]]
                if len(before) == 2:
                    passed = float(np.linalg.norm(self.points[before[1]] - self.points[before[0]]))
                    guess = guess + (guess - self.matched[before[0]]) * (gap / passed)
                near = self.points[i] + guess
                sizes = size_range(float(self.widths[i]))
                located = measure.locate_markers(image, near[None], sizes, LOST_SHARE * gap)
                if located.status[0] == measure.MarkerStatus.FOUND:
                    self.matched[i], self.status[i] = located.points[0] - self.points[i], "OK"
                    self.arms[i] = arms_of(located)[0]


def _unchanged(
    reference: npt.NDArray[Any],
    deformed: npt.NDArray[Any],
    points: Float,
    matched: Float,
    widths: Float,
) -> Bool:
    """Markers (M,) that show the same pixels in both pictures: the same pixels, the same centre."""
    same = np.zeros(len(points), dtype=bool)
    for i in np.flatnonzero(np.abs(matched).max(axis=1) < 0.5):  # false for NaN
        x, y = np.rint(points[i]).astype(int)
        half = int(0.75 * widths[i]) + 3
        window = np.s_[max(y - half, 0) : y + half + 1, max(x - half, 0) : x + half + 1]
        same[i] = np.array_equal(reference[window], deformed[window])
    return same


def _clipped(saturated: Bool, at: Float, width: float) -> bool:
    """Whether more than four pixels of a marker are ``saturated``, in any channel."""
    if not np.isfinite(at).all():
        return False
    x, y = np.rint(at).astype(int)
    half = int(0.6 * width) + 1
    window = saturated[max(y - half, 0) : y + half + 1, max(x - half, 0) : x + half + 1]
    return int(np.count_nonzero(window.any(axis=2) if window.ndim == 3 else window)) > 4


def _chains(rows: Long, movable: int, total: int) -> list[list[int]]:
    """The members' markers as one chain from the clamp, the static ones one by one."""
    index = {int(row): i for i, row in enumerate(rows)}
    chain = [index[row] for row in range(movable) if row in index]
    still = [[index[row]] for row in range(movable, total) if row in index]
    return [c for c in [chain, *still] if c]


def _search(points: Float, chains: list[list[int]], subset: int) -> int:
    """How far a marker is searched around its prediction: a third of the way to its neighbour."""
    gaps = [
        float(np.linalg.norm(np.diff(points[chain], axis=0), axis=1).min())
        for chain in chains
        if len(chain) > 1
    ]
    return int(np.clip(min(gaps, default=60.0) / 3.0, 4, 4 * subset))


def _odd(width: float) -> int:
    return max(9, 2 * int(np.floor(0.5 * (width - 1.0))) + 1)
