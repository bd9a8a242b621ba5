"""Cameras of a calibration, in mm from the first one, and those of files and scenes, in metres."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gpusim.measure import CalibratedCamera, rig_camera
from gpusim.optics.calibration.formats import Source, read_calibration
from gpusim.optics.camera.pinhole import Camera
from gpusim.validation import require

MM = 1e3
Size = tuple[int, int]


def calibrated_cameras(cameras: Sequence[Camera]) -> list[CalibratedCamera]:
    """``cameras`` as a calibration without errors has them."""
    first = np.linalg.inv(cameras[0].camera_from_world)
    return [
        rig_camera((camera.width, camera.height), camera.K, camera.distortion, pose[:3, :3],
                   MM * pose[:3, 3], camera.name)
        for camera in cameras for pose in (camera.camera_from_world @ first,)
    ]  # fmt: skip


def cameras_in_file(
    what: str,
    source: Source,
    sizes: Sequence[Size],
    *,
    names: Sequence[str] = (),
    unit: str | None = None,
) -> list[CalibratedCamera]:
    """A camera of a calibration file for each of the pictures' ``sizes`` (columns, rows) px: by
    ``names``, else, if the file knows them by others, in its order.

    Raises InputError, which says ``what`` the file is, for too few, for other pictures, or for a
    name that the file has at another place.
    """
    cameras = read_calibration(source, sizes[0], unit)
    named = {camera.name: camera for camera in cameras}
    if names and set(names) <= set(named):
        cameras = [named[name] for name in names]
    for name, camera in zip(names, cameras, strict=False):
        fits = camera.name == name or name not in named
        require(fits, what, f"cameras {list(named)}", f"{list(names)}, or none of these names")
    require(len(cameras) >= len(sizes), what, f"{len(cameras)} cameras", str(len(sizes)))
    for camera, (width, height) in zip(cameras, sizes, strict=False):
        got = f"camera {camera.name!r} with {camera.width}x{camera.height} px"
        fits = (camera.width, camera.height) == (width, height)
        require(fits, what, got, f"{width}x{height} as its pictures")
    return calibrated_cameras(cameras[: len(sizes)])


def scene_cameras(cameras: Sequence[CalibratedCamera]) -> list[Camera]:
    """Cameras of a scene, or for files, in the frame of the first one."""
    result = []
    for own in cameras:
        pose = own.camera_from_rig.copy()
        pose[:3, 3] /= MM
        used = 14 if own.distortion[8:].any() else 8 if own.distortion[5:].any() else 5
        result.append(Camera(*own.resolution, own.K, own.distortion[:used], pose, own.name))
    return result
