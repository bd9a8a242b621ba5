"""Points in progress: from those that are measured to their neighbours.

Every open point starts from the best correlated of its measured neighbours, extrapolated with that
neighbour's shape (reliability-guided, Pan 2009, a whole front at a time). A point that fails is
tried again from another neighbour as the front passes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from math import ceil

import numpy as np
import scipy

from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.arrays.unique import distinct
from gpusim.gpu import Device
from gpusim.measure.correlation.icgn import correlate
from gpusim.measure.correlation.image_pair import Pair, Subsets
from gpusim.measure.correlation.matching import Correlation, Settings, Status
from gpusim.measure.correlation.pixel_mask import box_means, without_pixels
from gpusim.measure.correlation.plain_subsets import neighbour_differences, plain_subsets
from gpusim.measure.correlation.start_values import Motion, integer_search
from gpusim.measure.correlation.subset_consistency import one_sided_texture, usual_spread
from gpusim.measure.images import Image, SplineImage
from gpusim.parallel.machine import processors
from gpusim.parallel.threads import shared

NEIGHBOURS = 9
SEED_EVERY = 8  # one seed per 8x8 points
SURE_ZNCC = 0.95  # correlation that needs no neighbour to be believed
ATTEMPTS = 4  # starts per point
# shapes that follow a smooth field: what they leave is news
FLEXIBLE_SHAPES = ("affine", "quadratic")
# px: tolerances where the one asked for isn't reached
RELAXED_TOLERANCES = (1e-3, 2e-3, 4e-3, 8e-3, 1.6e-2)
MIN_SIGMA_RATIO = 10.0  # standard uncertainty over the tolerance that then is enough
UNMATCHED = (Status.NO_GUESS, Status.NOT_CONVERGED, Status.LOW_CORRELATION)
USUAL = 64  # measured points that tell how well points with texture all around are known
RECHECK_PX = 0.5  # px: further from what its neighbours say, a point is looked at again


def seeds(points: Float, spacing: float) -> Long:
    """One point per cell of 8x8 points, the one nearest to the cell's centre.

    ``spacing`` is the usual distance of neighbours, px.
    """
    if len(points) < 4:
        return np.arange(len(points))
    size = SEED_EVERY * max(spacing, 1.0)
    cell = np.floor((points - points.min(axis=0)) / size)
    offset = np.hypot(*((points - points.min(axis=0)) / size - cell - 0.5).T)
    order = np.lexsort([offset, cell[:, 0], cell[:, 1]])
    is_first = np.any(np.diff(cell[order], axis=0, prepend=-1.0) != 0.0, axis=1)
    return np.sort(order[is_first])


@dataclass(eq=False)
class Front:
    """What has been tried, and the best outcome of each point so far.

    ``images``: the reference and the deformed one; ``mask`` is of the reference. ``near`` is how
    far from its point a subset is expected to start, px: only that much of the deformed image is
    filtered at first.
    """

    images: tuple[Image, Image]
    points: Float
    settings: Settings
    mask: Bool | None
    blur_px: float
    near: float
    device: Device | None

    def __post_init__(self) -> None:
        inner = self.settings.half + 1.0
        # as far as a subset may go from a start within ``near`` before it counts as diverged
        outer = self.near + self.settings.max_move + 1.5 * inner
        boxes = [_around(self.points, reach) for reach in (inner, outer)]
        reference, deformed = shared(
            lambda part: SplineImage.from_image(*part, blur_px=self.blur_px),
            list(zip(self.images, boxes, strict=True)),
        )
        self.pair = Pair(reference, deformed, self.mask)
        count = len(self.points)
        self.matches = Correlation.unmatched(count)
        self.attempts = np.zeros(count, dtype=np.int64)
        self.source = np.full(count, -1, dtype=np.int64)
        half = self.settings.half
        self.closed = without_pixels(self.points, self.images[0].shape, half, self.mask)
        self.matches.status[self.closed] = Status.OUTSIDE

    @property
    def ok(self) -> Bool:
        """(M,) bool: the points measured so far."""
        return self.matches.ok

    @property
    def measurable(self) -> Bool:
        """(M,) bool: the points of which nothing says yet that they can't be measured."""
        return np.asarray((self.matches.status != Status.NO_TEXTURE) & ~self.closed)

    @property
    def _open(self) -> Bool:
        """(M,) bool: the points that could be measured and haven't been so far."""
        return np.asarray(~self.ok & self.measurable)

    def search(self, which: Long, search_px: int, shift: Float) -> None:
        """Start ``which`` from an integer search around the displacement ``shift`` (2,)."""
        points = self.points[which]
        start, score = integer_search(
            *self.images, points, np.tile(shift, (which.size, 1)), self.settings.half, search_px
        )
        matched = score > 0.5 * self.settings.min_zncc
        self.attempt(which[matched], start[matched])
        # without a place to start from, let the kernel say why: outside, or no texture
        self.attempt(which[~matched], start[~matched], keep=False)

    def search_seeds(self, which: Long, search_px: int) -> None:
        """Search ``which`` around no displacement, first those that show more than noise may: they
        tell how strong that is."""
        white = plain_subsets(tuple(self._differences[:, which]))
        for part in (which[~white], which[white]):
            self.search(part[self.measurable[part]], search_px, np.zeros(2))
            self.give_up_plain()

    @cached_property
    def _differences(self) -> Float:
        """(2, M): `neighbour_differences`, NaN where nothing is measured."""
        found, inside = np.full((2, len(self.points)), np.nan), ~self.closed
        places = self.points[inside], self.settings.half
        found[:, inside] = neighbour_differences(self.images[0], *places)
        return found

    def give_up_plain(self) -> None:
        """Count as without texture all points that show nothing but noise, no stronger than what
        was left where others were matched."""
        ok, half = self.ok, self.settings.half
        which = np.flatnonzero(np.isin(self.matches.status, UNMATCHED))
        if not (ok.any() and which.size):
            return
        if self.mask is not None:
            x, y = np.rint(self.points[which]).astype(np.int64).T
            which = which[box_means(self.mask.astype(np.uint8), x, y, half) == 1.0]
        # what is left is noise of both images; a blur has taken most of it
        left = np.quantile(self.matches.residual[ok], 0.9) * max(1.0, 4.0 * np.pi * self.blur_px**2)
        noise = 0.5 * left / max(self.pair.reference_range[1], 1e-300) ** 2
        plain = plain_subsets(tuple(self._differences[:, which]), float(noise))
        self.matches.refuse(which[plain], Status.NO_TEXTURE)
        self._give_up_beside(which[plain])

    def _give_up_beside(self, lost: Long) -> None:
        """Count as without texture what sees a body from its background: points beside ``lost``
        ones with their texture to one side. They hardly converge and are given up in the end."""
        if not (lost.size and self._looks_at_parts and len(self.points) >= NEIGHBOURS):
            return
        usual, untold = self._usual(), self._open
        while lost.size:
            near = distinct(self._neighbours[lost])
            near = near[untold[near]]
            untold[near] = False
            lost = near[self._one_sided(near, usual)[0]]
            self.matches.refuse(lost, Status.NO_TEXTURE)

    def start_from_features(self, which: Long, motions: list[Motion]) -> None:
        """Start ``which`` from the motions that features show, the nearest match first."""
        if not (motions and which.size):
            return
        self.take_whole_image()
        points = self.points[which]
        starts = [motion.at(points) for motion in motions]
        order = np.argsort([distance for _, distance in starts], axis=0)
        for rank in range(len(motions)):
            open_ = np.flatnonzero(self._open[which])
            for number, motion in enumerate(motions):
                part = open_[order[rank, open_] == number]
                gradient = np.broadcast_to(motion.matrix * self.settings.half, (part.size, 2, 2))
                self.attempt(which[part], starts[number][0][part], gradient)

    def attempt(
        self,
        which: Long,
        displacement: Float,
        gradient: Float | None = None,
        *,
        keep: bool = True,
        tolerance: float | None = None,
    ) -> None:
        """Correlate ``which`` from start values; ``keep`` = accept a match.

        ``gradient`` are the linear coefficients of the warp, (K, 2, 2), px. A measured point
        changes only for a better match. With a ``tolerance`` of its own, only matches count whose
        standard uncertainty is ten times that.
        """
        if which.size == 0:
            return
        start = np.zeros((which.size, 2, 6))
        start[:, :, 0] = displacement
        if gradient is not None and self.settings.shape != "translation":
            start[:, :, 1:3] = gradient
        settings = self.settings if keep else replace(self.settings, max_iterations=1)
        if tolerance is not None:
            settings = replace(settings, tolerance=tolerance)
        result = correlate(Subsets(self.pair, self.points[which], start), settings, self.device)
        if tolerance is not None:
            early = result.ok & ~(result.sigma >= MIN_SIGMA_RATIO * tolerance)
            result.refuse(early, Status.NOT_CONVERGED)
        self.attempts[which] += 1
        if keep:
            better = result.ok & (result.zncc > self.matches.zncc[which])
            chosen = ~self.ok[which] | better
        else:
            chosen = np.isin(result.status, (Status.OUTSIDE, Status.NO_TEXTURE)) & ~self.ok[which]
        self.matches.put(which[chosen], result, chosen)

    def retry_with_tolerances(self) -> None:
        """Measure what noise keeps from converging as far as its own uncertainty makes sense.

        Where noise outweighs the pattern's slopes, steps shrink slowly and may not come below the
        tolerance; a tenth of the standard uncertainty is as good a place to stop.
        """
        for tolerance in RELAXED_TOLERANCES:
            near = self.matches.zncc >= self.settings.min_zncc
            which = np.flatnonzero((self.matches.status == Status.NOT_CONVERGED) & near)
            if len(self.points) < 2 or which.size == 0 or tolerance <= self.settings.tolerance:
                continue
            source, near = self._best_neighbours(which)
            # what is measured beside it must be nearly as uncertain
            near &= self.matches.sigma[source] >= 0.5 * MIN_SIGMA_RATIO * tolerance
            start = self._extrapolated(which[near], source[near])
            self.attempt(which[near], *start, tolerance=tolerance)

    def propagate(self) -> None:
        """Let the measured points hand their motion on until nothing new can be started."""
        if len(self.points) < 2:
            return
        while True:
            which = np.flatnonzero(self._open & (self.attempts < ATTEMPTS))
            source, near = self._best_neighbours(which)
            usable = near & (source != self.source[which])
            if not usable.any():
                return
            which, source = which[usable], source[usable]
            self.source[which] = source
            self.attempt(which, *self._extrapolated(which, source))

    def recheck_outliers(self) -> None:
        """Look again at points that their neighbours would have put elsewhere.

        A pattern that resembles itself can match in a wrong place. The start that the neighbours
        give wins if it leads to a better correlation. A mediocre match none of whose neighbours
        was found is chance, and counts as ``LOW_CORRELATION``.
        """
        if len(self.points) < NEIGHBOURS:
            return
        neighbour = self._neighbours
        lonely = self.ok & ~self.ok[neighbour].any(axis=1) & ~(self.matches.zncc >= SURE_ZNCC)
        self.matches.refuse(np.flatnonzero(lonely), Status.LOW_CORRELATION)
        ok = self.ok
        displacements = self.matches.coefficients[:, :, 0]
        which = np.flatnonzero(ok & (ok[neighbour].sum(axis=1) >= NEIGHBOURS // 2))
        extrapolated, _ = self._by_neighbours(which)
        # a median is away from a point only if a neighbour is
        away = np.abs(extrapolated - displacements[which].T[:, None]) > RECHECK_PX
        odd = away.any(axis=(0, 1))
        which, extrapolated = which[odd], extrapolated[:, :, odd]
        if which.size == 0:
            return
        middle = np.nanmedian(extrapolated, axis=1).T
        odd = np.abs(middle - displacements[which]).max(axis=1) > RECHECK_PX
        self.attempt(which[odd], middle[odd])

    @property
    def _looks_at_parts(self) -> bool:
        settings = self.settings
        return bool(np.isfinite(settings.apart_px)) and settings.shape in FLEXIBLE_SHAPES

    def _usual(self) -> float:
        """`usual_spread` of what is measured."""
        known = np.flatnonzero(self.ok)
        known = known[:: ceil(known.size / USUAL)]
        return usual_spread(self.pair, self.points[known], self._noise[known], self.settings)

    def _one_sided(self, which: Long, usual: float) -> tuple[Bool, Bool]:
        noise = self._noise[which]
        return one_sided_texture(self.pair, self.points[which], noise, self.settings, usual)

    @property
    def _noise(self) -> Float:
        """(M,) variance of the noise of one image: a match leaves that of both."""
        noise = self.matches.residual / (1.0 + self.matches.zncc)
        return np.where(self.ok, noise, np.median(noise[self.ok]) if self.ok.any() else 0.0)

    @cached_property
    def _nearest(self) -> tuple[Float, Long]:
        """Distances, px, and which, (M, 8): the points nearest to each, nearest first."""
        number = np.arange(2, min(NEIGHBOURS, len(self.points)) + 1)
        tree = scipy.spatial.cKDTree(self.points)
        away, which = tree.query(self.points, k=number, workers=processors())
        return np.asarray(away, dtype=np.float64), np.asarray(which, dtype=np.int64)

    @property
    def _neighbours(self) -> Long:
        return self._nearest[1]

    @property
    def spacing(self) -> float:
        """Median distance of the points from their nearest neighbours, px; 0 of one point."""
        return self.spacing_of(slice(None))

    def spacing_of(self, which: Long | slice) -> float:
        """The same of some of the points."""
        return float(np.median(self._nearest[0][which, 0])) if len(self.points) > 1 else 0.0

    def _best_neighbours(self, which: Long) -> tuple[Long, Bool]:
        """The best correlated of the measured neighbours of points (K,); whether there is one."""
        neighbour = self._neighbours[which]
        score = np.where(self.ok[neighbour], self.matches.zncc[neighbour], -1.0)
        source = neighbour[np.arange(which.size), np.argmax(score, axis=1)]
        return source, np.asarray(score.max(axis=1) > 0)

    @property
    def _linear_warps(self) -> Float:
        """(2, 3, M) displacement and its slopes of all points."""
        return np.ascontiguousarray(self.matches.coefficients[:, :, :3].transpose(1, 2, 0))

    def _by_neighbours(self, which: Long) -> tuple[Float, Float]:
        """Displacements (2, N, K) of points as each of their neighbours says; its slopes by a, b
        (2, 2, N, K)."""
        source = np.ascontiguousarray(self._neighbours[which].T)
        points = np.ascontiguousarray(self.points.T)
        offset = (points[:, None, which] - points.take(source, axis=1)) / self.settings.half
        # take, not an index, which would lay them out point by point
        warp = self._linear_warps.take(source, axis=2)
        moved = warp[:, 0] + (warp[:, 1] * offset[0] + warp[:, 2] * offset[1])
        return np.asarray(moved), np.asarray(warp[:, 1:])

    def _extrapolated(self, which: Long, source: Long) -> tuple[Float, Float]:
        """Displacements and slopes of points as their sources' warps continue to them.

        Second derivatives are left out: they are noisier than what they would add.
        """
        offset = (self.points[which] - self.points[source]) / self.settings.half
        warp = self.matches.coefficients[source]
        linear = warp[:, :, 1:3]
        return warp[:, :, 0] + np.einsum("mij,mj->mi", linear, offset), linear

    def extend_deformed(self) -> bool:
        """Take in the whole deformed image if a point has left the part around the start."""
        outside = (self.matches.status == Status.OUTSIDE) & ~self.closed
        if not (outside.any() and self.ok.any()) or not self.take_whole_image():
            return False
        self.attempts[outside] = 0
        self.source[outside] = -1
        return True

    def take_whole_image(self) -> bool:
        """Filter all of the deformed image; False if that has been done."""
        height, width = self.images[1].shape
        if self.pair.deformed.valid == (0.0, 0.0, width - 1.0, height - 1.0):
            return False
        whole = SplineImage.from_image(self.images[1], blur_px=self.blur_px)
        self.pair = Pair(self.pair.reference, whole, self.pair.mask)
        return True


def _around(points: Float, margin: float) -> tuple[float, float, float, float]:
    low, high = points.min(axis=0) - margin, points.max(axis=0) + margin
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])
