"""A scene's cameras turned into cameras of `gpusim.optics`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.files.input_file import Reader, read_input
from gpusim.optics.calibration.formats import read_rig
from gpusim.optics.camera.pinhole import Camera
from gpusim.scene.description import model as m

__all__ = ["build_camera"]

Array = npt.NDArray[np.float64]


def build_camera(camera: m.Camera, read: Reader = read_input) -> Camera:
    """The camera of a scene, in metres; ``read``: how its calibration is read.

    Raises
    ------
    InputError
        A matrix that is no rotation, a lens that folds in the image, or a calibration file that
        doesn't fit.
    """
    columns, rows = camera.resolution
    if camera.calibration:
        found = _calibrated(camera, read)
        pose = _pose(camera)
        return found if pose is None else replace(found, camera_from_world=pose)
    bent = np.array(camera.distortion) if camera.distortion else None
    pose = _pose(camera)
    assert pose is not None
    if camera.intrinsics:
        fx, fy, cx, cy, skew = camera.intrinsics
        K = np.array([[fx, skew, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    else:
        px, py = columns / camera.sensor[0], rows / camera.sensor[1]
        right, down = camera.principal_point_offset
        K = np.array([
            [camera.focal * px, 0.0, 0.5 * (columns - 1) + right * px],
            [0.0, camera.focal * py, 0.5 * (rows - 1) + down * py],
            [0.0, 0.0, 1.0],
        ])  # fmt: skip
    return Camera(columns, rows, K, bent, pose, camera.name)


def _pose(camera: m.Camera) -> Array | None:
    """camera_from_world, or None if only the calibration file knows."""
    if camera.position is not None and camera.target is not None:
        return Camera.from_lens(
            (1.0, 1.0), 1.0, (1, 1), camera.position, camera.target, camera.up, name=camera.name
        ).camera_from_world
    if not camera.rotation:
        return None
    pose = np.eye(4)
    if len(camera.rotation) == 3:
        from scipy.spatial.transform import Rotation  # seldom: most cameras look at a target

        pose[:3, :3] = Rotation.from_rotvec(camera.rotation).as_matrix()
    else:
        given = np.array(camera.rotation).reshape(3, 3)
        u, _, v = np.linalg.svd(given)
        # rows are typed with a few digits: the nearest rotation
        if not (np.abs(u @ v - given).max() <= 1e-3 and np.linalg.det(given) > 0.0):
            raise InputError(
                f"camera {camera.name!r} rotation_matrix; got {given.tolist()}; expected the rows "
                "of a rotation"
            )
        pose[:3, :3] = u @ v
    pose[:3, 3] = camera.translation
    return pose


def _calibrated(camera: m.Camera, read: Reader) -> Camera:
    which = camera.calibration_camera
    where = f"camera {camera.name!r} calibration {camera.calibration}"
    file = read(camera.calibration)
    # read from its bytes, so that no second file beside it is: a run knows the hash of this one
    cameras, metres = read_rig(file, camera.resolution)
    names = [found.name for found in cameras]
    if isinstance(which, str):
        if which not in names:
            raise InputError(f"{where}; got calibration_camera {which!r}; expected one of {names}")
        number = names.index(which)
    else:
        number = which
        if number >= len(cameras):
            raise InputError(
                f"{where}; got calibration_camera {which}; expected 0 to {len(cameras) - 1}"
            )
    found = cameras[number]
    if (found.width, found.height) != camera.resolution:
        raise InputError(
            f"{where}; got {found.width} x {found.height} px there; expected resolution_px "
            f"{list(camera.resolution)}"
        )
    unit = camera.calibration_unit or metres
    pose = found.camera_from_world.copy()
    pose[:3, 3] *= unit
    return replace(found, camera_from_world=pose, name=camera.name)
