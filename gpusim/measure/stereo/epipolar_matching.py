"""Which marker of one image is which of the other: epipolar distance, depth, one to one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.field_summary import field_summary
from gpusim.measure.calibration.calibration import CalibratedCamera
from gpusim.measure.images import FloatArray
from gpusim.measure.stereo.triangulation import essential, normalised, triangulate
from gpusim.validation import unmasked

__all__ = ["Matches", "epipolar_distance", "match_epipolar", "paired_epipolar_distance"]


@dataclass(frozen=True, eq=False)
class Matches:
    """``pairs`` (K, 2) row numbers in the first and the second image, ``distance`` (K,) px from
    the epipolar line, ``ambiguous`` (K,) bool: another partner would have fitted as well.

    Examples
    --------
    >>> K = [[800, 0, 79.5], [0, 800, 59.5], [0, 0, 1]]
    >>> first, second = (gs.measure.rig_camera((160, 120), K, t=(x, 0, 0)) for x in (0, -0.1))
    >>> gs.measure.match_epipolar(first, second, [[80, 20], [80, 40]], [[10, 40], [10, 20]]).pairs
    array([[0, 1],
           [1, 0]])
    """

    pairs: npt.NDArray[np.int64]
    distance: FloatArray
    ambiguous: npt.NDArray[np.bool_]
    __repr__ = field_summary


@unmasked()
def epipolar_distance(
    first: CalibratedCamera,
    second: CalibratedCamera,
    pixels_1: npt.ArrayLike,
    pixels_2: npt.ArrayLike,
) -> FloatArray:
    """Distance in px (M1, M2) of each pair from satisfying the epipolar constraint.

    Sampson's first-order distance (Sampson, 1982), with the lenses undone.

    Examples
    --------
    >>> K = [[800, 0, 79.5], [0, 800, 59.5], [0, 0, 1]]
    >>> first, second = (gs.measure.rig_camera((160, 120), K, t=(x, 0, 0)) for x in (0, -0.1))
    >>> gs.measure.epipolar_distance(first, second, [[80, 20]], [[10, 20], [10, 22]]).round(3)
    array([[0.   , 1.414]])
    """
    lines_2, rays_2, slope_2, slope_1 = _epipolar_lines((first, second), pixels_1, pixels_2)
    value = np.einsum("ni,mi->nm", lines_2, rays_2)
    return np.asarray(np.abs(value) / np.sqrt(slope_2[:, None] + slope_1[None, :]))


def paired_epipolar_distance(
    cameras: tuple[CalibratedCamera, CalibratedCamera], left: FloatArray, right: FloatArray
) -> FloatArray:
    """Distance (M,) in px of row by row from the epipolar constraint, as `epipolar_distance`."""
    lines_2, rays_2, slope_2, slope_1 = _epipolar_lines(cameras, left, right)
    value = np.abs((lines_2 * rays_2).sum(axis=1))
    return np.asarray(value / np.sqrt(slope_2 + slope_1))


def _epipolar_lines(
    cameras: tuple[CalibratedCamera, CalibratedCamera],
    pixels_1: npt.ArrayLike,
    pixels_2: npt.ArrayLike,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Lines (M1, 3) in the second image, rays (M2, 3) there, and Sampson's squared slopes (M1,) by
    the pixels of the second image and (M2,) of the first."""
    first, second = cameras
    rays_1, rays_2 = (
        np.column_stack([ray, np.ones(len(ray))])
        for ray in (normalised(first, pixels_1), normalised(second, pixels_2))
    )
    E = essential(first, second)
    lines_2, lines_1 = rays_1 @ E.T, rays_2 @ E
    f1, f2 = (float(np.mean(np.diag(camera.K)[:2])) for camera in cameras)
    slope_2 = np.sum(lines_2[:, :2] ** 2, axis=1) / f2**2
    slope_1 = np.sum(lines_1[:, :2] ** 2, axis=1) / f1**2
    return lines_2, rays_2, slope_2, slope_1


@unmasked()
def match_epipolar(
    first: CalibratedCamera,
    second: CalibratedCamera,
    pixels_1: npt.ArrayLike,
    pixels_2: npt.ArrayLike,
    *,
    limit_px: float = 1.0,
    depth: tuple[float, float] | None = None,
) -> Matches:
    """Pair the points (M1, 2) and (M2, 2) of two images, one to one.

    A pair needs an epipolar distance up to ``limit_px`` and lies, if ``depth`` is given, at a
    distance between these two from the first camera (along its axis). Among such pairs the
    assignment with the least sum of distances is taken (as many pairs as possible). Points on a
    line along the epipolar lines can't be told apart by distance alone: give a depth range.

    Raises
    ------
    InputError
        Points that aren't (M, 2), or limits that aren't positive.

    Examples
    --------
    >>> K = [[800, 0, 79.5], [0, 800, 59.5], [0, 0, 1]]
    >>> first, second = (gs.measure.rig_camera((160, 120), K, t=(x, 0, 0)) for x in (0, -0.1))
    >>> gs.measure.match_epipolar(first, second, [[80, 20], [80, 40]], [[10, 40], [10, 20]]).pairs
    array([[0, 1],
           [1, 0]])
    """
    a, b = np.asarray(pixels_1, dtype=np.float64), np.asarray(pixels_2, dtype=np.float64)
    for name, points in (("pixels_1", a), ("pixels_2", b)):
        if points.ndim != 2 or points.shape[1] != 2:
            raise InputError(f"match_epipolar {name}; got shape {points.shape}; expected (M, 2)")
    if not limit_px > 0:
        raise InputError(f"match_epipolar limit_px; got {limit_px}; expected px > 0")
    distance = epipolar_distance(first, second, a, b)
    possible = np.asarray(distance <= limit_px)  # false for NaN
    if depth is not None:
        low, high = depth
        if not 0 < low < high:
            raise InputError(f"match_epipolar depth; got {depth}; expected 0 < nearest < farthest")
        i, j = np.nonzero(possible)
        if len(i):
            points = triangulate((first, second), np.stack([a[i], b[j]]), refine=False).points
            pose = first.camera_from_rig
            z = points @ pose[2, :3] + pose[2, 3]
            possible[i, j] = (z >= low) & (z <= high)
    dear = 1e3 * limit_px * (1 + max(distance.shape, default=0))
    cost = np.where(possible, np.where(np.isfinite(distance), distance, 0.0), dear)
    # here: a tenth of all that a measurement imports, for the few that pair points
    from scipy.optimize import linear_sum_assignment

    i, j = linear_sum_assignment(cost)
    kept = possible[i, j]
    i, j = i[kept], j[kept]
    rivals = (possible[i].sum(axis=1) > 1) | (possible[:, j].sum(axis=0) > 1)
    return Matches(np.stack([i, j], axis=1).astype(np.int64), distance[i, j], rivals)
