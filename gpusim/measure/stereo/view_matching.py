"""Which point of the right image is which of the left one, for a calibrated pair of cameras.

Features that satisfy the epipolar constraint give the first motions; seeds that they don't reach
are searched along their epipolar line. The front then spreads with quadratic subsets, which follow
the perspective of a tilted or curved surface. What doesn't end on its epipolar line is refused.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.gpu import Device
from gpusim.measure.calibration.calibration import CalibratedCamera
from gpusim.measure.correlation.features import common_motions, feature_matches
from gpusim.measure.correlation.matching import Correlation, Settings, Status
from gpusim.measure.correlation.pixel_search import search_template
from gpusim.measure.correlation.propagation import Front, seeds
from gpusim.measure.images import FloatArray, Image
from gpusim.measure.stereo.epipolar_matching import paired_epipolar_distance
from gpusim.measure.stereo.triangulation import normalised, project
from gpusim.validation import unmasked

__all__ = ["match_views", "rig_camera"]

FEATURE_PX = 4.0  # from its epipolar line: further away a feature match is wrong
MIN_EPIPOLAR_SHARE = 0.1  # share of the feature matches that at least satisfy a right calibration
DEPTHS = 160  # places along an epipolar line, from half a baseline to 500 of them
BAND = 3  # px beside the line


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
    if not (rigid and np.linalg.det(turn) > 0):
        raise InputError(f"{name} R: got {turn.tolist()}; expected a (3, 3) rotation")
    if shift.shape != (3,) or not np.isfinite(shift).all():
        raise InputError(f"{name} t: got {shift.tolist()}; expected 3 finite lengths")
    if given.size > 14 or not np.isfinite(given).all():
        raise InputError(f"{name} distortion: got {given.tolist()}; expected up to 14 coefficients")
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn, shift
    lens = np.concatenate([given, np.zeros(14 - given.size)])
    return CalibratedCamera(name, resolution, matrix, lens, pose, {}, float("nan"))


def match_views(
    left: Image,
    right: Image,
    points: FloatArray,
    cameras: tuple[CalibratedCamera, CalibratedCamera],
    settings: Settings,
    mask: npt.NDArray[np.bool_] | None,
    blur_px: float,
    epipolar_px: float,
    device: Device | None,
) -> Correlation:
    """Correlate ``points`` (M, 2) of the left image in the right one.

    Pairs further than ``epipolar_px`` from the epipolar constraint have the status ``EPIPOLAR``.
    """
    front = Front(left, right, points, settings, mask, blur_px, 1.0, device)
    front.take_whole_image()
    chosen = seeds(points)
    here, there = feature_matches(left, right)
    if len(here):
        true = paired_epipolar_distance(cameras, here, there) <= FEATURE_PX
        if true.mean() < MIN_EPIPOLAR_SHARE:
            true[:] = True  # the calibration is wrong: match all the same, so that it shows
        diagonal = float(np.hypot(*left.shape))
        front.start_from_features(chosen, common_motions(here[true], there[true], diagonal))
    lost = chosen[~front.ok[chosen] & (front.status[chosen] != Status.NO_TEXTURE)]
    if lost.size > 0.5 * chosen.size:
        found = [_along_line(left, right, points[i], cameras, settings.half) for i in lost]
        start = np.array([place for place, _ in found])
        good = np.array([score for _, score in found]) > 0.5 * settings.min_zncc
        front.attempt(lost[good], (start - points[lost])[good])
    front.propagate()
    untried = np.flatnonzero(front.attempts == 0)
    front.attempt(untried, np.zeros((untried.size, 2)), keep=False)
    front.recheck_outliers()
    front.reject_discontinuities()
    matches = front.matches()
    ok = np.flatnonzero(front.ok)
    miss = paired_epipolar_distance(
        cameras, points[ok], points[ok] + matches.coefficients[ok, :, 0]
    )
    wrong = ok[~(miss <= epipolar_px)]
    matches.status[wrong] = Status.EPIPOLAR
    matches.coefficients[wrong] = np.nan
    matches.sigma[wrong] = np.nan
    return matches


def _along_line(
    left: Image,
    right: Image,
    point: FloatArray,
    cameras: tuple[CalibratedCamera, CalibratedCamera],
    half: int,
) -> tuple[FloatArray, float]:
    """Where on its epipolar line a subset fits best, to whole pixels, and its correlation."""
    column, row = (int(v) for v in np.rint(point))
    height, width = left.shape
    nowhere: tuple[FloatArray, float] = (point, -1.0)
    if not (half <= column < width - half and half <= row < height - half):
        return nowhere
    template = left[row - half : row + half + 1, column - half : column + half + 1]
    first, second = cameras
    ray = np.append(normalised(first, point[None])[0], 1.0)
    relative = second.camera_from_rig @ np.linalg.inv(first.camera_from_rig)
    baseline = float(np.linalg.norm(relative[:3, 3]))
    depths = baseline * np.geomspace(0.5, 500.0, DEPTHS)
    places = np.append(depths[:, None] * ray, np.ones((DEPTHS, 1)), axis=1)
    in_rig = places @ np.linalg.inv(first.camera_from_rig).T
    in_front = (in_rig @ second.camera_from_rig.T)[:, 2] > 0
    seen: npt.NDArray[Any] = project(second, in_rig[in_front, :3])[0]
    tall, wide = right.shape
    inside = (seen >= half).all(axis=1) & (seen < [wide - half, tall - half]).all(axis=1)
    line = seen[inside]
    if not len(line):
        return nowhere
    best = nowhere
    covered = np.full(2, -np.inf)
    for place in line:
        if np.abs(place - covered).max() < BAND:
            continue
        covered = place
        centre = (round(float(place[0])), round(float(place[1])))
        x, y, score = search_template(template.astype(np.float64), right, centre, BAND)
        if score > best[1]:
            best = np.array([x, y], dtype=np.float64), score
    return best
