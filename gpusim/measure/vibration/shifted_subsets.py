"""Subsets of a reference found in pictures, by a few sums over their pixels.

A subset is looked at through functionals: sums over its pixels s of weights F(s) times grey values.
Those of the moved reference, f(s - r), are known for every r beforehand: between the pixels f is a
quintic B-spline, so that they are six weights of r_x times six of r_y times a small table, which is
computed once. Of a picture only the sums over the whole pixels nearest to the subset are computed;
what is left is the fraction r of a pixel at which both agree. No iteration touches a pixel, and
pictures themselves are never interpolated. Which functionals are taken, and when they agree, is
the method (see ``displacement_methods``).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.measure.correlation.image_pair import subset_pixels
from gpusim.measure.correlation.matching import Status
from gpusim.measure.images import WEIGHTS, Image, SplineImage

SLOPES = WEIGHTS[:, 1:] * np.arange(1, WEIGHTS.shape[1])  # of the spline's six weights
TAPS = 7  # along an axis: six weights that begin at one of two pixels
FURTHEST = 0.999  # px that the table reaches; what lies beyond is looked at from the next pixel
FRACTIONS = np.array([(0, 0), (-0.5, -0.5), (-0.5, 0.5), (0.5, -0.5), (0.5, 0.5)])  # px
SETTLED = 0.75  # px from whole pixels at which a subset stays with them
ROUNDS = 8  # pixels by which a start may be off
TOLERANCE = 1e-7  # px
MIN_CONTRAST = 5e-4  # standard deviation of a subset over the grey range of the picture
MIN_LIKENESS = 0.8  # of what the reference sees of a picture over what it should


@dataclass(frozen=True)
class ReferenceSubsets:
    """P square subsets of a reference, n pixels each.

    size : their width, px.    grey : (P, n) grey values less their mean.
    slope : (P, U, n) slopes along the directions in which motions are looked for.
    directions : (U, 2) unit vectors.
    """

    size: int
    grey: Float
    slope: Float
    directions: Float


class Method(Protocol):
    """What of a subset is compared, and how.

    steps : most steps of the iteration.
    least_slope : of the difference, least over greatest of all directions; below, the subset
        shows one direction alone.
    """

    @property
    def steps(self) -> int: ...
    @property
    def least_slope(self) -> float: ...

    def functionals(self, subsets: ReferenceSubsets) -> Float:
        """(P, K, n) weights; the last row is the reference itself."""

    def difference(self, model: Float, seen: Float) -> Float:
        """(P, U) from values (P, K) of the moved reference and of a picture; 0: they agree."""

    def slope(self, model: Float, change: Float) -> Float:
        """How the difference (P, U) changes as the ``model`` does by ``change`` (P, K)."""


class ShiftedSubsets:
    """Subsets at ``points`` (P, 2) of a reference (H, W), to be found in pictures.

    status : (P,) int8, ``OK`` where the reference shows the motion.
    """

    def __init__(
        self, reference: Image, points: Float, size: int, directions: Float, method: Method
    ) -> None:
        self.method, self.directions, self.image_shape = method, directions, reference.shape
        column, row = subset_pixels(points, size // 2)
        self._corners = np.stack([column[:, [0, -1]], row[:, [0, -1]]], axis=1)
        status = np.full(len(points), Status.OK, dtype=np.int8)
        status[~self._inside(np.zeros((len(points), 2)))] = Status.OUTSIDE
        outside = status == Status.OUTSIDE
        column[outside], row[outside] = 0, 0
        self._index = row * reference.shape[1] + column
        spline = SplineImage.from_image(reference)
        grey = spline.pixels[row, column]
        grey -= grey.mean(axis=1, keepdims=True)
        slopes = [each[row, column] for each in spline.pixel_gradients()]
        slope = np.einsum("ud,dpn->pun", directions, slopes)
        subsets = ReferenceSubsets(size, grey, slope, directions)
        flat = ~(grey.std(axis=1) > MIN_CONTRAST * np.ptp(spline.pixels))
        grey[flat] = np.linspace(-1, 1, grey.shape[1])  # any; they aren't measured
        self._functionals = method.functionals(subsets)
        self._norm = np.linalg.norm(grey, axis=1)
        self._table = _moved_functionals(spline.coefficients, row, column, self._functionals)
        shown = self._shown() & ~flat
        status[~outside & ~shown] = Status.NO_TEXTURE
        self.status: npt.NDArray[np.int8] = status

    def found(self, picture: npt.NDArray[Any], start: Float) -> tuple[Float, npt.NDArray[np.int8]]:
        """Distances (P, U) along the directions in a picture, NaN where a subset isn't found, and
        the status (P,); ``start`` (P, U) is where they are looked for."""
        distance = np.full(start.shape, np.nan)
        status = self.status.copy()
        flat = picture.ravel()
        whole = np.rint(start @ self.directions)
        rows = np.flatnonzero(status == Status.OK)
        for _ in range(ROUNDS):
            outside = ~self._inside(whole, rows)
            status[rows[outside]] = Status.OUTSIDE
            rows = rows[~outside]
            jump = (whole[rows, 1] * self.image_shape[1] + whole[rows, 0]).astype(np.int64)
            grey = flat[self._index[rows] + jump[:, None]].astype(np.float64)
            seen = np.matmul(self._functionals[rows], grey[:, :, None])[:, :, 0]
            there = self._agreeing(whole[rows], seen, rows)
            off = there @ self.directions - whole[rows]
            settled = np.abs(off).max(axis=1) <= SETTLED
            kept = rows[settled]
            distance[kept] = there[settled]
            like = self._likeness(off[settled], seen[settled, -1], grey[settled], kept)
            status[kept[~(like >= MIN_LIKENESS)]] = Status.LOW_CORRELATION
            lost = ~np.isfinite(off).all(axis=1)
            status[rows[lost]] = Status.LOW_CORRELATION
            rows, off = rows[~settled & ~lost], off[~settled & ~lost]
            if not rows.size:
                break
            whole[rows] += np.rint(off)
        status[rows] = Status.NOT_CONVERGED
        distance[status != Status.OK] = np.nan
        return distance, status

    def _agreeing(self, whole: Float, seen: Float, rows: Long) -> Float:
        """Distances (M, U) at which the moved reference gives the values ``seen`` (M, K): Newton's
        iteration from the whole pixels, NaN where it finds none."""
        distance = whole @ self.directions.T
        moving = np.arange(len(rows))
        for _ in range(self.method.steps):
            off = distance[moving] @ self.directions - whole[moving]
            off = np.clip(off, -FURTHEST, FURTHEST)
            model, changes = self._model(off, rows[moving])
            wrong = self.method.difference(model, seen[moving])
            step = np.linalg.solve(self._slopes(model, changes), wrong[:, :, None])[:, :, 0]
            distance[moving] = (whole[moving] + off) @ self.directions.T - step
            moving = moving[np.abs(step).max(axis=1) > TOLERANCE]  # NaN stays where it is
            if not moving.size:
                break
        if self.method.steps > 1:
            edge = np.abs(distance[moving] @ self.directions - whole[moving]).max(axis=1, initial=0)
            distance[moving[~(edge > SETTLED)]] = np.nan
        return distance

    def _likeness(self, off: Float, seen: Float, grey: Float, rows: Long) -> Float:
        """What the reference sees of a picture over what it sees of itself, so far off; NaN where a
        picture has no contrast but that of rounding."""
        contrast = grey.std(axis=1) * np.sqrt(grey.shape[1])
        contrast[contrast <= MIN_CONTRAST * self._norm[rows]] = np.nan
        model = self._model(off, rows)[0][:, -1]
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(seen * self._norm[rows] / (contrast * model))

    def _model(self, off: Float, rows: Long | slice) -> tuple[Float, Float]:
        """The functionals (M, K) of the reference moved by ``off`` (M, 2) px, and how they change
        with distances along the directions, (U, M, K)."""
        along_x, along_y = (_seven_weights(-off[:, axis]) for axis in (0, 1))
        lines = np.matmul(self._table[rows], along_x[:, None])
        values = np.matmul(along_y.transpose(0, 2, 1)[:, None], lines)
        by_x, by_y = -values[..., 0, 1], -values[..., 1, 0]
        return values[..., 0, 0], np.array([x * by_x + y * by_y for x, y in self.directions])

    def _slopes(self, model: Float, changes: Float) -> Float:
        """How the differences (M, U) change with the distances: (M, U, U)."""
        with np.errstate(divide="ignore", invalid="ignore"):
            slopes = np.stack([self.method.slope(model, change) for change in changes], axis=2)
            usable = np.abs(np.linalg.det(slopes)) > 0  # NaN isn't
        slopes[~usable] = np.nan
        return slopes

    def _shown(self) -> Bool:
        """Whether the reference shows motions along all directions, by any fraction: (P,)."""
        shown = np.ones(len(self._norm), dtype=bool)
        for fraction in FRACTIONS:
            off = np.tile(fraction, (len(shown), 1))
            slopes = self._slopes(*self._model(off, slice(None)))
            shown &= np.isfinite(slopes).all(axis=(1, 2))
            slopes[~shown] = 0.0
            spread = np.linalg.svd(slopes, compute_uv=False)
            shown &= spread[:, -1] > self.method.least_slope * spread[:, 0]
        return shown

    def _inside(self, whole: Float, rows: Long | slice = slice(None)) -> Bool:
        """Whether subsets moved by whole pixels (P, 2) lie in the picture."""
        corners = self._corners[rows] + whole[rows][:, :, None]
        height, width = self.image_shape
        most = np.array([width, height])[:, None]
        return np.asarray(((corners >= 0) & (corners < most)).all(axis=(1, 2)))


def _seven_weights(place: Float) -> Float:
    """Spline weights of the pixels -3 … 3 at a ``place`` (M,) in -1 … 1, and their slopes:
    (M, 7, 2)."""
    first = np.floor(place)
    fraction = place - first
    powers = fraction[:, None] ** np.arange(WEIGHTS.shape[1])
    weights = np.zeros((len(place), TAPS, 2))
    columns = first.astype(np.int64)[:, None] + 1 + np.arange(TAPS - 1)
    rows = np.arange(len(place))[:, None]
    weights[rows, columns, 0] = powers @ WEIGHTS.T
    weights[rows, columns, 1] = powers[:, :-1] @ SLOPES.T
    return weights


def _moved_functionals(coefficients: Float, row: Long, column: Long, functionals: Float) -> Float:
    """Sums (P, K, 7, 7) of the functionals over the spline's coefficients, moved by -3 … 3 px."""
    flat, width = coefficients.ravel(), coefficients.shape[1]
    place = row * width + column  # of the coefficient three rows and columns before the pixel
    table = np.empty((*functionals.shape[:2], TAPS, TAPS))
    for i in range(TAPS):
        for j in range(TAPS):
            moved = flat[place + (i * width + j)]
            table[:, :, i, j] = np.matmul(functionals, moved[:, :, None])[:, :, 0]
    return table
