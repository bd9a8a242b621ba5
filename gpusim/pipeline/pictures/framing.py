"""Whether what is to be measured lies within the pictures: boards, and regions of surfaces."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gpusim.arrays.array_types import Bool, Float
from gpusim.errors import InputError
from gpusim.measure.calibration.calibration import MIN_VIEWS
from gpusim.optics.camera.pinhole import Camera
from gpusim.pipeline.pictures.visibility import in_image, spread_points
from gpusim.pipeline.scene_objects.moving_bodies import SceneObjects
from gpusim.pipeline.scene_objects.surfaces import rotation
from gpusim.surface.frames import PaintFrame
from gpusim.surface.paint import Checker

SAMPLES = 4096
"""Points of a region, at least, that are looked at."""


def board_warnings(objects: SceneObjects, cameras: Sequence[Camera]) -> list[str]:
    """A sentence for each camera that doesn't have all inner corners of the calibration's
    chessboard in each of its pictures; without one of them the board isn't found. Of a ChArUco
    board a part is enough.

    Raises InputError if it has them in too few to be calibrated, as a measure wants it.
    """
    corners, calibration = _board_corners(objects), objects.scene.calibration
    if corners is None or calibration is None:
        return []
    found, poses = [], len(calibration.poses)
    for camera in cameras:
        if camera.name not in calibration.cameras:
            continue
        whole = int(np.count_nonzero(in_image(camera, corners).all(axis=1)))
        if whole == poses:
            continue
        text = (
            f"camera {camera.name!r}: {whole} of {poses} poses of the board lie whole in the "
            f"picture; cut-off ones aren't found, and a calibration needs {MIN_VIEWS}: take a "
            "shorter focal_mm or other poses, or move the camera farther away"
        )
        for spec in objects.scene.measures if whole < MIN_VIEWS else ():
            if spec.uses_calibration and camera.name in spec.views:
                raise InputError(f"measure {spec.name!r}: {text}")
        found.append(text)
    return found


def _board_corners(objects: SceneObjects) -> Float | None:
    """(poses, corners, 3) m, world; None without a chessboard."""
    scene, calibration = objects.scene, objects.scene.calibration
    names = [prop.name for prop in scene.props]
    if calibration is None or calibration.board not in names:
        return None
    number = names.index(calibration.board)
    prop, surface = scene.props[number], objects.props[number]
    frame, paint = surface.paint_frame(0), next(iter(surface.paints.values()))
    if not isinstance(paint, Checker) or not isinstance(frame, PaintFrame):
        return None
    if paint.columns is None or paint.rows is None:
        return None
    i, j = np.meshgrid(np.arange(1, paint.columns), np.arange(1, paint.rows))
    s, t = (start + paint.size * k.ravel() for start, k in zip(paint.origin, (i, j), strict=True))
    rest = frame.origin + s[:, None] * frame.s_axis + t[:, None] * frame.t_axis - prop.origin
    return np.stack([rest @ rotation(one.rotation).T + one.position for one in calibration.poses])


def share_in_picture(corners: Float, closed: Bool, camera: Camera) -> float:
    """Share of the area of triangles (T, 3, 3), of those that are turned to a camera, that lies
    within its image; whether each is of a ``closed`` (T,) surface, others have no back. NaN if
    none is turned to it."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    turned = np.einsum("ti,ti->t", normal, camera.eye - corners.mean(axis=1)) > 0.0
    area = np.linalg.norm(normal, axis=1) * (turned | ~closed)
    inside = in_image(camera, spread_points(corners, SAMPLES)).mean(axis=1)
    return float(inside @ area / area.sum()) if area.any() else float("nan")
