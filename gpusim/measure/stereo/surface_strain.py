"""Strain of a curved surface from the positions of its points before and after.

Positions are fitted locally as functions of the image coordinates (xi, eta). With the tangents
A = dX/d(xi, eta) before and a = dx/d(xi, eta) after, and A = Q R, the right Cauchy-Green tensor in
the surface is C = R^-T a^T a R^-1: no reference plane, no projection.
"""

from __future__ import annotations

import numpy as np

from gpusim.errors import InputError
from gpusim.measure.correlation.strain import StrainKind, StrainResult, StrainStatus, fit_gradients
from gpusim.measure.nearest_points import point_tree
from gpusim.measure.stereo.stereo_correlation import StereoResult
from gpusim.parallel.blas_threads import one_blas_thread
from gpusim.validation import unmasked

__all__ = ["surface_strain"]


@unmasked()
@one_blas_thread()
def surface_strain(
    result: StereoResult, *, window: int = 5, kind: StrainKind = "green-lagrange"
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
    if not isinstance(window, (int, np.integer)) or window < 3 or window % 2 == 0:
        raise InputError(f"window: got {window!r}; expected an odd number of points >= 3")
    if kind not in ("green-lagrange", "hencky"):
        raise InputError(f"kind: got {kind!r}; expected 'green-lagrange' or 'hencky'")
    points = result.points
    if len(points) < 2:
        raise InputError(f"surface_strain: got {len(points)} points; expected at least 2")
    apart = np.asarray(point_tree(points).query(points, k=2)[0], dtype=np.float64)
    spacing = float(np.median(apart[:, 1]))
    reach = 0.5 * (window - 1) * spacing
    before, _, _ = fit_gradients(points, result.shape, reach, 1, window)
    moved, residual, count = fit_gradients(points, result.displacement, reach, 1, window)
    fitted = np.isfinite(before).all(axis=(1, 2)) & np.isfinite(moved).all(axis=(1, 2))
    good = fitted & result.ok
    status = np.full(len(points), StrainStatus.OK, dtype=np.int8)
    status[~fitted] = StrainStatus.FEW_POINTS
    status[~result.ok] = StrainStatus.NOT_MEASURED
    tensor = np.full((len(points), 2, 2), np.nan)
    stretch = np.full((len(points), 2, 2), np.nan)
    A, d = before[good], moved[good]
    # R from the Cholesky factor of A^T A, with a positive diagonal: x stays x
    metric = np.swapaxes(A, 1, 2) @ A
    R = np.swapaxes(np.linalg.cholesky(metric), 1, 2)
    # a^T a - A^T A without the difference of large numbers
    cross = np.swapaxes(A, 1, 2) @ d
    change = cross + np.swapaxes(cross, 1, 2) + np.swapaxes(d, 1, 2) @ d
    inverse = np.linalg.inv(R)
    twice = np.swapaxes(inverse, 1, 2) @ change @ inverse  # C - 1
    values, vectors = np.linalg.eigh(twice)
    values = np.maximum(values, -1 + 1e-15)
    turned = np.swapaxes(vectors, 1, 2)
    if kind == "hencky":
        tensor[good] = (vectors * (0.5 * np.log1p(values))[:, None, :]) @ turned
    else:
        tensor[good] = 0.5 * twice
    roots = values / (np.sqrt(1.0 + values) + 1.0)  # sqrt(1 + v) - 1
    stretch[good] = (vectors * roots[:, None, :]) @ turned
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
