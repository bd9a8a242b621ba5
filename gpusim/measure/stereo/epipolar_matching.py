"""Which point of one image is which of the other, for a calibrated pair of cameras.

Markers are paired by their distances from epipolar lines, by depth, and one to one. Of surfaces,
features that satisfy the epipolar constraint give the first motions; seeds that they don't reach
are searched along their epipolar line. The front then spreads with quadratic subsets, which follow
the perspective of a tilted or curved surface. What doesn't end on its epipolar line is refused.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy

from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.errors import InputError
from gpusim.field_summary import field_summary
from gpusim.gpu import Device
from gpusim.measure.calibration.calibration import CalibratedCamera
from gpusim.measure.correlation.coherence import CheckedFront
from gpusim.measure.correlation.matching import Correlation, Settings, Status
from gpusim.measure.correlation.propagation import seeds
from gpusim.measure.correlation.start_values import (
    Motion,
    common_motions,
    feature_matches,
    search_template,
)
from gpusim.measure.images import Image
from gpusim.measure.stereo.triangulation import essential, normalised, project, triangulate
from gpusim.validation import require, unmasked

FEATURE_PX = 4.0  # from its epipolar line: further away a feature match is wrong
MIN_EPIPOLAR_SHARE = 0.1  # share of the feature matches that at least satisfy a right calibration
DEPTHS = 160  # places along an epipolar line, from half a baseline to 500 of them
BAND = 3  # px beside the line


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

    pairs: Long
    distance: Float
    ambiguous: Bool
    __repr__ = field_summary


@unmasked()
def epipolar_distance(
    first: CalibratedCamera,
    second: CalibratedCamera,
    pixels_1: npt.ArrayLike,
    pixels_2: npt.ArrayLike,
) -> Float:
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
    cameras: tuple[CalibratedCamera, CalibratedCamera], left: Float, right: Float
) -> Float:
    """Distance (M,) in px of row by row from the epipolar constraint, as `epipolar_distance`."""
    lines_2, rays_2, slope_2, slope_1 = _epipolar_lines(cameras, left, right)
    value = np.abs((lines_2 * rays_2).sum(axis=1))
    return np.asarray(value / np.sqrt(slope_2 + slope_1))


def _epipolar_lines(
    cameras: tuple[CalibratedCamera, CalibratedCamera],
    pixels_1: npt.ArrayLike,
    pixels_2: npt.ArrayLike,
) -> tuple[Float, Float, Float, Float]:
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
    require(limit_px > 0, "match_epipolar limit_px", limit_px, "px > 0")
    distance = epipolar_distance(first, second, a, b)
    possible = np.asarray(distance <= limit_px)  # false for NaN
    if depth is not None:
        low, high = depth
        require(0 < low < high, "match_epipolar depth", depth, "0 < nearest < farthest")
        i, j = np.nonzero(possible)
        if len(i):
            points = triangulate((first, second), np.stack([a[i], b[j]]), refine=False).points
            pose = first.camera_from_rig
            z = points @ pose[2, :3] + pose[2, 3]
            possible[i, j] = (z >= low) & (z <= high)
    dear = 1e3 * limit_px * (1 + max(distance.shape, default=0))
    cost = np.where(possible, np.where(np.isfinite(distance), distance, 0.0), dear)
    i, j = scipy.optimize.linear_sum_assignment(cost)
    kept = possible[i, j]
    i, j = i[kept], j[kept]
    rivals = (possible[i].sum(axis=1) > 1) | (possible[:, j].sum(axis=0) > 1)
    return Matches(np.stack([i, j], axis=1).astype(np.int64), distance[i, j], rivals)


def match_views(
    left: Image,
    right: Image,
    points: Float,
    cameras: tuple[CalibratedCamera, CalibratedCamera],
    settings: Settings,
    mask: Bool | None,
    blur_px: float,
    epipolar_px: float,
    device: Device | None,
) -> Correlation:
    """Correlate ``points`` (M, 2) of the left image in the right one.

    Pairs further than ``epipolar_px`` from the epipolar constraint have the status ``EPIPOLAR``.
    """
    front = CheckedFront((left, right), points, settings, mask, blur_px, 1.0, device)
    front.take_whole_image()
    features_left, features_right = feature_matches(left, right)
    motions: list[Motion] = []
    if len(features_left):
        true = paired_epipolar_distance(cameras, features_left, features_right) <= FEATURE_PX
        if true.mean() < MIN_EPIPOLAR_SHARE:
            true[:] = True  # the calibration is wrong: match all the same, so that it shows
        diagonal = float(np.hypot(*left.shape))
        motions = common_motions(features_left[true], features_right[true], diagonal)
    _start(front, seeds(points, front.spacing), motions, cameras)
    front.propagate()
    # a patch finer than the rest, as a gauge's, has its neighbours in itself: nothing leads there
    apart = np.flatnonzero((front.attempts == 0) & ~front.closed)
    if apart.size and front.ok.any():
        _start(front, apart[seeds(points[apart], front.spacing_of(apart))], motions, cameras)
        front.propagate()
    untried = np.flatnonzero(front.attempts == 0)
    front.attempt(untried, np.zeros((untried.size, 2)), keep=False)
    front.recheck_outliers()
    front.reject_discontinuities()
    matches = front.matches
    ok = np.flatnonzero(front.ok)
    miss = paired_epipolar_distance(
        cameras, points[ok], points[ok] + matches.coefficients[ok, :, 0]
    )
    wrong = ok[~(miss <= epipolar_px)]
    matches.refuse(wrong, Status.EPIPOLAR)
    return matches


def _start(
    front: CheckedFront,
    chosen: Long,
    motions: list[Motion],
    cameras: tuple[CalibratedCamera, CalibratedCamera],
) -> None:
    """Start ``chosen`` from the motions of features, and along epipolar lines if these fail."""
    settings, points = front.settings, front.points
    front.start_from_features(chosen, motions)
    lost = chosen[~front.ok[chosen] & (front.matches.status[chosen] != Status.NO_TEXTURE)]
    if lost.size > 0.5 * chosen.size:
        matched = [_along_line(*front.images, points[i], cameras, settings.half) for i in lost]
        start = np.array([place for place, _ in matched])
        good = np.array([score for _, score in matched]) > 0.5 * settings.min_zncc
        front.attempt(lost[good], (start - points[lost])[good])


def _along_line(
    left: Image,
    right: Image,
    point: Float,
    cameras: tuple[CalibratedCamera, CalibratedCamera],
    half: int,
) -> tuple[Float, float]:
    """Where on its epipolar line a subset fits best, to whole pixels, and its correlation."""
    column, row = (int(v) for v in np.rint(point))
    height, width = left.shape
    nowhere: tuple[Float, float] = (point, -1.0)
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
