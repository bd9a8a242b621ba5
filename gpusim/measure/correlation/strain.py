"""Strain of measured displacements: a polynomial fitted over a window around each point.

The window is the virtual strain gauge: its size, (points across - 1) x step + subset (iDICs, Good
Practices Guide for Digital Image Correlation, 2018, 5.4), decides over what length a strain is
averaged and is reported with it. Displacements are taken along the image axes: x right, y down.
With y down the sign of the shear exy is opposite to that in axes with y up.

On a curved surface positions are fitted locally as functions of the image coordinates (xi, eta).
With the tangents A = dX/d(xi, eta) before and a = dx/d(xi, eta) after, and A = Q R, the right
Cauchy-Green tensor in the surface is C = R^-T a^T a R^-1: no reference plane, no projection.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Protocol, get_args

import numpy as np
import numpy.typing as npt
import scipy

from gpusim.arrays.array_types import Bool, Float, Int, Long
from gpusim.choices import StrainKind as StrainKind
from gpusim.errors import InputError
from gpusim.field_summary import field_summary
from gpusim.measure.correlation.matching import PointResult
from gpusim.measure.images import point_spacing
from gpusim.parallel.blas_threads import one_blas_thread
from gpusim.validation import require, require_one_of, unmasked

KINDS: tuple[StrainKind, ...] = get_args(StrainKind)
TERMS = {1: 3, 2: 6}  # unknowns of a polynomial in two variables, by degree
MIN_MEASURED_SHARE = 0.2  # share of a window's points that must have been measured
CHUNK = 1 << 21  # pairs of points handled at once
MIN_RECIPROCAL_CONDITION = 1e-10


class StrainStatus(IntEnum):
    """What became of the strain at a point.

    Examples
    --------
    >>> gs.measure.StrainStatus(0).name
    'OK'
    """

    OK = 0
    NOT_MEASURED = 1  # the point itself has no displacement
    FEW_POINTS = 2  # too few of its neighbours have one, or they lie on a line


class Measured(Protocol):
    """Displacements at points, as ``dic`` returns them."""

    @property
    def points(self) -> Float:
        """(M, 2) positions."""

    @property
    def displacement(self) -> Float:
        """(M, 2), NaN where not measured."""

    @property
    def subset(self) -> float:
        """Width of the subsets, in the unit of ``points``."""


class MeasuredSurface(Measured, Protocol):
    """Points of a surface in space, as ``stereo_dic`` returns them."""

    @property
    def shape(self) -> Float:
        """(M, 3) positions before."""

    @property
    def ok(self) -> Bool:
        """(M,), whether measured."""


@dataclass(frozen=True)
class StrainResult(PointResult):
    """Strain at M points; NaN where ``status`` isn't ``OK``.

    points : (M, 2) float64, as measured.
    tensor : (M, 2, 2) float64, symmetric, [[exx, exy], [exy, eyy]]; exy is half the shear angle.
    gradient : (M, 2, 2) float64, displacement gradient of the fit, [[du/dx, du/dy], ...].
    residual : (M,) float64, root mean square of what the fit leaves of the displacements.
    count : (M,) int32, displacements in each fit.
    status : (M,) int8, values of ``StrainStatus``.
    kind : which strain.
    gauge_px : width of the virtual strain gauge, in the unit of the points.

    Examples
    --------
    >>> before, after = (gs.export.read_image(f"{name}.png") for name in ("before", "after"))
    >>> moved = gs.measure.dic(before, after, step=20, backend="numpy")
    >>> strain = gs.measure.strain(moved, window=3)
    >>> strain.tensor.shape, bool(np.nanmax(np.abs(strain.tensor)) < 1e-3)
    ((35, 2, 2), True)
    """

    points: Float
    tensor: Float
    gradient: Float
    residual: Float
    count: Int
    status: npt.NDArray[np.int8]
    kind: StrainKind
    gauge_px: float
    __repr__ = field_summary

    @property
    def principal(self) -> Float:
        """(M, 2) float64, the larger and the smaller principal strain."""
        mean = 0.5 * (self.tensor[:, 0, 0] + self.tensor[:, 1, 1])
        radius = np.hypot(0.5 * (self.tensor[:, 0, 0] - self.tensor[:, 1, 1]), self.tensor[:, 0, 1])
        return np.column_stack([mean + radius, mean - radius])

    @property
    def angle(self) -> Float:
        """(M,) float64, rad from x towards y (clockwise as seen) to the larger principal strain."""
        difference = self.tensor[:, 0, 0] - self.tensor[:, 1, 1]
        return np.asarray(0.5 * np.arctan2(2.0 * self.tensor[:, 0, 1], difference))


@unmasked()
@one_blas_thread()
def strain(
    result: Measured,
    *,
    window: int = 5,
    kind: StrainKind = "green-lagrange",
    order: int = 1,
    spacing: float | None = None,
) -> StrainResult:
    """Fit the displacement around each point by least squares and take the strain of the fit.

    Parameters
    ----------
    result : what ``dic`` returned, or anything with ``points``, ``displacement`` and ``subset``.
    window : points across the square window, odd, at least 3. A fifth of the window's points (and
        one more than the unknowns) must have been measured.
    kind : "small" (symmetric part of the displacement gradient), "green-lagrange"
        (F^T F - 1) / 2, "hencky" ln (F^T F) / 2, both along the reference axes, or "almansi"
        (1 - F^-T F^-1) / 2, along the deformed ones.
    order : 1: planes, 2: quadratic surfaces, which follow a strain that changes within the window
        at three to four times the noise at its corners.
    spacing : distance of neighbouring points; by default their median distance.

    Raises
    ------
    InputError
        ``window``, ``kind``, ``order`` or ``spacing`` is none of these, or there are no points.

    Examples
    --------
    >>> before, after = (gs.export.read_image(f"{name}.png") for name in ("before", "after"))
    >>> result = gs.measure.dic(before, after, step=20, backend="numpy")
    >>> gs.measure.strain(result, window=3, kind="hencky").kind
    'hencky'
    """
    has = all(hasattr(result, name) for name in ("points", "displacement", "subset"))
    require(has, "strain: result", type(result).__name__, "what dic returned")
    points, displacement = result.points, result.displacement
    _check_gauge("strain", window, points)
    require(order in TERMS, "order", repr(order), "1 or 2")
    require_one_of("kind: unknown strain", kind, KINDS)
    if spacing is None:
        spacing = point_spacing(points)
    require(0 < spacing < np.inf, "spacing", repr(spacing), "a distance > 0 between points")
    gradient, residual, count = fit_gradients(
        points, displacement, 0.5 * (window - 1) * spacing, order, window
    )
    measured = np.isfinite(displacement).all(axis=1)
    status = _statuses(np.isfinite(gradient).all(axis=(1, 2)), measured)
    gradient[~measured] = np.nan
    residual[~measured] = np.nan
    return StrainResult(
        points=points,
        tensor=strain_tensor(gradient, kind),
        gradient=gradient,
        residual=residual,
        count=count,
        status=status,
        kind=kind,
        gauge_px=float((window - 1) * spacing + result.subset),
    )


@unmasked()
@one_blas_thread()
def surface_strain(
    result: MeasuredSurface, *, window: int = 5, kind: StrainKind = "green-lagrange"
) -> StrainResult:
    """Strain in the surface. The local x axis lies along the surface as the image's rows do.

    Parameters
    ----------
    result : what ``stereo_dic`` returned.
    window : points across the square window, odd, at least 3.
    kind : "green-lagrange" (C - 1) / 2 or "hencky" ln C / 2.

    ``gradient`` of the result is U - 1 with the stretch U = sqrt(C), ``residual`` the RMS distance
    of the fit from the measured displacement, in the unit of the positions. Raises InputError for
    another window or kind.

    Examples
    --------
    >>> K = [[800, 0, 79.5], [0, 800, 59.5], [0, 0, 1]]
    >>> rig = [gs.measure.rig_camera((160, 120), K, t=(x, 0, 0)) for x in (0, -0.02)]
    >>> left, right = (gs.export.read_image(f"{name}.png") for name in ("left", "right"))
    >>> shape = gs.measure.stereo_shape(left, right, rig, step=30, backend="numpy")
    >>> bool(np.nanmax(np.abs(gs.measure.surface_strain(shape, window=3).tensor)) < 1e-9)
    True
    """
    has = all(hasattr(result, name) for name in ("points", "shape", "displacement"))
    require(has, "surface_strain: result", type(result).__name__, "what stereo_dic returned")
    points = result.points
    _check_gauge("surface_strain", window, points)
    require_one_of("kind", kind, ("green-lagrange", "hencky"))
    spacing = point_spacing(points)
    reach = 0.5 * (window - 1) * spacing
    before, _, _ = fit_gradients(points, result.shape, reach, 1, window)
    moved, residual, count = fit_gradients(points, result.displacement, reach, 1, window)
    fitted = np.isfinite(before).all(axis=(1, 2)) & np.isfinite(moved).all(axis=(1, 2))
    good = fitted & result.ok
    status = _statuses(fitted, result.ok)
    tensor = np.full((len(points), 2, 2), np.nan)
    stretch = np.full((len(points), 2, 2), np.nan)
    tensor[good], stretch[good] = strain_of_tangents(before[good], moved[good], kind)
    return StrainResult(
        points=points,
        tensor=tensor,
        gradient=stretch,
        residual=np.where(good, residual, np.nan),
        count=count,
        status=status,
        kind=kind,
        gauge_px=float((window - 1) * spacing + result.subset),
    )


def strain_of_tangents(before: Float, moved: Float, kind: StrainKind) -> tuple[Float, Float]:
    """Strain ("green-lagrange" or "hencky") and U - 1, (M, 2, 2) each, in surfaces whose tangents
    A = ``before`` (M, 3, 2) change by ``moved`` (M, 3, 2)."""
    # R from the Cholesky factor of A^T A, with a positive diagonal: x stays x
    metric = np.swapaxes(before, 1, 2) @ before
    R = np.swapaxes(np.linalg.cholesky(metric), 1, 2)
    # a^T a - A^T A without the difference of large numbers
    cross = np.swapaxes(before, 1, 2) @ moved
    change = cross + np.swapaxes(cross, 1, 2) + np.swapaxes(moved, 1, 2) @ moved
    inverse = np.linalg.inv(R)
    twice = np.swapaxes(inverse, 1, 2) @ change @ inverse  # C - 1
    values, vectors = np.linalg.eigh(twice)
    values = np.maximum(values, -1 + 1e-15)
    turned = np.swapaxes(vectors, 1, 2)
    tensor = 0.5 * twice
    if kind == "hencky":
        tensor = (vectors * (0.5 * np.log1p(values))[:, None, :]) @ turned
    roots = values / (np.sqrt(1.0 + values) + 1.0)  # sqrt(1 + v) - 1
    return tensor, (vectors * roots[:, None, :]) @ turned


def _check_gauge(what: str, window: int, points: Float) -> None:
    if not isinstance(window, (int, np.integer)) or window < 3 or window % 2 == 0:
        raise InputError(f"window: got {window!r}; expected an odd number of points >= 3")
    if len(points) < 2:
        raise InputError(f"{what}: got {len(points)} points; expected at least 2")


def _statuses(fitted: Any, measured: Any) -> npt.NDArray[np.int8]:
    status = np.where(fitted, StrainStatus.OK, StrainStatus.FEW_POINTS)
    return np.where(measured, status, StrainStatus.NOT_MEASURED).astype(np.int8)


def strain_tensor(gradient: Float, kind: StrainKind) -> Float:
    """Strain (..., d, d) of displacement gradients (..., d, d); NaN stays NaN."""
    require_one_of("kind: unknown strain", kind, KINDS)
    small = 0.5 * (gradient + np.swapaxes(gradient, -1, -2))
    if kind == "small":
        return small
    # F^T F - 1 without forming 1 + small numbers: nothing cancels
    green = small + 0.5 * np.swapaxes(gradient, -1, -2) @ gradient
    if kind == "green-lagrange":
        return green
    safe = np.where(np.isfinite(gradient).all(axis=(-1, -2), keepdims=True), gradient, 0.0)
    if kind == "almansi":
        inverse = np.linalg.inv(np.eye(gradient.shape[-1]) + safe)
        back = -safe @ inverse  # gradient of the way back
        tensor = -0.5 * (back + np.swapaxes(back, -1, -2) + np.swapaxes(back, -1, -2) @ back)
    else:
        symmetric = 0.5 * (safe + np.swapaxes(safe, -1, -2) + np.swapaxes(safe, -1, -2) @ safe)
        values, vectors = np.linalg.eigh(symmetric)
        logarithm = 0.5 * np.log1p(2.0 * np.maximum(values, -0.5 + 1e-15))
        tensor = (vectors * logarithm[..., None, :]) @ np.swapaxes(vectors, -1, -2)
    return np.where(np.isfinite(green), tensor, np.nan)


def fit_gradients(
    points: Float, displacement: Float, reach: float, order: int, window: int
) -> tuple[Float, Float, Int]:
    """Gradients (M, 2, 2), residuals (M,) and numbers of displacements (M,) of local fits.

    A fit takes the measured points within ``reach`` along both axes.
    """
    number, terms = len(points), TERMS[order]
    values = displacement.shape[1]
    gradient = np.full((number, values, 2), np.nan)
    residual = np.full(number, np.nan)
    count = np.zeros(number, dtype=np.int32)
    known = np.flatnonzero(np.isfinite(displacement).all(axis=1))
    if known.size == 0:
        return gradient, residual, count
    scale = max(reach, 1e-300)
    # a corner of the grid sees a quarter
    least = max(terms + 1, MIN_MEASURED_SHARE * window * window)
    for first, last, row, other in _pairs(points, points[known], reach * (1 + 1e-9), window):
        a, b = ((points[known[other]] - points[first + row]) / scale).T
        basis = np.stack([np.ones_like(a), a, b, a * a, a * b, b * b][:terms])
        # relative to the mean of all: the sums of squares keep their digits
        offset = displacement[known].mean(axis=0)
        u = displacement[known[other]] - offset
        size = last - first
        normal = np.empty((size, terms, terms))
        right = np.empty((size, terms, values))
        for i in range(terms):
            for j in range(i + 1):
                normal[:, i, j] = np.bincount(row, basis[i] * basis[j], size)
                normal[:, j, i] = normal[:, i, j]
            for k in range(values):
                right[:, i, k] = np.bincount(row, basis[i] * u[:, k], size)
        numbers = np.bincount(row, minlength=size)
        eigenvalues = np.linalg.eigvalsh(normal)
        good = (numbers >= least) & (
            eigenvalues[:, 0] > MIN_RECIPROCAL_CONDITION * eigenvalues[:, -1]
        )
        solution = np.zeros((size, terms, values))
        solution[good] = np.linalg.solve(normal[good], right[good])
        residuals = u - np.einsum("tn,ntk->nk", basis, solution[row])
        spread = np.bincount(row, (residuals**2).sum(axis=1), size)
        part = np.arange(first, last)[good]
        gradient[part] = np.swapaxes(solution[good, 1:3], 1, 2) / scale
        residual[part] = np.sqrt(spread[good] / (values * numbers[good]))
        count[first:last] = numbers
    return gradient, residual, count


def _pairs(
    points: Float, known: Float, reach: float, window: int
) -> Iterator[tuple[int, int, Long, Long]]:
    """Ranges (first, last) of points, with their pairs: row in the range, known point."""
    tree = scipy.spatial.cKDTree(known)
    chunk = max(1, CHUNK // (window * window))
    for first in range(0, len(points), chunk):
        part = points[first : first + chunk]
        near: Any = tree.query_ball_point(part, reach, p=np.inf)
        lengths = np.fromiter((len(beside) for beside in near), dtype=np.int64, count=len(part))
        row = np.repeat(np.arange(len(part)), lengths)
        other = np.concatenate([np.asarray(beside, dtype=np.int64) for beside in near])
        yield first, first + len(part), row, other
