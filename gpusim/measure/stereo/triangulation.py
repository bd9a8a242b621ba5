"""Points in space from two or more calibrated cameras, and how far they moved.

The direct linear transform (Hartley & Sturm, "Triangulation", 1997; Hartley & Zisserman, *Multiple
View Geometry*, 12.2) gives the first estimate, Gauss-Newton on the reprojection errors the one
that is best for equal noise in all images, with its covariance. Rigid alignment after Umeyama,
"Least-squares estimation of transformation parameters between two point patterns", 1991.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float, Long
from gpusim.errors import InputError
from gpusim.field_summary import field_summary
from gpusim.measure.calibration.calibration import CalibratedCamera
from gpusim.parallel.blas_threads import one_blas_thread
from gpusim.validation import require, unmasked

STEPS = 10
UNDISTORT_STEPS = 60
UNDISTORTED = 1e-12
ON_A_LINE = 1e-3  # width over length


@dataclass(frozen=True, eq=False)
class Triangulated:
    """M points in the rig's coordinates; rows seen by fewer than two cameras are NaN.

    ``points`` (M, 3), ``covariance`` (M, 3, 3) per unit variance of an image coordinate unless a
    noise was given, ``residual`` (M,) RMS reprojection distance in px, ``cameras`` (M,) how many
    cameras saw each.

    Examples
    --------
    >>> K = [[800, 0, 79.5], [0, 800, 59.5], [0, 0, 1]]
    >>> rig = [gs.measure.rig_camera((160, 120), K, t=(x, 0, 0)) for x in (0, -0.1)]
    >>> gs.measure.triangulate(rig, [[[79.5, 59.5]], [[-0.5, 59.5]]]).cameras
    array([2])
    """

    points: Float
    covariance: Float
    residual: Float
    cameras: Long
    __repr__ = field_summary


def normalised(camera: CalibratedCamera, pixels: npt.ArrayLike) -> Float:
    """Pixels (…, 2) as x/z, y/z in the camera's coordinates, lens undone to 1e-12.

    Newton's method on OpenCV's own projection; NaN where it doesn't settle (beyond what the lens
    model covers) or the pixel is NaN.
    """
    array = np.asarray(pixels, dtype=np.float64)
    flat = array.reshape(-1, 2)
    focal = np.array([camera.K[0, 0], camera.K[1, 1]])
    wanted = (flat - camera.K[:2, 2]) / focal
    if not camera.distortion.any():
        pinhole: Float = wanted.reshape(array.shape)
        return pinhole
    good = np.isfinite(wanted).all(axis=1)
    at = np.where(good[:, None], wanted, 0.0)
    zero = np.zeros(3)
    for _ in range(UNDISTORT_STEPS):
        rays = np.column_stack([at, np.ones(len(at))])
        seen, slopes = cv2.projectPoints(rays, zero, zero, np.eye(3), camera.distortion)
        gap = np.asarray(seen).reshape(-1, 2) - wanted
        # moving the point sideways at unit depth is moving x/z and y/z
        jacobian = np.array(slopes, dtype=np.float64)[:, 3:5].reshape(-1, 2, 2)
        step = _solve2(jacobian, gap)
        at = at - step
        if not (np.abs(step[good]) > UNDISTORTED).any():
            break
    rays = np.column_stack([at, np.ones(len(at))])
    seen = cv2.projectPoints(rays, zero, zero, np.eye(3), camera.distortion)[0]
    settled = good & (np.abs(np.asarray(seen).reshape(-1, 2) - wanted) <= 1e-9).all(axis=1)
    result: Float = np.where(settled[:, None], at, np.nan).reshape(array.shape)
    return result


def _solve2(matrix: Float, right: Float) -> Float:
    """Solve (N, 2, 2) systems; steps of singular ones are zero."""
    (a, b), (c, d) = (matrix[:, 0, 0], matrix[:, 0, 1]), (matrix[:, 1, 0], matrix[:, 1, 1])
    determinant = a * d - b * c
    fine = np.abs(determinant) > 1e-12
    safe = np.where(fine, determinant, 1.0)
    step = np.stack([d * right[:, 0] - b * right[:, 1], a * right[:, 1] - c * right[:, 0]], axis=1)
    result: Float = np.where(fine[:, None], step / safe[:, None], 0.0)
    return np.clip(result, -0.5, 0.5)


def check_calibrated(cameras: Sequence[CalibratedCamera]) -> None:
    """Raise InputError for cameras of another kind."""
    for one in cameras:
        fits = isinstance(one, CalibratedCamera)
        require(fits, "cameras", type(one).__name__, "those of calibrate, or of rig_camera")


@unmasked()
@one_blas_thread()
def triangulate(
    cameras: Sequence[CalibratedCamera],
    pixels: npt.ArrayLike,
    *,
    sigma_px: npt.ArrayLike | None = None,
    refine: bool = True,
) -> Triangulated:
    """Points seen at ``pixels`` (C, M, 2) by C cameras; NaN where one didn't see a point.

    ``sigma_px`` (C, M) or a number is the standard uncertainty of an image coordinate: points are
    weighted by it and the covariance scaled. ``refine=False`` stops at the direct linear
    transform. Raises InputError for shapes that don't fit.

    Examples
    --------
    >>> K = [[800, 0, 79.5], [0, 800, 59.5], [0, 0, 1]]
    >>> rig = [gs.measure.rig_camera((160, 120), K, t=(x, 0, 0)) for x in (0, -0.1)]
    >>> gs.measure.triangulate(rig, [[[79.5, 59.5]], [[-0.5, 59.5]]]).points.round(4) + 0.0
    array([[0., 0., 1.]])
    """
    check_calibrated(cameras)
    seen = np.asarray(pixels, dtype=np.float64)
    fits = len(cameras) >= 2 and seen.ndim == 3 and seen.shape[::2] == (len(cameras), 2)
    got = f"{len(cameras)} cameras and pixels of shape {seen.shape}"
    require(fits, "triangulate", got, "at least two and (C, M, 2)")
    noise = np.broadcast_to(np.asarray(1.0 if sigma_px is None else sigma_px), seen.shape[:2])
    rays = np.stack([normalised(c, p) for c, p in zip(cameras, seen, strict=True)])
    usable = np.isfinite(rays).all(axis=2) & (noise > 0)
    weight = np.where(usable, 1.0 / np.where(usable, noise, 1.0), 0.0)
    poses = np.stack([c.camera_from_rig for c in cameras])
    focal = np.array([[c.K[0, 0], c.K[1, 1]] for c in cameras])
    count = usable.sum(axis=0)
    enough = count >= 2
    points = _linear(poses, np.where(usable[..., None], rays, 0.0), weight, focal)
    points[~enough] = np.nan
    covariance = np.full((seen.shape[1], 3, 3), np.nan)
    residual = np.full(seen.shape[1], np.nan)
    if enough.any():
        at, covariance[enough], residual[enough] = _refined(
            cameras, points[enough], seen[:, enough], weight[:, enough], STEPS if refine else 0
        )
        points[enough] = at
    return Triangulated(points, covariance, residual, count)


def _linear(poses: Float, rays: Float, weight: Float, focal: Float) -> Float:
    """Direct linear transform in normalised coordinates, rows weighted by focal / sigma."""
    rows = []
    for pose, ray, w, f in zip(poses, rays, weight, focal, strict=True):
        for axis in range(2):
            row = ray[:, axis : axis + 1] * pose[2] - pose[axis]
            rows.append(row * (w * f[axis])[:, None])
    system = np.stack(rows, axis=1)  # (M, 2C, 4)
    # lengths of another order than 1 spoil the singular values: scale the points by their distance
    scale = float(max(np.linalg.norm(poses[1:, :3, 3], axis=1).max(), 1e-300))
    system[..., 3] /= scale
    solution = np.linalg.svd(system)[2][:, -1]
    with np.errstate(divide="ignore", invalid="ignore"):
        result: Float = solution[:, :3] / solution[:, 3:] * scale
    return result


def _refined(
    cameras: Sequence[CalibratedCamera],
    points: Float,
    seen: Float,
    weight: Float,
    steps: int,
) -> tuple[Float, Float, Float]:
    """Gauss-Newton on the reprojection errors; points, covariance, residuals."""
    pixels = np.where(np.isfinite(seen), seen, 0.0)
    for step in range(steps + 1):
        normal = np.zeros((len(points), 3, 3))
        gradient = np.zeros((len(points), 3))
        square, total = np.zeros(len(points)), np.zeros(len(points))
        for camera, pixel, w in zip(cameras, pixels, weight, strict=True):
            image, slopes = project(camera, points)
            gap = image - pixel
            gap[w == 0] = 0.0
            weighted = slopes * (w * w)[:, None, None]
            normal += np.einsum("nki,nkj->nij", weighted, slopes)
            gradient += np.einsum("nki,nk->ni", weighted, gap)
            square += np.sum(gap * gap, axis=1)
            total += w > 0
        if step == steps:
            break
        move = np.linalg.solve(normal, gradient[..., None])[..., 0]
        points = points - move
        if not (np.abs(move) > 1e-13 * np.abs(points).max()).any():
            steps = step + 1  # one more round for the residuals at the end
    covariance = np.asarray(np.linalg.inv(normal), dtype=np.float64)
    return points, covariance, np.sqrt(square / np.maximum(total, 1))


def project(camera: CalibratedCamera, points: Float) -> tuple[Float, Float]:
    """Where points (N, 3) of the rig are seen (N, 2) px, and the derivatives (N, 2, 3)."""
    pose = camera.camera_from_rig
    turn = cv2.Rodrigues(pose[:3, :3])[0]
    image, full = cv2.projectPoints(points, turn, pose[:3, 3], camera.K, camera.distortion)
    # the derivative by the translation is that by camera coordinates
    by_camera = np.asarray(full)[:, 3:6].reshape(-1, 2, 3)
    return np.array(image, dtype=np.float64).reshape(-1, 2), by_camera @ pose[:3, :3]


@unmasked()
@dataclass(frozen=True, eq=False)
class Alignment:
    """target = scale * rotation @ source + shift; ``rms`` of what is left, ``residuals`` (M, 3).

    Examples
    --------
    >>> motion = gs.measure.align(np.eye(3), np.eye(3) + [0, 0, 0.5])
    >>> motion.shift.round(6) + 0.0
    array([0. , 0. , 0.5])
    """

    rotation: Float
    shift: Float
    scale: float
    rms: float
    residuals: Float
    __repr__ = field_summary

    def apply(self, points: Float) -> Float:
        """Points (…, 3) of the source in the target's coordinates."""
        result: Float = self.scale * points @ self.rotation.T + self.shift
        return result


@unmasked()
def align(source: npt.ArrayLike, target: npt.ArrayLike, *, scale: bool = False) -> Alignment:
    """The rigid motion (with ``scale``: similarity) that takes points (M, 3) nearest to others.

    Rows with NaN are left out.

    Raises
    ------
    InputError
        Fewer than three common points, or all in one place, or on one line: that leaves a turn
        open.

    Examples
    --------
    >>> points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0.0]])
    >>> motion = gs.measure.align(points, 2.0 * points + [0, 0, 0.5], scale=True)
    >>> print(f"{motion.scale:.3f}, {motion.rms:.1e}")
    2.000, 7.7e-16
    """
    a, b = np.asarray(source, dtype=np.float64), np.asarray(target, dtype=np.float64)
    if a.shape != b.shape or a.ndim != 2 or a.shape[1] != 3:
        raise InputError(f"align: got shapes {a.shape} and {b.shape}; expected (M, 3) twice")
    good = np.isfinite(a).all(axis=1) & np.isfinite(b).all(axis=1)
    require(good.sum() >= 3, "align", f"{int(good.sum())} common points", "at least three")
    mean_a, mean_b = a[good].mean(axis=0), b[good].mean(axis=0)
    own, other = a[good] - mean_a, b[good] - mean_b
    left, values, right = np.linalg.svd(other.T @ own)
    if not values[0] > 0:
        raise InputError("align: all points are in one place; expected points apart")
    if not values[1] > ON_A_LINE**2 * values[0]:
        raise InputError("align: all points are on one line; expected points that span a plane")
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(left) * np.linalg.det(right))])
    turn = (left * sign) @ right
    factor = float((values * sign).sum() / np.sum(own**2)) if scale else 1.0
    shift = mean_b - factor * turn @ mean_a
    residuals = b - (factor * a @ turn.T + shift)
    rms = float(np.sqrt(np.mean(np.sum(residuals[good] ** 2, axis=1))))
    return Alignment(turn, shift, factor, rms, residuals)


@dataclass(frozen=True, eq=False)
class Displacement3D:
    """How far M points moved: ``displacement`` (M, 3) and its ``covariance`` (M, 3, 3).

    ``magnitude`` (M,) and ``sigma`` (M,), the standard uncertainty of the magnitude.

    Examples
    --------
    >>> K = [[800, 0, 79.5], [0, 800, 59.5], [0, 0, 1]]
    >>> rig = [gs.measure.rig_camera((160, 120), K, t=(x, 0, 0)) for x in (0, -0.1)]
    >>> before = gs.measure.triangulate(rig, [[[79.5, 59.5]], [[-0.5, 59.5]]], sigma_px=0.01)
    >>> gs.measure.displacement_3d(before, before).magnitude
    array([0.])
    """

    displacement: Float
    covariance: Float
    magnitude: Float
    sigma: Float
    __repr__ = field_summary


@unmasked()
@one_blas_thread()
def displacement_3d(
    before: Triangulated, after: Triangulated, frame: Alignment | None = None
) -> Displacement3D:
    """Displacements between two states, in the rig's coordinates or those of ``frame``.

    The covariance is that of the two triangulations; the calibration's own, which both states
    share, cancels in a difference to first order and isn't in it.

    Examples
    --------
    >>> K = [[800, 0, 79.5], [0, 800, 59.5], [0, 0, 1]]
    >>> rig = [gs.measure.rig_camera((160, 120), K, t=(x, 0, 0)) for x in (0, -0.1)]
    >>> before = gs.measure.triangulate(rig, [[[79.5, 59.5]], [[-0.5, 59.5]]])
    >>> after = gs.measure.triangulate(rig, [[[79.5, 67.5]], [[-0.5, 67.5]]])
    >>> gs.measure.displacement_3d(before, after).displacement.round(4) + 0.0
    array([[0.  , 0.01, 0.  ]])
    """
    moved = after.points - before.points
    covariance = before.covariance + after.covariance
    if frame is not None:
        turn = frame.scale * frame.rotation
        moved = moved @ turn.T
        covariance = turn @ covariance @ turn.T
    length = np.linalg.norm(moved, axis=1)
    along = moved / np.where(length > 0, length, 1.0)[:, None]
    sigma = np.sqrt(np.einsum("mi,mij,mj->m", along, covariance, along))
    return Displacement3D(moved, covariance, length, sigma)


def essential(first: CalibratedCamera, second: CalibratedCamera) -> Float:
    """The essential matrix E (3, 3): ray_2^T E ray_1 = 0 for `normalised` rays of one point."""
    relative = second.camera_from_rig @ np.linalg.inv(first.camera_from_rig)
    t = relative[:3, 3]
    cross = np.array([[0.0, -t[2], t[1]], [t[2], 0.0, -t[0]], [-t[1], t[0], 0.0]])
    result: Float = cross @ relative[:3, :3]
    return result
