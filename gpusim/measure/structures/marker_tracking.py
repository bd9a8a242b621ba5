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

from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.field_summary import field_summary
from gpusim.measure.correlation.matching import (
    DicResult,
    Status,
    Window,
    make_result,
    make_settings,
    noise_factor,
)
from gpusim.measure.correlation.pixel_mask import check_mask
from gpusim.measure.correlation.warp import Shape
from gpusim.measure.images import check_image, check_points
from gpusim.measure.structures.marker_matching import Matcher, Matches
from gpusim.parallel.blas_threads import one_blas_thread
from gpusim.validation import count_of, require, unmasked

MAX_SOURCES = 3  # tracked markers from which each one is predicted
CHORD_MARKERS = 4  # markers back along a chain, whose chord tells how the member has turned
SAME_START = 0.3  # px between starts, over the subset
SURE_ZNCC = 0.95  # correlation from which no further prediction is tried


@dataclass(frozen=True)
class TrackResult(DicResult):
    """A ``DicResult`` with how each marker was found.

    backward : (M,) float64, distance by which tracking back missed the marker, px.
    source : (M,) int64, the marker from which it was predicted; -1: from no displacement.

    Examples
    --------
    >>> before, after = (gs.export.read_image(f"markers{end}.png") for end in ("", "-1"))
    >>> result = gs.measure.track(before, after, [[39.5, 59.5], [119.5, 59.5]], subset=19)
    >>> result.status, bool(result.backward.max() < 0.05)
    (array([0, 0], dtype=int8), True)
    """

    backward: Float
    source: Long
    __repr__ = field_summary


@unmasked("reference", "deformed")
@one_blas_thread()
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
    mask: Bool | None = None,
    blur_px: float = 1.0,
    tolerance: float = 1e-4,
    max_iterations: int = 60,
    min_zncc: float = 0.8,
    backward_px: float = 0.05,
    backend: str = "auto",
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
    shape, window, mask, tolerance, min_zncc : as for ``dic``.
    backward_px : a marker is accepted if tracking back returns within this distance.
    backend : "auto" and "numpy" are the same here: the subsets of a few dozen markers are too
        little work for a device to gain anything by it; "gpu" is refused.

    Examples
    --------
    >>> before, after = (gs.export.read_image(f"markers{end}.png") for end in ("", "-1"))
    >>> result = gs.measure.track(before, after, [[39.5, 59.5], [119.5, 59.5]], subset=19)
    >>> result.displacement.round(2) + 0.0
    array([[1.5, 0. ],
           [1.5, 0. ]])
    """
    expected = "'auto' or 'numpy': markers are matched on the host"
    require(backend in ("auto", "numpy"), "track backend", repr(backend), expected)
    first = check_image(reference, "reference")
    second = check_image(deformed, "deformed")
    positions = check_points(points, "points")
    search_px = count_of("search_px", search_px)
    require(0 < backward_px < np.inf, "backward_px", repr(backward_px), "px > 0")
    settings = make_settings(
        subset, window, shape=shape, tolerance=tolerance, max_iterations=max_iterations,
        min_zncc=min_zncc, max_move=max(3.0, subset / 4), blur_px=blur_px,
    )  # fmt: skip
    tracker = _Tracker(Matcher(
        first, second, positions, settings, check_mask(mask, first, blur_px), int(search_px),
        float(backward_px), float(blur_px),
    ))  # fmt: skip
    if groups is None:
        tracker.grow()
    else:
        tracker.follow(check_groups(groups, len(positions)))
    return tracker.result(subset)


def check_groups(groups: Sequence[Sequence[int]], count: int) -> list[list[int]]:
    """Chains must name existing points, each once."""
    chains = [[int(i) for i in chain] for chain in groups]
    named = [i for chain in chains for i in chain]
    fits = len(set(named)) == len(named) and all(0 <= i < count for i in named)
    require(fits, "groups", f"indices {sorted(named)}", f"each of 0..{count - 1} at most once")
    return chains


class _Tracker:
    """The markers in progress."""

    def __init__(self, matcher: Matcher) -> None:
        self.matcher = matcher
        self.points = matcher.points
        self.half = matcher.settings.half
        self.found = Matches.none(len(self.points))

    def follow(self, chains: Sequence[Sequence[int]]) -> None:
        """Track chains, each in its order.

        Where every marker goes is sketched to a pixel first, so that all can be correlated at
        once; one that isn't surely where its neighbour says is tracked again by itself.
        """
        order = [index for chain in chains for index in chain]
        starts, sources = np.zeros((len(order), 2, 6)), [-1] * len(order)
        first = 0
        for chain in chains:
            last = first + len(chain)
            starts[first:last] = self._predicted_chain(chain)
            sources[first + 1 : last] = chain[:-1]
            first = last
        sketched = self.matcher.match(order, starts, sources)
        row = 0
        for chain in chains:
            done: list[int] = []
            for index in chain:
                if self._is_confirmed(index, sketched, row, done):
                    self.found.put(index, sketched, row)
                else:
                    self._put_best(index, self._nearest(index, done), still=not done)
                if self.found.ok[index]:
                    done.append(index)
                row += 1

    def grow(self) -> None:
        """Track what hardly moved, then always the marker nearest to a tracked one."""
        every = list(range(len(self.points)))
        starts = np.zeros((len(every), 2, 6))
        for index in every:
            starts[index, :, 0] = self.matcher.search(index, starts[index])
        self.found = self.matcher.match(every, starts, [-1] * len(every))
        done = np.flatnonzero(self.found.ok).tolist()
        waiting = set(every) - set(done)
        tried: set[tuple[int, ...]] = set()
        while waiting and done:
            open_ = np.array(sorted(waiting))
            apart = np.linalg.norm(self.points[open_][:, None] - self.points[done], axis=2)
            progress = False
            for index in open_[np.argsort(apart.min(axis=1), kind="stable")]:
                near = self._nearest(int(index), done)
                key = (int(index), *near)
                if key in tried:
                    continue
                tried.add(key)
                if self._put_best(int(index), near, still=False, only_good=True):
                    waiting.remove(int(index))
                    done.append(int(index))
                    progress = True
                    break
            if not progress:
                return

    def result(self, subset: int) -> TrackResult:
        """Gather the matches; markers never tried are ``NO_GUESS``."""
        matches, patches = self.found, self.matcher.patches
        matches.refuse(self._coinciding(matches.coefficients[:, :, 0]), Status.AMBIGUOUS)
        stacked = self.points + patches.stack_offset(np.arange(len(self.points)))
        widening = noise_factor(patches, stacked, self.half, self.matcher.blur_px)
        result = vars(make_result(self.points, matches, subset, widening))
        return TrackResult(**result, backward=matches.backward, source=matches.source)

    def _coinciding(self, displacement: Float) -> Bool:
        """Markers that ended where another one ended though they began further apart.

        Tracking back can't tell perfect look-alikes, but two of them can't be in one place.
        """
        subset = 2 * self.half + 1
        after = self.points + displacement
        apart = np.linalg.norm(self.points[:, None] - self.points, axis=2)
        ends = np.linalg.norm(after[:, None] - after, axis=2)
        together = (ends < 0.5 * subset) & (apart > ends + 0.5 * subset)
        return np.asarray(together.any(axis=1))

    def _nearest(self, index: int, done: list[int]) -> list[int]:
        """Tracked markers nearest to ``index``, nearest first."""
        apart = [float(np.linalg.norm(self.points[i] - self.points[index])) for i in done]
        return [done[i] for i in np.argsort(apart, kind="stable")[:MAX_SOURCES]]

    def _predicted_chain(self, chain: Sequence[int]) -> Float:
        """Starts (K, 2, 6) along a chain to a pixel: each marker as its neighbours moved and
        turned."""
        starts = np.zeros((len(chain), 2, 6))
        turns = self.matcher.settings.shape != "translation"
        for k, index in enumerate(chain):
            c = starts[k]
            if k:
                turn = np.zeros((2, 2))
                if k > 1 and turns:
                    back = max(0, k - CHORD_MARKERS)
                    chord = self.points[chain[k - 1]] - self.points[chain[back]]
                    moved = chord + starts[k - 1, :, 0] - starts[back, :, 0]
                    turn = _rotation(chord, moved) - np.eye(2)
                c[:, 0] = starts[k - 1, :, 0]
                c[:, 0] += turn @ (self.points[index] - self.points[chain[k - 1]])
                c[:, 1:3] = turn * self.half
            c[:, 0] = self.matcher.search(index, c)
        return starts

    def _is_confirmed(self, index: int, sketched: Matches, row: int, done: list[int]) -> bool:
        """Whether a sketched match is what tracking by itself would find: as good that no further
        prediction is tried, and where the neighbour's own motion and turn predict it."""
        if not (sketched.ok[row] and sketched.zncc[row] >= SURE_ZNCC):
            return False
        source = int(sketched.source[row])
        if (source not in done) if done else (source != -1):
            return False
        (_, start), *_ = self._predictions(index, [source] if done else [], still=not done)
        off = np.abs(sketched.coefficients[row, :, 0] - start[:, 0]).max()
        return bool(off <= self.matcher.search_px + 1.0)

    def _put_best(
        self, index: int, sources: list[int], *, still: bool, only_good: bool = False
    ) -> bool:
        """Take the best match of one marker over its predictions, and tell whether it was found."""
        tried: list[Float] = []
        of: list[int] = []
        for source, start in self._predictions(index, sources, still=still):
            start[:, 0] = self.matcher.search(index, start)
            # the same start but for less than a pixel and a degree or so ends the same
            if any(np.abs(start[:, :3] - other[:, :3]).max() < SAME_START for other in tried):
                continue
            tried.append(start)
            of.append(source)
        if not tried:
            return False
        # one by one they would take as long each as all of them at once
        matches = self.matcher.match([index] * len(tried), np.array(tried), of)
        ranks = list(zip(matches.ok.tolist(), matches.zncc.tolist(), strict=True))
        best = 0
        for k, rank in enumerate(ranks):
            best = k if rank > ranks[best] else best
            # converged on what fits well: another start would go there too, the way back as well
            settled = matches.status[best] in (Status.OK, Status.BACKWARD)
            if settled and matches.zncc[best] >= SURE_ZNCC:
                break
        good = bool(matches.ok[best])
        if good or not only_good:
            self.found.put(index, matches, best)
        return good

    def _predictions(
        self, index: int, sources: list[int], *, still: bool
    ) -> list[tuple[int, Float]]:
        """Start coefficients (2, 6): from no displacement, or from each source."""
        starts: list[tuple[int, Float]] = []
        if still:
            starts.append((-1, np.zeros((2, 6))))
        for source in sources:
            c = self.found.coefficients[source].copy()
            offset = (self.points[index] - self.points[source]) / self.half
            c[:, 0] += c[:, 1:3] @ offset
            c[:, 3:] = 0.0
            starts.append((source, c))
        return starts


def _rotation(before: Float, after: Float) -> Float:
    """The rotation (2, 2) that turns the direction of one vector into that of another."""
    size = float(np.linalg.norm(before) * np.linalg.norm(after))
    if not size > 0:
        return np.eye(2)
    cosine = float(before @ after) / size
    sine = float(before[0] * after[1] - before[1] * after[0]) / size
    return np.array([[cosine, -sine], [sine, cosine]])
