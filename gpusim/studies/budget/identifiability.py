"""What a picture can't tell: directions in which nothing moves in it, parameters that do the same.

Image coordinates are differentiated by what is looked for; the columns are scaled to length one,
and what belongs to a singular value below `LEAST` of the largest isn't identifiable: it would be
wrong by a thousand times what the same error in the picture does to the rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.sparse.csgraph import connected_components

from gpusim.arrays.array_types import Float
from gpusim.errors import InputError
from gpusim.optics.camera.pinhole import Camera
from gpusim.pipeline.measurements.region_of_interest import region_of_interest
from gpusim.pipeline.scene_objects.cameras import build_camera
from gpusim.scene import Scene
from gpusim.scene.description.measure_table import MeasureTable

LEAST = 1e-3  # of the largest singular value
_TAKES_PART = 0.05  # of the projector on what isn't identifiable, the element that ties two
_STEP = 1e-5  # of differences: rad, and of the distance and the focal length
_ACROSS, _MOST = 500, 2000  # columns of the picture that are looked at, and points, at most
PARAMETERS = (
    "focal length", "principal point across", "principal point down", "position across",
    "position down", "position along the axis", "turn about the picture's x",
    "turn about the picture's y", "roll",
)  # fmt: skip


def remarks(scene: Scene) -> list[str]:
    """What isn't identifiable by the pictures of the scene's measures, in sentences."""
    told = []
    cameras = {one.name: build_camera(one, scene.input) for one in scene.cameras}
    for spec in scene.measures:
        views = [cameras[name] for name in spec.views]
        points = seen_points(scene, spec) if views else np.zeros((0, 3))
        if len(points) < len(PARAMETERS):
            continue
        forward = views[0].camera_from_world[2, :3]
        away = float((points.mean(axis=0) - views[0].eye) @ forward)
        values, axes = unseen_motion(views, views[0].eye + away * forward)
        if values[-1] < LEAST * values[0]:
            told.append(
                f"Measure {spec.name!r}: motion along {_direction(axes[-1])}, the line of sight of "
                f"camera {views[0].name!r}, isn't identifiable (singular value "
                f"{values[-1] / values[0]:.1g} of the largest, limit {LEAST:g}): 1 mm of it "
                f"reads as a strain of {1e3 / away:.0f} microstrain."
            )
        if len(views) == 1:  # pairs are calibrated by more than this
            least, groups = alike(views[0], points)
            doubtful = "; ".join(" and ".join(group) for group in groups)
            told += [
                f"Camera {views[0].name!r}: what measure {spec.name!r} looks at doesn't tell apart "
                f"{doubtful} (least singular value {least:.1g} of the largest, limit {LEAST:g}): "
                "calibrate by a target that is tilted, or deep."
            ] * bool(groups)
    return told


def seen_points(scene: Scene, spec: MeasureTable) -> Float:
    """Places (M, 3), m, of what the first camera of a measure measures, unloaded."""
    motion, camera = scene.motion(), spec.views[0]
    stride = max(motion.camera(camera).width // _ACROSS, 1)
    region = getattr(spec, "roi", None)
    try:
        seen = region_of_interest(f"measure {spec.name!r}", region, motion, camera, stride)
    except InputError:  # too small for these few pixels
        return np.zeros((0, 3))
    some = slice(None, None, -(-len(seen.points) // _MOST))
    return np.asarray(motion.position(seen.points[some], None))


def unseen_motion(views: Sequence[Camera], point: Float) -> tuple[Float, Float]:
    """Singular values (3,) of the image coordinates' derivative by the motion of a ``point``, m,
    and the directions (3, 3), rows, that they belong to."""
    step = _STEP * float(np.linalg.norm(point - views[0].eye))
    rows = [
        (camera.project(point + step * np.eye(3)) - camera.project(point - step * np.eye(3))).T
        for camera in views
    ]
    _, values, axes = np.linalg.svd(np.concatenate([*rows, np.zeros((1, 3))]) / (2.0 * step))
    return values[:3], axes


def alike(camera: Camera, points: Float) -> tuple[float, list[list[str]]]:
    """The least singular value of the derivative of the image coordinates of known ``points``
    (M, 3), m, by the camera's `PARAMETERS`, as a share of the largest; and groups of parameters
    that do the same to them."""
    away = float(np.linalg.norm(points.mean(axis=0) - camera.eye))
    columns = []
    for number in range(len(PARAMETERS)):
        ends = [_changed(camera, number, sign * _STEP, away).project(points) for sign in (1, -1)]
        columns.append((ends[0] - ends[1]).ravel())
    J = np.column_stack(columns)
    _, values, axes = np.linalg.svd(J / np.linalg.norm(J, axis=0), full_matrices=False)
    unknown = axes[values < LEAST * values[0]]
    ties = np.abs(unknown.T @ unknown) > _TAKES_PART
    _, labels = connected_components(ties)
    groups = [[PARAMETERS[k] for k in np.flatnonzero(labels == one)] for one in set(labels)]
    return float(values[-1] / values[0]), [group for group in groups if len(group) > 1]


def _changed(camera: Camera, number: int, step: float, away: float) -> Camera:
    """The camera with one of the `PARAMETERS` changed; lengths in units of the distance."""
    from scipy.spatial.transform import Rotation

    K, pose = camera.K.copy(), np.eye(4)
    if number == 0:
        K[[0, 1], [0, 1]] *= 1.0 + step
    elif number < 3:
        K[number - 1, 2] += step * K[0, 0]
    elif number < 6:
        pose[number - 3, 3] = -step * away
    else:
        pose[:3, :3] = Rotation.from_rotvec(step * np.eye(3)[number - 6]).as_matrix()
    return replace(camera, K=K, camera_from_world=pose @ camera.camera_from_world)


def _direction(axis: Float) -> str:
    """A direction in words: a world axis where it is one."""
    largest = int(np.argmax(np.abs(axis)))
    if abs(axis[largest]) > 1.0 - 1e-6:
        return f"the axis {'xyz'[largest]}"
    return f"({', '.join(f'{one:.2f}' for one in axis * np.sign(axis[largest]))})"
