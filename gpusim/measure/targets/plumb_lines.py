"""How a lens bends straight lines, from the lines of a flat grid in one picture (plumb lines).

Without distortion a flat grid is seen through a homography, and its lines stay straight. A smooth
field s that makes them so, x + s(x) = H(column, row), is fitted together with H: the plumb-line
method (Brown, "Close-range camera calibration", Photogrammetric Engineering 37, 1971), by
polynomials about the image's middle in place of a lens model. How many terms are worth having is
decided by Schwarz's criterion ("Estimating the dimension of a model", Ann. Statistics 6, 1978).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from gpusim.arrays.array_types import Float, Long

Straighten = Callable[[Float], Float]
"""From pixels (…, 2) to places (…, 2) where what is straight in space is straight."""

DEGREES = (3, 5)
EQUATIONS_PER_UNKNOWN = 2  # equations per unknown, at least
FARTHEST = 6.0  # robust standard deviations; points beyond don't count
GOOD_FIT = 5e-4  # px: fits that are nearer to the points aren't better ones
ROUNDS = 8
STEP = 0.5  # px, of the differences that give the field's slope


@dataclass(frozen=True, eq=False)
class PlumbField:
    """x + s(x): ``weights`` (T,) of ``terms`` about the ``middle``, in units of ``scale`` px."""

    terms: Straighten
    weights: Float
    middle: Float
    scale: float

    def __call__(self, pixels: Float) -> Float:
        """Places (…, 2) px of pixels (…, 2) where straight lines are straight."""
        result: Float = pixels + self.scale * (
            self.terms((pixels - self.middle) / self.scale) @ self.weights
        )
        return result

    def bends(self, at: Float, normal: Float, slope: Float) -> Float:
        """Curvature in 1/px, towards their normals (N, 2), of the images of straight lines there,
        by each weight (N, T); ``slope`` (N, 2, 2) is the field's there, as far as it is known."""
        x, step = (at - self.middle) / self.scale, 1e-3
        along = step * np.column_stack([-normal[:, 1], normal[:, 0]])
        second = self.terms(x + along) - 2.0 * self.terms(x) + self.terms(x - along)
        across = np.linalg.solve(slope.swapaxes(1, 2), normal[..., None])[..., 0]
        result: Float = -np.einsum("nk,nkt->nt", across, second) / (step**2 * self.scale)
        return result


def field_of_bends(
    at: Float,
    normal: Float,
    bend: Float,
    sigma: Float,
    size: tuple[int, int],
    before: PlumbField | None = None,
) -> PlumbField | None:
    """The field of a lens that bends straight lines so; None where they show nothing.

    ``bend`` and ``sigma`` (N,) are the curvatures of lines at ``at`` (N, 2) towards ``normal``
    (N, 2), 1/px, and their uncertainties: what is left of them with the field ``before``.
    """
    slope = np.broadcast_to(np.eye(2), (len(at), 2, 2))
    if before is not None:
        slope = field_slope(before, at)
        bend = bend + before.bends(at, normal, slope) @ before.weights
    middle, scale = 0.5 * (np.array(size) - 1.0), 0.5 * max(size)
    best, best_field = np.inf, None
    for terms in LENSES:
        field = PlumbField(terms, np.zeros(terms(at[:1]).shape[-1]), middle, scale)
        unknown = len(field.weights)
        if len(at) < EQUATIONS_PER_UNKNOWN * unknown:
            break
        matrix = field.bends(at, normal, slope) / sigma[:, None]
        weights = np.asarray(np.linalg.lstsq(matrix, bend / sigma, rcond=1e-9)[0], np.float64)
        misfit = float(np.square(bend / sigma - matrix @ weights).sum())
        score = misfit + unknown * np.log(max(len(at), 2))
        if score < best:
            best, best_field = score, replace(field, weights=weights)
    return best_field if best_field is not None and best_field.weights.size else None


def plumb_lines(points: Float, index: Long, size: tuple[int, int]) -> PlumbField | None:
    """The field that straightens a grid's lines; None where its points don't show any bend.

    ``points`` (N, 2) px are those at columns and rows ``index`` (N, 2) of a flat grid, ``size``
    (width, height) that of the image.
    """
    middle, scale = 0.5 * (np.array(size) - 1.0), 0.5 * max(size)
    x = (points - middle) / scale
    best, best_fit = np.inf, None
    for terms in (*LENSES, *STRETCHED, *map(_polynomial, DEGREES)):
        unknown = 8 + terms(x[:1]).shape[-1]
        if 2 * len(x) < EQUATIONS_PER_UNKNOWN * unknown:
            continue
        weights, square = _fit(x, index.astype(np.float64), terms)
        variance = square / (2 * len(x)) + (GOOD_FIT / scale) ** 2
        score = 2 * len(x) * np.log(variance) + unknown * np.log(2 * len(x))
        if score < best:
            best, best_fit = score, (terms, weights)
    if best_fit is None or not best_fit[1].size:
        return None
    return PlumbField(*best_fit, middle, scale)


def straight_offsets(straighten: Straighten, at: Float, offset: Float) -> Float:
    """Offsets (C, P, 2) from places ``at`` (C, 2) px, straightened; the same to first order."""
    bent = straighten(at[:, None, :] + offset) - straighten(at)[:, None, :]
    return np.asarray(bent @ np.linalg.inv(field_slope(straighten, at)).swapaxes(1, 2))


def field_slope(straighten: Straighten, at: Float) -> Float:
    """Derivatives (N, 2, 2) of a field: [[dX/dx, dX/dy], [dY/dx, dY/dy]]."""
    ends = [(straighten(at + d) - straighten(at - d)) / (2 * STEP) for d in STEP * np.eye(2)]
    return np.stack(ends, axis=-1)


def _lens(radial: int, centre: int) -> Straighten:
    """x r^2, x r^4 … up to as many, and what a shift of the lens's centre makes of the first ones:
    for r^2 that is tangential distortion."""

    def terms(x: Float) -> Float:
        square = (x * x).sum(axis=-1)[..., None, None]
        column = x[..., None]
        shift = column * x[..., None, :]
        every = [column * square**n for n in range(1, radial + 1)]
        every += [
            square**n * np.eye(2) + 2 * n * square ** (n - 1) * shift for n in range(1, centre + 1)
        ]
        return np.concatenate([np.zeros((*x.shape, 0)), *every], axis=-1)

    return terms


LENSES = tuple(_lens(*orders) for orders in ((0, 0), (1, 0), (2, 1), (3, 2)))


def _stretched(radial: int, centre: int) -> Straighten:
    """What pixels that aren't square make of the same: x times all even monomials, and for a shift
    of the lens's centre all monomials of second, fourth … degree."""
    even = [(2 * k, 2 * (n - k)) for n in range(1, radial + 1) for k in range(n + 1)]
    shift = [(k, 2 * n - k) for n in range(1, centre + 1) for k in range(2 * n + 1)]

    def terms(x: Float) -> Float:
        column, row = x[..., None, :1], x[..., None, 1:]
        every = [x[..., None] * column**i * row**j for i, j in even]
        every += [column**i * row**j * np.eye(2) for i, j in shift]
        return np.concatenate(every, axis=-1)

    return terms


STRETCHED = tuple(_stretched(*orders) for orders in ((1, 1), (2, 1), (3, 1), (3, 2)))


def _polynomial(degree: int) -> Straighten:
    """All monomials from the second degree on, in both coordinates."""
    powers = [(n - k, k) for n in range(2, degree + 1) for k in range(n + 1)]

    def terms(x: Float) -> Float:
        every = [np.ones((2, *x.shape[:-1]))]
        for _ in range(degree):
            every.append(every[-1] * np.moveaxis(x, -1, 0))
        monomials = np.stack([every[a][0] * every[b][1] for a, b in powers], axis=-1)
        both = np.zeros((*x.shape, 2 * len(powers)))
        both[..., 0, : len(powers)] = monomials
        both[..., 1, len(powers) :] = monomials
        return both

    return terms


def _fit(x: Float, grid: Float, terms: Straighten) -> tuple[Float, float]:
    """Weights (T,) of the terms, and the sum of squares that is left: of points beyond `FARTHEST`
    the square of that, so that no fit gains by leaving points out."""
    grid = (grid - grid.mean(axis=0)) / np.maximum(np.ptp(grid, axis=0), 1.0)
    values = terms(x)
    weights = np.zeros(values.shape[-1])
    h = _homography(grid, x)
    use = np.ones(len(x), dtype=bool)
    square = limit = np.inf
    for _ in range(ROUNDS):
        image, slopes = _seen(h, grid)
        deviation = x + values @ weights - image
        length = np.linalg.norm(deviation, axis=1)
        # the length of two normal errors has the median 1.1774 sigma
        limit = max(FARTHEST * float(np.median(length)) / 1.1774, 1e-9)
        use = length <= limit
        jacobian = np.concatenate([values, -slopes], axis=-1)[use].reshape(2 * use.sum(), -1)
        step = np.linalg.lstsq(jacobian, -deviation[use].ravel(), rcond=1e-9)[0]
        weights, h = weights + step[: len(weights)], h + step[len(weights) :]
        before, square = square, float(np.square(deviation[use]).sum())
        if abs(before - square) <= 1e-6 * square:
            break
    image, _ = _seen(h, grid)
    square_deviation = np.square(x + values @ weights - image).sum(axis=1)
    return weights, float(np.minimum(square_deviation, limit**2).sum())


def _homography(grid: Float, x: Float) -> Float:
    """The first eight entries (8,) of the homography from grid to image, the ninth 1."""
    one, zero = np.ones(len(grid)), np.zeros((len(grid), 3))
    flat = np.column_stack([grid, one])
    rows = [np.hstack([flat, zero, -x[:, :1] * grid]), np.hstack([zero, flat, -x[:, 1:] * grid])]
    entries: Float = np.linalg.lstsq(np.vstack(rows), x.T.ravel(), rcond=None)[0]
    return entries


def _seen(h: Float, grid: Float) -> tuple[Float, Float]:
    """Places (N, 2) of the grid under the homography, and their derivatives (N, 2, 8)."""
    flat = np.column_stack([grid, np.ones(len(grid))])
    depth = flat @ np.append(h[6:], 1.0)
    image = np.stack([flat @ h[:3], flat @ h[3:6]], axis=1) / depth[:, None]
    slopes = np.zeros((len(grid), 2, 8))
    slopes[:, 0, :3] = slopes[:, 1, 3:6] = flat / depth[:, None]
    slopes[:, :, 6:] = -image[:, :, None] * (grid / depth[:, None])[:, None, :]
    return image, slopes
