"""Measured displacements in other coordinates: without the lens's distortion, or on a plane.

The mapping is applied to both ends of each displacement, and its slopes there to the deformation
gradient: with J0 at the point and J1 where it went, F becomes J1 F J0^-1. So a lens that bends the
image makes no strain.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float
from gpusim.errors import InputError
from gpusim.field_summary import field_summary
from gpusim.measure.calibration.calibration import CalibratedCamera
from gpusim.measure.correlation.matching import DicResult, PointResult, Status
from gpusim.measure.stereo.triangulation import normalised
from gpusim.measure.targets.plumb_lines import field_slope
from gpusim.parallel.blas_threads import one_blas_thread
from gpusim.validation import require, unmasked

Mapping = Callable[[Float], Float]


@dataclass(frozen=True)
class MappedResult(PointResult):
    """A ``DicResult`` in the coordinates of a mapping; NaN where ``status`` isn't ``OK``.

    points, displacement : (M, 2) float64, unit of the mapping.
    gradient : (M, 2, 2) float64.
    sigma : (M,) float64, of the worse displacement component, unit of the mapping.
    status : (M,) int8, values of ``Status``.
    subset : width of the subsets in that unit, at the median magnification.

    Examples
    --------
    >>> before, after = (gs.export.read_image(f"{name}.png") for name in ("before", "after"))
    >>> result = gs.measure.dic(before, after, points=[[80, 60]], backend="numpy")
    >>> gs.measure.mapped(result, lambda pixels: pixels / 800.0).points
    array([[0.1  , 0.075]])
    """

    points: Float
    displacement: Float
    gradient: Float
    sigma: Float
    status: npt.NDArray[np.int8]
    subset: float
    __repr__ = field_summary


@unmasked()
@one_blas_thread()
def mapped(result: DicResult, mapping: Mapping) -> MappedResult:
    """Express a result in the coordinates that ``mapping`` gives for pixels (N, 2).

    Points that the mapping has no place for (NaN) become ``OUTSIDE``. Raises InputError if what it
    returns isn't (N, 2).

    Examples
    --------
    >>> before, after = (gs.export.read_image(f"{name}.png") for name in ("before", "after"))
    >>> result = gs.measure.dic(before, after, points=[[80, 60]], backend="numpy")
    >>> gs.measure.mapped(result, lambda pixels: pixels / 800.0).displacement.round(5) + 0.0
    array([[0.00031, 0.     ]])
    """
    has = isinstance(result, DicResult) and callable(mapping)
    got = f"{type(result).__name__}, {type(mapping).__name__}"
    require(has, "mapped: result, mapping", got, "what dic returned, and a function")
    points = result.points
    there = points + result.displacement
    place, slope = _mapped(mapping, points)
    ok = result.ok
    target = np.full_like(points, np.nan)
    other = np.full((len(points), 2, 2), np.nan)
    if ok.any():
        target[ok], other[ok] = _mapped(mapping, there[ok])
    known = ok & np.isfinite(place).all(axis=1) & np.isfinite(target).all(axis=1)
    known &= np.isfinite(slope).all(axis=(1, 2)) & np.isfinite(other).all(axis=(1, 2))
    gradient = np.full_like(result.gradient, np.nan)
    F = np.eye(2) + result.gradient[known]
    gradient[known] = other[known] @ F @ np.linalg.inv(slope[known]) - np.eye(2)
    sigma = np.full(len(points), np.nan)
    sigma[known] = result.sigma[known] * np.linalg.norm(other[known], ord=2, axis=(1, 2))
    status = np.where(ok & ~known, Status.OUTSIDE, result.status).astype(np.int8)
    finite = np.isfinite(slope).all(axis=(1, 2))
    size = np.sqrt(np.abs(np.linalg.det(slope[finite])))
    return MappedResult(
        points=place,
        displacement=np.where(known[:, None], target - place, np.nan),
        gradient=gradient,
        sigma=sigma,
        status=status,
        subset=float(result.subset * np.median(size)) if size.size else float("nan"),
    )


def lens_mapping(camera: CalibratedCamera) -> Mapping:
    """To pixels of a camera with the same matrix K and no distortion.

    Examples
    --------
    >>> K = [[800, 0, 79.5], [0, 800, 59.5], [0, 0, 1]]
    >>> camera = gs.measure.rig_camera((160, 120), K, distortion=[0.1, 0, 0, 0])
    >>> gs.measure.lens_mapping(camera)(np.array([[79.5, 59.5]]))
    array([[79.5, 59.5]])
    """
    K = camera.K

    def undistorted(pixels: Float) -> Float:
        ray = normalised(camera, pixels)
        x = K[0, 0] * ray[:, 0] + K[0, 1] * ray[:, 1] + K[0, 2]
        return np.column_stack([x, K[1, 1] * ray[:, 1] + K[1, 2]])

    return undistorted


@unmasked()
def plane_mapping(camera: CalibratedCamera, camera_from_plane: npt.ArrayLike) -> Mapping:
    """To x, y on a plane: z = 0 of the frame that ``camera_from_plane`` (4, 4) places.

    The unit is that of the frame's translation. Raises InputError for another shape, or a plane
    that the camera looks along.

    Examples
    --------
    >>> camera = gs.measure.rig_camera((160, 120), [[800, 0, 79.5], [0, 800, 59.5], [0, 0, 1]])
    >>> plane = np.eye(4)
    >>> plane[2, 3] = 1.0
    >>> gs.measure.plane_mapping(camera, plane)(np.array([[87.5, 59.5]])).round(6)
    array([[0.01, 0.  ]])
    """
    pose = np.asarray(camera_from_plane, dtype=np.float64)
    if pose.shape != (4, 4) or not np.isfinite(pose).all():
        raise InputError(f"camera_from_plane: got shape {pose.shape}; expected finite (4, 4)")
    homography = pose[:3][:, [0, 1, 3]]
    if not np.linalg.cond(homography / np.linalg.norm(homography, axis=0)) < 1e8:
        raise InputError("camera_from_plane: the camera looks along the plane, or lies in it")
    plane_from_ray = np.linalg.inv(homography)

    def on_plane(pixels: Float) -> Float:
        ray = normalised(camera, pixels)
        place = np.column_stack([ray, np.ones(len(ray))]) @ plane_from_ray.T
        # 1 / depth: not positive behind the horizon
        inverse = np.where(place[:, 2] > 0, place[:, 2], np.nan)
        return np.asarray(place[:, :2] / inverse[:, None])

    return on_plane


def _mapped(mapping: Mapping, pixels: Float) -> tuple[Float, Float]:
    """Places (N, 2) and slopes (N, 2, 2): [[dX/dx, dX/dy], [dY/dx, dY/dy]]."""

    def at(where: Float) -> Float:
        return np.asarray(mapping(where), dtype=np.float64)

    place = at(pixels)
    if place.shape != pixels.shape:
        raise InputError(f"mapping: returned shape {place.shape}; expected {pixels.shape}")
    return place, field_slope(at, pixels)
