"""Digital image correlation of two images on a grid of points or at given ones.

Start values: a coarse lattice of seeds is found by an integer search; every other point starts
from the best correlated of its measured neighbours, extrapolated with that neighbour's gradient.
A failed point is tried again from another neighbour as the front passes.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from gpusim.errors import InputError
from gpusim.gpu import Device
from gpusim.measure.icgn import correlate
from gpusim.measure.images import FloatArray, Image, check_image, check_points
from gpusim.measure.interpolation import SplineImage
from gpusim.measure.matching import Correlation, Pair, Settings, Status, Subsets
from gpusim.measure.search import integer_search
from gpusim.measure.subsets import (
    DicResult,
    Window,
    check_mask,
    make_result,
    make_settings,
)
from gpusim.measure.warp import Shape

__all__ = ["dic", "grid_points"]

NEIGHBOURS = 9
SEED_EVERY = 8  # one seed per 8x8 points
ATTEMPTS = 4  # starts per point


def dic(
    reference: npt.NDArray[Any],
    deformed: npt.NDArray[Any],
    *,
    subset: int = 31,
    step: int = 10,
    roi: tuple[int, int, int, int] | None = None,
    points: npt.ArrayLike | None = None,
    guess: npt.ArrayLike | None = None,
    search_px: int = 20,
    shape: Shape = "affine",
    window: Window | npt.ArrayLike = "square",
    mask: npt.NDArray[np.bool_] | None = None,
    blur_px: float = 0.0,
    tolerance: float = 1e-4,
    max_iterations: int = 40,
    min_zncc: float = 0.8,
    device: Device | None = None,
) -> DicResult:
    """Measure how ``reference`` moved to become ``deformed``.

    Parameters
    ----------
    reference, deformed : (H, W) grey images of any integer or float type; sizes may differ.
    subset : odd width of the square subsets, px.
    step : distance of the grid points, px (without ``points``).
    roi : (x0, y0, x1, y1), pixels included; the grid's subsets stay inside. Default: all.
    points : (M, 2) positions x, y in the reference, any fraction of a pixel, instead of a grid.
    guess : (2,) or (M, 2) displacement to start from, px; without it, an integer search of
        +-``search_px`` at the seeds.
    shape : how a subset deforms: "translation", "rigid", "affine" or "quadratic".
    window : weights of the subset's pixels: "square", "round" or (subset, subset) in 0..1.
    mask : (H, W) bool, False = pixel of the reference that isn't used; its neighbours within
        1 px + 2 ``blur_px`` aren't either.
    blur_px : standard deviation of a Gaussian put over both images first; 1 px takes most of the
        interpolation error off images with hard edges, for a little resolution.
    tolerance : the iteration stops when no pixel of the subset has further to go than this, px,
        as the shrinking of the last two steps tells.
    min_zncc : matches below are reported as ``LOW_CORRELATION``.
    device : where to iterate; None runs the NumPy twin in float64.

    Raises
    ------
    InputError
        An argument is wrong. A point that can't be measured is no error: see ``status``.
    """
    first = check_image(reference, "reference")
    second = check_image(deformed, "deformed")
    settings = make_settings(
        subset,
        window,
        shape=shape,
        tolerance=tolerance,
        max_iterations=max_iterations,
        min_zncc=min_zncc,
        max_move=float(subset),
    )
    allowed = check_mask(mask, first, blur_px)
    if not isinstance(search_px, (int, np.integer)) or search_px < 1:
        raise InputError(f"search_px: got {search_px!r}; expected a whole number of px >= 1")
    if points is None:
        positions = grid_points(first.shape, subset=subset, step=step, roi=roi)
    else:
        positions = check_points(points, "points")
    values = np.zeros(2)
    if guess is not None:
        values = np.asarray(guess, dtype=np.float64)
        if values.shape not in ((2,), positions.shape) or not np.isfinite(values).all():
            raise InputError(
                f"guess: got shape {values.shape}; expected finite (2,) or {positions.shape}"
            )
    near = float(np.abs(values).max()) if guess is not None else float(search_px)
    run = _Run(first, second, positions, settings, allowed, blur_px, near, device)
    if guess is not None:
        run.attempt(np.arange(len(positions)), np.broadcast_to(values, positions.shape))
    else:
        run.search(seeds(positions), int(search_px))
    run.propagate()
    if run.widen():
        run.propagate()
    if guess is None:
        lonely = np.flatnonzero((run.status == Status.NO_GUESS) | (run.attempts == 0))
        if lonely.size:
            run.search(lonely, int(search_px))
            run.propagate()
    return make_result(positions, run.matches(), subset, blur_px)


def grid_points(
    image_shape: tuple[int, ...],
    *,
    subset: int,
    step: int,
    roi: tuple[int, int, int, int] | None = None,
) -> FloatArray:
    """Grid positions (M, 2), row by row, whose subsets lie in the region of interest."""
    if not isinstance(step, (int, np.integer)) or step < 1:
        raise InputError(f"step: got {step!r}; expected a whole number of px >= 1")
    height, width = image_shape
    x0, y0, x1, y1 = (0, 0, width - 1, height - 1) if roi is None else roi
    if not (0 <= x0 <= x1 < width and 0 <= y0 <= y1 < height):
        raise InputError(
            f"roi: got {roi}; expected (x0, y0, x1, y1) inside the image of {width}x{height} px"
        )
    half = subset // 2
    columns = np.arange(x0 + half, x1 - half + 1, step, dtype=np.float64)
    rows = np.arange(y0 + half, y1 - half + 1, step, dtype=np.float64)
    if columns.size == 0 or rows.size == 0:
        raise InputError(
            f"roi: holds no subset; got {x1 - x0 + 1}x{y1 - y0 + 1} px; expected at least "
            f"{subset}x{subset}"
        )
    x, y = np.meshgrid(columns, rows)
    return np.column_stack([x.ravel(), y.ravel()])


def seeds(points: FloatArray) -> npt.NDArray[np.int64]:
    """One point per cell of 8x8 points, the one nearest to the cell's centre."""
    if len(points) < 4:
        return np.arange(len(points))
    apart = np.asarray(cKDTree(points).query(points, k=2)[0], dtype=np.float64)
    spacing = float(np.median(apart[:, 1]))
    size = SEED_EVERY * max(spacing, 1.0)
    cell = np.floor((points - points.min(axis=0)) / size)
    offset = np.hypot(*((points - points.min(axis=0)) / size - cell - 0.5).T)
    order = np.lexsort([offset, cell[:, 0], cell[:, 1]])
    _, first = np.unique(cell[order], axis=0, return_index=True)
    return np.sort(order[first])


class _Run:
    """Points in progress: what has been tried, and the best outcome so far."""

    def __init__(
        self,
        reference: Image,
        deformed: Image,
        points: FloatArray,
        settings: Settings,
        mask: npt.NDArray[np.bool_] | None,
        blur_px: float,
        near: float,
        device: Device | None,
    ) -> None:
        self.images = reference, deformed
        self.points = points
        self.settings = settings
        self.blur_px = blur_px
        self.device = device
        inner = settings.half + 1.0
        # as far as a subset may go from a start within ``near`` before it counts as diverged
        outer = near + settings.max_move + 1.5 * inner
        self.pair = Pair(
            SplineImage.from_image(reference, _around(points, inner), blur_px=blur_px),
            SplineImage.from_image(deformed, _around(points, outer), blur_px=blur_px),
            mask,
        )
        count = len(points)
        self.coefficients = np.full((count, 2, 6), np.nan)
        self.zncc = np.full(count, np.nan)
        self.sigma = np.full(count, np.nan)
        self.iterations = np.zeros(count, dtype=np.int32)
        self.status = np.full(count, Status.NO_GUESS, dtype=np.int8)
        self.attempts = np.zeros(count, dtype=np.int64)
        self.source = np.full(count, -1, dtype=np.int64)

    def search(self, which: npt.NDArray[np.int64], search_px: int) -> None:
        """Start ``which`` from an integer search around no displacement."""
        points = self.points[which]
        start, score = integer_search(
            *self.images, points, np.zeros_like(points), self.settings.half, search_px
        )
        found = score > 0.5 * self.settings.min_zncc
        self.attempt(which[found], start[found])
        # without a place to start from, let the kernel say why: outside, or no texture
        self.attempt(which[~found], start[~found], keep=False)

    def attempt(
        self,
        which: npt.NDArray[np.int64],
        displacement: FloatArray,
        gradient: FloatArray | None = None,
        *,
        keep: bool = True,
    ) -> None:
        """Correlate ``which`` from start values; ``keep`` = accept a match."""
        if which.size == 0:
            return
        start = np.zeros((which.size, 2, 6))
        start[:, :, 0] = displacement
        if gradient is not None and self.settings.shape != "translation":
            start[:, :, 1:3] = gradient
        result = correlate(
            Subsets(self.pair, self.points[which], start),
            self.settings if keep else replace(self.settings, max_iterations=1),
            self.device,
        )
        self.attempts[which] += 1
        if keep:
            chosen = np.ones(which.size, dtype=bool)
        else:
            chosen = np.isin(result.status, (Status.OUTSIDE, Status.NO_TEXTURE))
        target = which[chosen]
        self.coefficients[target] = result.coefficients[chosen]
        self.zncc[target] = result.zncc[chosen]
        self.sigma[target] = result.sigma[chosen]
        self.iterations[target] = result.iterations[chosen]
        self.status[target] = result.status[chosen]

    def propagate(self) -> None:
        """Let the measured points hand their motion on until nothing new can be started."""
        count = len(self.points)
        if count < 2:
            return
        number = min(NEIGHBOURS, count)
        nearest = np.asarray(cKDTree(self.points).query(self.points, k=number)[1], dtype=np.int64)
        neighbour = nearest[:, 1:]
        while True:
            ok = self.status == Status.OK
            open_points = ~ok & (self.status != Status.NO_TEXTURE) & (self.attempts < ATTEMPTS)
            score = np.where(ok[neighbour], self.zncc[neighbour], -1.0)
            column = np.argmax(score, axis=1)
            source = neighbour[np.arange(count), column]
            usable = open_points & (score.max(axis=1) > 0) & (source != self.source)
            which = np.flatnonzero(usable)
            if which.size == 0:
                return
            self.source[which] = source[which]
            origin = self.coefficients[source[which]]
            offset = (self.points[which] - self.points[source[which]]) / self.settings.half
            linear = origin[:, :, 1:3]
            displacement = origin[:, :, 0] + np.einsum("mij,mj->mi", linear, offset)
            self.attempt(which, displacement, linear)

    def widen(self) -> bool:
        """Take in the whole deformed image if a point has left the part around the start."""
        height, width = self.images[1].shape
        if self.pair.deformed.valid == (0.0, 0.0, width - 1.0, height - 1.0):
            return False
        left = self.status == Status.OUTSIDE
        if not (left.any() and (self.status == Status.OK).any()):
            return False
        whole = SplineImage.from_image(self.images[1], blur_px=self.blur_px)
        self.pair = Pair(self.pair.reference, whole, self.pair.mask)
        self.attempts[left] = 0
        self.source[left] = -1
        return True

    def matches(self) -> Correlation:
        """The outcome so far."""
        return Correlation(self.coefficients, self.zncc, self.sigma, self.iterations, self.status)


def _around(points: FloatArray, margin: float) -> tuple[float, float, float, float]:
    low, high = points.min(axis=0) - margin, points.max(axis=0) + margin
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])
