"""Camera calibration from images of a target: one camera, a stereo pair or a larger rig.

First estimates come from OpenCV, the result from our own bundle adjustment.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Bool, Float
from gpusim.errors import InputError
from gpusim.field_summary import field_summary
from gpusim.measure.calibration.bundle_adjustment import (
    LENSES,
    Adjusted,
    Rig,
    Rows,
    adjust,
    residuals,
    rotation,
    without,
)
from gpusim.measure.calibration.first_estimate import MIN_POINTS, calibrated_single, first_rig
from gpusim.measure.targets.boards import Sighting
from gpusim.parallel.blas_threads import one_blas_thread
from gpusim.validation import require, require_one_of, unmasked

MIN_VIEWS = 3
OUTLIER = 6.0  # robust standard deviations
MAX_ROUNDS = 8
MAX_START_ERROR = 30.0  # px that a view may be off at the start
OUTLIER_FLOOR = 0.02  # px; a smaller residual is never an outlier


@unmasked()
@dataclass(frozen=True, eq=False)
class CalibratedCamera:
    """A calibrated camera and its place in the rig.

    Attributes
    ----------
    name, resolution : as given, (width, height) px.
    K : (3, 3) float64, px, pixel centres at integers (OpenCV).
    distortion : (14,) float64, OpenCV's k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tau_x tau_y.
    camera_from_rig : (4, 4) float64, from the first camera's frame; the target's unit of length.
    sigma : standard uncertainties by parameter name (fx fy cx cy k1 …), px or as the coefficient.
    rms : px, root of the mean squared distance between seen and projected points.

    Examples
    --------
    >>> gs.measure.rig_camera((160, 120), K=[[800, 0, 79.5], [0, 800, 59.5], [0, 0, 1]]).resolution
    (160, 120)
    """

    name: str
    resolution: tuple[int, int]
    K: Float
    distortion: Float
    camera_from_rig: Float
    sigma: dict[str, float]
    rms: float
    __repr__ = field_summary


@unmasked()
def rig_camera(
    resolution: tuple[int, int],
    K: npt.ArrayLike,
    distortion: npt.ArrayLike | None = None,
    R: npt.ArrayLike | None = None,
    t: npt.ArrayLike | None = None,
    name: str = "camera",
) -> CalibratedCamera:
    """A camera of a rig from arrays as OpenCV and others write them.

    ``R`` (3, 3) and ``t`` (3,) lead from the first camera's coordinates to this one's; without
    them it is the first. ``distortion`` has OpenCV's order, up to 14 coefficients.

    Raises InputError for shapes or values that make no camera.

    Examples
    --------
    >>> K = [[800, 0, 79.5], [0, 800, 59.5], [0, 0, 1]]
    >>> gs.measure.rig_camera((160, 120), K, t=(-0.1, 0, 0)).camera_from_rig[:3, 3]
    array([-0.1,  0. ,  0. ])
    """
    matrix = np.asarray(K, dtype=np.float64)
    turn = np.eye(3) if R is None else np.asarray(R, dtype=np.float64)
    shift = np.zeros(3) if t is None else np.ravel(np.asarray(t, dtype=np.float64))
    given = np.zeros(0) if distortion is None else np.ravel(np.asarray(distortion, np.float64))
    if matrix.shape != (3, 3) or not np.isfinite(matrix).all() or (matrix[2] != [0, 0, 1]).any():
        raise InputError(f"{name} K: got {matrix.tolist()}; expected [[fx, 0, cx], [0, fy, cy], …]")
    rigid = turn.shape == (3, 3) and np.abs(turn @ turn.T - np.eye(3)).max() <= 1e-6
    require(rigid and np.linalg.det(turn) > 0, f"{name} R", turn.tolist(), "a (3, 3) rotation")
    if shift.shape != (3,) or not np.isfinite(shift).all():
        raise InputError(f"{name} t: got {shift.tolist()}; expected 3 finite lengths")
    if given.size > 14 or not np.isfinite(given).all():
        raise InputError(f"{name} distortion: got {given.tolist()}; expected up to 14 coefficients")
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn, shift
    lens = np.concatenate([given, np.zeros(14 - given.size)])
    return CalibratedCamera(name, resolution, matrix, lens, pose, {}, float("nan"))


@dataclass(frozen=True, eq=False)
class Calibration:
    """A calibrated rig.

    Attributes
    ----------
    cameras : in the order given; the first one's coordinates are the rig's.
    lens, rms : the lens model (see `calibrate`); px, over all cameras.
    view_poses, view_rms : (V, 4, 4), from the target to the rig; (C, V) px; NaN where not seen.
    points, residuals : per camera (N, 2) float64 px, where points were seen; projected minus seen.
    used, outliers, names, covariance : numbers of points; parameters (kind, number, name); (Q, Q).

    Examples
    --------
    >>> views = [gs.export.read_image(f"board-{number}.png") for number in range(4)]
    >>> seen = [gs.measure.find_chessboard(v, gs.measure.Chessboard(7, 6, 1.0)) for v in views]
    >>> gs.measure.calibrate(seen, lens="pinhole").view_poses.shape
    (4, 4, 4)
    """

    cameras: tuple[CalibratedCamera, ...]
    lens: str
    rms: float
    view_poses: Float
    view_rms: Float
    points: tuple[Float, ...]
    residuals: tuple[Float, ...]
    used: int
    outliers: int
    names: tuple[tuple[str, int, str], ...]
    covariance: Float
    __repr__ = field_summary

    def baseline(self, camera: int = 1) -> tuple[float, float]:
        """Distance of a camera from the first one, and its standard uncertainty."""
        shift = self.cameras[camera].camera_from_rig[:3, 3]
        length = float(np.linalg.norm(shift))
        at = self._rig_rows(camera)[3:]
        along = shift / length
        return length, float(np.sqrt(along @ self.covariance[np.ix_(at, at)] @ along))

    def angle(self, camera: int = 1) -> tuple[float, float]:
        """Angle (rad) by which a camera is turned against the first, and its uncertainty."""
        turn = np.ravel(cv2.Rodrigues(self.cameras[camera].camera_from_rig[:3, :3])[0])
        angle = float(np.linalg.norm(turn))
        at = self._rig_rows(camera)[:3]
        along = turn / angle if angle > 0 else np.zeros(3)
        return angle, float(np.sqrt(along @ self.covariance[np.ix_(at, at)] @ along))

    def _rig_rows(self, camera: int) -> list[int]:
        fits = 1 <= camera < len(self.cameras)
        require(fits, "calibration", f"camera {camera} of {len(self.cameras)}", "1 or more")
        return [
            i for i, (kind, number, _) in enumerate(self.names) if (kind, number) == ("rig", camera)
        ]


@unmasked()
@one_blas_thread()
def calibrate(
    sightings: Mapping[str, Sequence[Sighting]] | Sequence[Sighting],
    *,
    lens: str = "brown",
    square_pixels: bool = False,
) -> Calibration:
    """Calibrate cameras from what they saw of one target.

    Parameters
    ----------
    sightings : per camera name one sighting per view, views in the same order for all cameras
        that are to be calibrated together; or a list for a single camera. Empty sightings are left
        out, and points off by more than 6 robust standard deviations (at least 0.02 px).
    lens : "pinhole", "radial" (k1 k2), "radial3" (k1 k2 k3), "radtan" (k1 k2 p1 p2), "brown" (k1
        k2 p1 p2 k3), "rational" (+ k4 k5 k6), "prism" (+ s1..s4), "tilted" (+ tau).
    square_pixels : one focal length for both directions.

    Raises
    ------
    InputError, GpusimError
        Fewer than three usable views in a camera, cameras without a common view; views that don't
        determine the parameters.

    Examples
    --------
    >>> views = [gs.export.read_image(f"board-{number}.png") for number in range(4)]
    >>> seen = [gs.measure.find_chessboard(v, gs.measure.Chessboard(7, 6, 1.0)) for v in views]
    >>> print(f"{gs.measure.calibrate(seen, lens='pinhole').cameras[0].K[0, 0]:.0f} px")
    800 px
    """
    seen = _checked(sightings, lens)
    names = list(seen)
    own = [calibrated_single(name, seen[name], lens) for name in names]
    start = first_rig(names, own, list(seen.values()))
    rows = [
        Rows(c, v, s.board, s.image)
        for c, name in enumerate(names)
        for v, s in enumerate(seen[name])
        if v in own[c].poses
    ]
    used_views = sorted({r.view for r in rows})
    number = {view: k for k, view in enumerate(used_views)}
    start = Rig(start.focal, start.centre, start.distortion, start.camera_pose,
                start.view_pose[used_views])  # fmt: skip
    rows = [Rows(r.camera, number[r.view], r.board, r.image) for r in rows]
    total = sum(len(r.image) for r in rows)
    adjusted, rows = _robust(start, rows, lens, square_pixels)
    kept = sum(len(r.image) for r in rows)
    views = len(seen[names[0]])
    resolutions = [next(s.resolution for s in seen[name] if len(s)) for name in names]
    return _result(names, resolutions, lens, adjusted, rows, used_views, views, total - kept)


def _checked(
    sightings: Mapping[str, Sequence[Sighting]] | Sequence[Sighting], lens: str
) -> dict[str, list[Sighting]]:
    require_one_of("calibrate: lens", lens, LENSES)
    named = sightings if isinstance(sightings, Mapping) else {"camera": sightings}
    seen = {name: list(views) for name, views in named.items()}
    counts = {name: len(views) for name, views in seen.items()}
    if not seen or len(set(counts.values())) != 1:
        raise InputError(f"calibrate: got views {counts}; expected as many for every camera")
    for name, views in seen.items():
        usable = [s for s in views if len(s) >= MIN_POINTS]
        if len(usable) < MIN_VIEWS:
            why = sorted({s.problem for s in views if s.problem})
            reasons = f" ({'; '.join(why)})" if why else ""
            raise InputError(
                f"calibrate: camera {name!r}: the target was found in {len(usable)} of "
                f"{len(views)} images{reasons}; expected at least {MIN_VIEWS}"
            )
        sizes = {s.resolution for s in usable}
        if len(sizes) > 1:
            raise InputError(f"calibrate: camera {name!r}: got images of sizes {sorted(sizes)}")
    return seen


def _robust(
    start: Rig, rows: list[Rows], lens: str, square_pixels: bool
) -> tuple[Adjusted, list[Rows]]:
    """Adjust, drop what lies far off, adjust again, until the choice stays the same.

    The furthest go first: they pull at the result, and points near them only seem wrong.
    """
    kept = _plausible(start, rows)
    used = without(rows, kept)
    adjusted = adjust(start, used, lens, square_pixels)
    for _ in range(MAX_ROUNDS):
        lengths = [np.linalg.norm(own, axis=1) for own in residuals(adjusted.rig, rows)]
        mine = np.concatenate([length[k] for length, k in zip(lengths, kept, strict=True)])
        # the length of two normal errors has the median 1.1774 sigma
        limit = max(OUTLIER * float(np.median(mine)) / 1.1774, OUTLIER_FLOOR)
        limit = max(limit, 0.3 * float(mine.max())) if mine.max() > limit else limit
        now = [np.asarray(length <= limit) for length in lengths]
        if all((a == b).all() for a, b in zip(now, kept, strict=True)):
            break
        kept, used = now, without(rows, now)
        adjusted = adjust(adjusted.rig, used, lens, square_pixels)
    return adjusted, used


def _plausible(start: Rig, rows: list[Rows]) -> list[Bool]:
    """Points to begin with: none of a camera's view that lies wholly elsewhere.

    A board that one camera took for a line of fields further on fits by itself, but no pose of it
    fits all cameras; an adjustment that begins with it doesn't settle.
    """
    sizes = np.array([_rms(own) for own in residuals(start, rows)])
    limit = max(MAX_START_ERROR, 10.0 * float(np.median(sizes)))
    return [np.full(len(r.image), size <= limit) for r, size in zip(rows, sizes, strict=True)]


def _result(
    names: Sequence[str],
    resolutions: Sequence[tuple[int, int]],
    lens: str,
    adjusted: Adjusted,
    rows: Sequence[Rows],
    used_views: Sequence[int],
    views: int,
    outliers: int,
) -> Calibration:
    rig = adjusted.rig
    spread = np.sqrt(np.diag(adjusted.covariance))
    cameras, points, gaps = [], [], []
    view_rms = np.full((len(names), views), np.nan)
    for c, name in enumerate(names):
        mine = [k for k, r in enumerate(rows) if r.camera == c]
        for k in mine:
            if len(adjusted.residuals[k]):
                view_rms[c, used_views[rows[k].view]] = _rms(adjusted.residuals[k])
        own = np.concatenate([adjusted.residuals[k] for k in mine])
        points.append(np.concatenate([rows[k].image for k in mine]))
        gaps.append(own)
        sigma = {
            parameter: float(spread[i])
            for i, (kind, number, parameter) in enumerate(adjusted.names)
            if (kind, number) == ("camera", c)
        }
        cameras.append(
            CalibratedCamera(
                name, resolutions[c], rig.matrix(c), rig.distortion[c],
                _matrix(rig.camera_pose[c]), sigma, _rms(own),
            )
        )  # fmt: skip
    poses = np.full((views, 4, 4), np.nan)
    poses[list(used_views)] = [_matrix(pose) for pose in rig.view_pose]
    return Calibration(
        tuple(cameras), lens, _rms(np.concatenate(gaps)), poses, view_rms, tuple(points),
        tuple(gaps), sum(len(p) for p in points), outliers, adjusted.names,
        adjusted.covariance,
    )  # fmt: skip


def _rms(residuals: Float) -> float:
    return float(np.sqrt(np.mean(np.sum(residuals**2, axis=1)))) if len(residuals) else np.nan


def _matrix(pose: Float) -> Float:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation(pose), pose[3:]
    return matrix
