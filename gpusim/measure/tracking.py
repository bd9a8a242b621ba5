"""Follow markers that all look alike, from those that hardly move to those that move most.

A free search may lock onto the neighbour's marker, so each marker is predicted from markers
already tracked, is searched only near that prediction, and is accepted only if tracking it back
from the deformed image returns to where it came from and no other marker ended there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.gpu import Device
from gpusim.measure.icgn import correlate
from gpusim.measure.images import FloatArray, Image, check_image, check_points
from gpusim.measure.interpolation import SplineImage
from gpusim.measure.matching import Correlation, Pair, Settings, Status, Subsets
from gpusim.measure.search import search_template
from gpusim.measure.subsets import (
    DicResult,
    Window,
    check_mask,
    make_result,
    make_settings,
)
from gpusim.measure.warp import Shape

__all__ = ["TrackResult", "track"]

SOURCES = 3  # tracked markers from which each one is predicted
SURE = 0.95  # correlation from which no further prediction is tried


@dataclass(frozen=True)
class TrackResult(DicResult):
    """A ``DicResult`` with how each marker was found.

    backward : (M,) float64, distance by which tracking back missed the marker, px.
    source : (M,) int64, the marker from which it was predicted; -1: from no displacement.
    """

    backward: FloatArray
    source: npt.NDArray[np.int64]


def track(
    reference: npt.NDArray[Any],
    deformed: npt.NDArray[Any],
    points: npt.ArrayLike,
    *,
    subset: int,
    search_px: int = 10,
    groups: Sequence[Sequence[int]] | None = None,
    shape: Shape = "rigid",
    window: Window | npt.ArrayLike = "square",
    mask: npt.NDArray[np.bool_] | None = None,
    blur_px: float = 1.0,
    tolerance: float = 1e-4,
    max_iterations: int = 60,
    min_zncc: float = 0.8,
    backward_px: float = 0.05,
    device: Device | None = None,
) -> TrackResult:
    """Track M markers from ``reference`` to ``deformed``.

    Parameters
    ----------
    points : (M, 2) marker centres x, y in the reference, px, to any fraction.
    subset : odd width, px. At most the marker's width where the background behind it is textured
        or contrasts with the marker's own border: what doesn't move with the marker must stay
        out. A checker marker's own cross holds position and rotation, so "rigid" needs no more.
        1.1 to 1.5 marker widths on a plain background also let "affine" see the stretch.
    search_px : how far from its prediction a marker is searched; below half the marker distance.
    groups : chains of point indices, each along one member, beginning where it hardly moves;
        every point in one chain at most, the others aren't tracked (``NO_GUESS``). Without it one
        chain is grown from all points that are found near their own place.
    blur_px : Gaussian put over both images first, px. Hard black-white borders need it: tracking
        a perfectly sharp 19 px marker turned by 4 degrees is off by 0.045 px without it, by
        0.012 px with 1 px and 0.007 px with 1.5 px.
    shape, window, mask, tolerance, min_zncc, device : as for ``dic`` (no software adapter).
    backward_px : a marker is accepted if tracking back returns within this distance.
    """
    first = check_image(reference, "reference")
    second = check_image(deformed, "deformed")
    positions = check_points(points, "points")
    if not isinstance(search_px, (int, np.integer)) or search_px < 1:
        raise InputError(f"search_px: got {search_px!r}; expected a whole number of px >= 1")
    if not 0 < backward_px < np.inf:
        raise InputError(f"backward_px: got {backward_px!r}; expected px > 0")
    settings = make_settings(
        subset,
        window,
        shape=shape,
        tolerance=tolerance,
        max_iterations=max_iterations,
        min_zncc=min_zncc,
        max_move=max(3.0, subset / 4),
        blur_px=blur_px,
    )
    tracker = _Tracker(
        first,
        second,
        positions,
        settings,
        check_mask(mask, first, blur_px),
        int(search_px),
        float(backward_px),
        float(blur_px),
        device,
    )
    if groups is None:
        tracker.grow()
    else:
        for chain in check_groups(groups, len(positions)):
            tracker.follow(chain)
    return tracker.result(subset)


def check_groups(groups: Sequence[Sequence[int]], count: int) -> list[list[int]]:
    """Chains must name existing points, each once."""
    chains = [[int(i) for i in chain] for chain in groups]
    named = [i for chain in chains for i in chain]
    if len(set(named)) != len(named) or any(not 0 <= i < count for i in named):
        raise InputError(
            f"groups: got indices {sorted(named)}; expected each of 0..{count - 1} at most once"
        )
    return chains


@dataclass(frozen=True)
class _Match:
    """One marker matched from one prediction."""

    found: Correlation
    backward: float
    source: int

    @property
    def good(self) -> bool:
        return int(self.found.status[0]) == Status.OK

    @property
    def zncc(self) -> float:
        return float(self.found.zncc[0])


class _Tracker:
    """The markers in progress."""

    def __init__(
        self,
        reference: Image,
        deformed: Image,
        points: FloatArray,
        settings: Settings,
        mask: npt.NDArray[np.bool_] | None,
        search_px: int,
        backward_px: float,
        blur_px: float,
        device: Device | None,
    ) -> None:
        self.reference = reference
        self.deformed = deformed
        self.points = points
        self.settings = settings
        self.mask = mask
        self.search_px = search_px
        self.backward_px = backward_px
        self.blur_px = blur_px
        # markers come one after the other: what one takes is less than a software adapter's own way
        software = device is not None and device.info.get("adapter_type") == "CPU"
        self.device = None if software else device
        self.matches: list[_Match | None] = [None] * len(points)

    def follow(self, chain: list[int]) -> None:
        """Track one chain in its order."""
        done: list[int] = []
        for index in chain:
            match = self._best(index, self._nearest(index, done), still=not done)
            self.matches[index] = match
            if match is not None and match.good:
                done.append(index)

    def grow(self) -> None:
        """Track what hardly moved, then always the marker nearest to a tracked one."""
        waiting = set(range(len(self.points)))
        done: list[int] = []
        for index in sorted(waiting):
            match = self._best(index, [], still=True)
            self.matches[index] = match
            if match is not None and match.good:
                done.append(index)
        waiting -= set(done)
        tried: set[tuple[int, ...]] = set()
        while waiting and done:
            open_ = np.array(sorted(waiting))
            apart = np.linalg.norm(self.points[open_][:, None] - self.points[done], axis=2)
            progress = False
            for index in open_[np.argsort(apart.min(axis=1), kind="stable")]:
                sources = self._nearest(int(index), done)
                key = (int(index), *sources)
                if key in tried:
                    continue
                tried.add(key)
                match = self._best(int(index), sources, still=False)
                if match is not None and match.good:
                    self.matches[index] = match
                    waiting.remove(int(index))
                    done.append(int(index))
                    progress = True
                    break
            if not progress:
                return

    def result(self, subset: int) -> TrackResult:
        """Gather the matches; markers never tried are ``NO_GUESS``."""
        count = len(self.points)
        coefficients = np.full((count, 2, 6), np.nan)
        zncc, sigma, backward = (np.full(count, np.nan) for _ in range(3))
        iterations = np.zeros(count, dtype=np.int32)
        status = np.full(count, Status.NO_GUESS, dtype=np.int8)
        source = np.full(count, -1, dtype=np.int64)
        for i, match in enumerate(self.matches):
            if match is None:
                continue
            found = match.found
            coefficients[i], zncc[i], sigma[i] = (
                found.coefficients[0],
                found.zncc[0],
                found.sigma[0],
            )
            iterations[i], status[i] = found.iterations[0], found.status[0]
            backward[i], source[i] = match.backward, match.source
        shared = self._shared(coefficients[:, :, 0])
        status[shared] = Status.AMBIGUOUS
        coefficients[shared] = np.nan
        sigma[shared] = np.nan
        raw = Correlation(coefficients, zncc, sigma, iterations, status)
        return TrackResult(
            **vars(make_result(self.points, raw, subset, self.blur_px)),
            backward=backward,
            source=source,
        )

    def _shared(self, displacement: FloatArray) -> npt.NDArray[np.bool_]:
        """Markers that ended where another one ended though they began further apart.

        Tracking back can't tell perfect look-alikes, but two of them can't be in one place.
        """
        subset = 2 * self.settings.half + 1
        after = self.points + displacement
        apart = np.linalg.norm(self.points[:, None] - self.points, axis=2)
        ends = np.linalg.norm(after[:, None] - after, axis=2)
        together = (ends < 0.5 * subset) & (apart > ends + 0.5 * subset)
        return np.asarray(together.any(axis=1))

    def _nearest(self, index: int, done: list[int]) -> list[int]:
        """Tracked markers nearest to ``index``, nearest first."""
        apart = [float(np.linalg.norm(self.points[i] - self.points[index])) for i in done]
        return [done[i] for i in np.argsort(apart, kind="stable")[:SOURCES]]

    def _best(self, index: int, sources: list[int], *, still: bool) -> _Match | None:
        """The best match of one marker over its predictions."""
        best: _Match | None = None
        for source, start in self._predictions(index, sources, still=still):
            match = self._match(index, start, source)
            if best is None or (match.good, match.zncc) > (best.good, best.zncc):
                best = match
            if best.good and best.zncc >= SURE:
                break
        return best

    def _predictions(
        self, index: int, sources: list[int], *, still: bool
    ) -> list[tuple[int, FloatArray]]:
        """Start coefficients (1, 2, 6): from each source, and along the two nearest ones."""
        half = self.settings.half
        starts: list[tuple[int, FloatArray]] = []
        if still:
            starts.append((-1, np.zeros((1, 2, 6))))
        for source in sources:
            match = self.matches[source]
            assert match is not None
            c = match.found.coefficients.copy()
            offset = (self.points[index] - self.points[source]) / half
            c[0, :, 0] += c[0, :, 1:3] @ offset
            c[:, :, 3:] = 0.0
            starts.append((source, c))
        return starts

    def _match(self, index: int, start: FloatArray, source: int) -> _Match:
        """Search near the prediction, correlate, and track back."""
        point = self.points[index : index + 1]
        reach = self.settings.half + 2.0
        reference = self._spline(self.reference, point[0], reach)
        begin = start.copy()
        begin[0, :, 0] = self._search(reference, point[0], start[0])
        target = point[0] + begin[0, :, 0]
        deformed = self._spline(self.deformed, target, 1.5 * reach + self.settings.max_move)
        found = correlate(
            Subsets(Pair(reference, deformed, self.mask), point, begin), self.settings, self.device
        )
        if found.status[0] != Status.OK:
            return _Match(found, float("nan"), source)
        return self._check_back(found, point, source)

    def _search(self, reference: SplineImage, point: FloatArray, c: FloatArray) -> FloatArray:
        """Displacement near the prediction ``c`` (2, 6) where the turned template fits best."""
        half = self.settings.half
        offset = np.arange(-half, half + 1, dtype=np.float64)
        a, b = np.meshgrid(offset, offset)
        linear = np.eye(2) + c[:, 1:3] / half
        if not abs(np.linalg.det(linear)) > 0.1:
            return c[:, 0]
        target = np.rint(point + c[:, 0])
        inverse = np.linalg.inv(linear)
        # the template's centre pixel shows the point moved by ``lag``
        lag = target - (point + c[:, 0])
        x = point[0] + inverse[0, 0] * (a + lag[0]) + inverse[0, 1] * (b + lag[1])
        y = point[1] + inverse[1, 0] * (a + lag[0]) + inverse[1, 1] * (b + lag[1])
        x0, y0, x1, y1 = reference.valid
        template = reference.values(np.clip(x, x0, x1), np.clip(y, y0, y1))
        column, row, score = search_template(
            template, self.deformed, (int(target[0]), int(target[1])), self.search_px
        )
        if score < 0:
            return c[:, 0]
        found: FloatArray = c[:, 0] + np.array([column, row], dtype=np.float64) - target
        return found

    def _check_back(self, found: Correlation, point: FloatArray, source: int) -> _Match:
        """Track from the deformed image to the reference and compare with the start."""
        half = self.settings.half
        displacement = found.coefficients[:, :, 0]
        linear = np.eye(2) + found.coefficients[0, :, 1:3] / half
        start = np.zeros((1, 2, 6))
        start[:, :, 0] = -displacement
        inverse = np.linalg.inv(linear)
        start[0, :, 1:3] = (inverse - np.eye(2)) * half
        there = point + displacement
        reach = self.settings.half + 2.0
        back = correlate(
            Subsets(
                Pair(
                    self._spline(self.deformed, there[0], reach),
                    self._spline(self.reference, point[0], 1.5 * reach + self.settings.max_move),
                    self._turned_mask(point[0], there[0], inverse),
                ),
                there,
                start,
            ),
            self.settings,
            self.device,
        )
        missed = float(np.linalg.norm(there + back.coefficients[:, :, 0] - point))
        if missed <= self.backward_px:
            return _Match(found, missed, source)
        rejected = Correlation(
            np.full_like(found.coefficients, np.nan),
            found.zncc,
            np.full_like(found.sigma, np.nan),
            found.iterations,
            np.full_like(found.status, Status.BACKWARD),
        )
        return _Match(rejected, missed, source)

    def _turned_mask(
        self, point: FloatArray, there: FloatArray, inverse: npt.NDArray[Any]
    ) -> npt.NDArray[np.bool_] | None:
        """The reference mask as it lies over the subset in the deformed image."""
        if self.mask is None:
            return None
        half = self.settings.half + 1
        height, width = self.deformed.shape
        x, y = round(float(there[0])), round(float(there[1]))
        columns = np.arange(max(x - half, 0), min(x + half + 1, width))
        rows = np.arange(max(y - half, 0), min(y + half + 1, height))
        dx, dy = columns[None, :] - there[0], rows[:, None] - there[1]
        source_x = np.rint(point[0] + inverse[0, 0] * dx + inverse[0, 1] * dy).astype(np.int64)
        source_y = np.rint(point[1] + inverse[1, 0] * dx + inverse[1, 1] * dy).astype(np.int64)
        inside = (source_x >= 0) & (source_x < self.mask.shape[1])
        inside &= (source_y >= 0) & (source_y < self.mask.shape[0])
        result = np.zeros((height, width), dtype=np.bool_)
        result[np.ix_(rows, columns)] = (
            inside & (self.mask[np.where(inside, source_y, 0), np.where(inside, source_x, 0)])
        )
        return result

    def _spline(self, image: Image, centre: FloatArray, reach: float) -> SplineImage:
        x, y = float(centre[0]), float(centre[1])
        box = (x - reach, y - reach, x + reach, y + reach)
        return SplineImage.from_image(image, box, blur_px=self.blur_px)
