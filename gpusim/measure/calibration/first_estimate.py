"""First estimates of a rig: each camera by itself, and how they stand to each other.

Cameras come from ``cv2.calibrateCamera`` (Zhang, "A flexible new technique for camera calibration",
2000), the rig from views that two of them share. Boards may look the same when they are turned: a
camera on its head, or one that happens to begin at another corner, gives such a board's corners
other places than its neighbours do. In a single view both readings fit. But cameras stand the same
way to each other in all views, and with a wrong reading they don't, as soon as the board is tilted
differently.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import GpusimError, InputError
from gpusim.measure.calibration.bundle_adjustment import DISTORTION, Rig, compose, inverse, rotation
from gpusim.measure.targets.boards import Sighting

MIN_POINTS = 6  # per view
MIN_RATIO = 3.0  # times as far apart as with the best readings: the others are wrong
MIN_DISTANCE = 1e-9


@dataclass(frozen=True, eq=False)
class SingleCamera:
    """First estimate of one camera: K (3, 3), distortion (14,), pose (6,) by view."""

    K: Float
    distortion: Float
    poses: dict[int, Float]


def calibrated_single(name: str, views: Sequence[Sighting], lens: str) -> SingleCamera:
    """A camera by itself, of which every used view has `MIN_POINTS`."""
    used = [v for v, s in enumerate(views) if len(s) >= MIN_POINTS]
    resolution = views[used[0]].resolution
    flags = cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K3
    if lens == "pinhole":
        flags |= cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2
    try:
        _, K, coefficients, turns, shifts = cv2.calibrateCamera(
            [views[v].board.astype(np.float32) for v in used],
            [views[v].image.astype(np.float32) for v in used],
            resolution,
            np.eye(3),
            np.zeros(5),
            flags=flags,
        )
    except cv2.error as error:
        raise GpusimError(
            f"calibrate: camera {name!r}: no first estimate ({error.err}); expected views of the "
            "target at different tilts"
        ) from None
    distortion = np.zeros(DISTORTION)
    distortion[:5] = np.ravel(coefficients)[:5]
    if not np.isfinite(K).all():
        raise GpusimError(f"calibrate: camera {name!r}: no first estimate; views too much alike")
    poses = {
        v: np.concatenate([np.ravel(turn), np.ravel(shift)])
        for v, turn, shift in zip(used, turns, shifts, strict=True)
    }
    return SingleCamera(np.asarray(K, dtype=np.float64), distortion, poses)


def first_rig(
    names: Sequence[str], cameras: Sequence[SingleCamera], seen: Sequence[list[Sighting]]
) -> Rig:
    """The cameras in one rig: relative poses from the views that two cameras share.

    Sightings (and poses) of boards that a camera saw the other way round are turned.
    """
    placed = {0: np.zeros(6)}
    while len(placed) < len(cameras):
        best: tuple[int, int, int] | None = None
        for c in range(len(cameras)):
            for known in placed:
                common = len(cameras[c].poses.keys() & cameras[known].poses.keys())
                if c not in placed and common and (best is None or common > best[0]):
                    best = common, c, known
        if best is None:
            apart = [names[c] for c in range(len(cameras)) if c not in placed]
            raise InputError(f"calibrate: {apart} share no view of the target with {names[0]!r}")
        _, c, known = best
        common_views = sorted(cameras[c].poses.keys() & cameras[known].poses.keys())
        turns = best_turns(
            [cameras[known].poses[v] for v in common_views],
            [cameras[c].poses[v] for v in common_views],
            [seen[c][v] for v in common_views],
        )
        for v, quarter in zip(common_views, turns, strict=True):
            if quarter:
                cameras[c].poses[v] = turned_pose(cameras[c].poses[v], seen[c][v], quarter)
                seen[c][v] = turned(seen[c][v], quarter)
        between = _middle(
            [compose(inverse(cameras[known].poses[v]), cameras[c].poses[v]) for v in common_views]
        )
        placed[c] = compose(placed[known], between)
    views = max(max(o.poses) for o in cameras) + 1
    poses = np.full((views, 6), np.nan)
    for c, camera in enumerate(cameras):
        for v, pose in camera.poses.items():
            if not np.isfinite(poses[v]).all():
                poses[v] = compose(pose, inverse(placed[c]))
    return Rig(
        np.array([[o.K[0, 0], o.K[1, 1]] for o in cameras]),
        np.array([[o.K[0, 2], o.K[1, 2]] for o in cameras]),
        np.stack([o.distortion for o in cameras]),
        np.stack([placed[c] for c in range(len(cameras))]),
        poses,
    )


def _middle(poses: Sequence[Float]) -> Float:
    """The pose with the least sum of distances to the others: no mean, so outliers don't count."""
    stack = np.stack(poses)
    size = np.maximum(np.median(np.linalg.norm(stack[:, 3:], axis=1)), 1e-30)
    scaled = np.concatenate([stack[:, :3], stack[:, 3:] / size], axis=1)
    apart = np.linalg.norm(scaled[:, None] - scaled[None], axis=2).sum(axis=1)
    result: Float = stack[int(np.argmin(apart))]
    return result


def turned(sighting: Sighting, quarter: int) -> Sighting:
    """The sighting with its board turned by so many quarters about its middle."""
    assert sighting.turns is not None
    # a pose that first turns the board leaves its points where they were
    pose = _turn(sighting.turns.middle, -quarter)
    return replace(sighting, board=sighting.board @ rotation(pose).T + pose[3:])


def turned_pose(pose: Float, sighting: Sighting, quarter: int) -> Float:
    """The pose (6,) that goes with `turned`."""
    assert sighting.turns is not None
    return compose(_turn(sighting.turns.middle, quarter), pose)


def best_turns(
    first: Sequence[Float], second: Sequence[Float], sightings: Sequence[Sighting]
) -> list[int]:
    """By how many quarters each of the ``sightings`` of a second camera is to be turned.

    ``first``, ``second``: per view the board's pose (6,) for two cameras, from the board to the
    camera. No turn where the views don't tell.
    """
    symmetry = next((s.turns for s in sightings if s.turns is not None), None)
    if symmetry is None or len(first) < 2:
        return [0] * len(first)
    quarters = range(0, 4, 1 if symmetry.square else 2)
    between = np.array(
        [
            [
                _flat(compose(inverse(one), compose(_turn(symmetry.middle, q), two)))
                for q in quarters
            ]
            for one, two in zip(first, second, strict=True)
        ]
    )  # (V, turns, 12)
    size = float(np.median(np.linalg.norm(between[..., 9:], axis=-1)))
    between[..., 9:] /= max(size, 1e-30)
    views = len(between)
    # every reading of every view proposes how the cameras stand to each other
    proposed = between.reshape(-1, 12)
    apart = np.linalg.norm(between[None] - proposed[:, None, None], axis=-1)
    choice = apart.argmin(axis=2)  # (proposals, V)
    score = apart.min(axis=2).sum(axis=1)
    best = int(score.argmin())
    others = (choice != choice[best]).all(axis=1)
    if others.any() and not score[others].min() > MIN_RATIO * score[best] + MIN_DISTANCE * views:
        return [0] * views
    return [list(quarters)[k] for k in choice[best]]


def _turn(middle: tuple[float, float], quarter: int) -> Float:
    """The pose (6,) that turns a board about its middle."""
    pose = np.zeros(6)
    pose[2] = 0.5 * np.pi * quarter
    place = np.array([*middle, 0.0])
    pose[3:] = place - rotation(pose) @ place
    return pose


def _flat(pose: Float) -> Float:
    return np.concatenate([rotation(pose).ravel(), pose[3:]])
