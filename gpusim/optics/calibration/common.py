"""What the readers and writers of calibration files share: numbers, rotations, missing sizes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.optics.camera.pinhole import Camera

__all__ = ["angles_of", "five", "from_angles", "make", "number", "pose_of", "relative"]

Array = npt.NDArray[np.float64]


def make(
    where: str,
    name: str,
    size: tuple[int, int] | None,
    K: Array,
    distortion: Sequence[float] | Array,
    R: Array,
    T: Array,
) -> Camera:
    """A camera, its rotation rounded in the file made exact again."""
    if size is None:
        raise InputError(
            f"{where}: the image size; got none in this file; expected "
            "read_calibration(path, size=(columns, rows))"
        )
    matrix = np.asarray(R, np.float64)
    if matrix.shape != (3, 3) or not np.isfinite(matrix).all():
        raise InputError(f"{where}: rotation; got shape {matrix.shape}; expected finite (3, 3)")
    u, _, v = np.linalg.svd(matrix)
    turn = u @ v
    if not (np.abs(turn - matrix).max() <= 1e-3 and np.linalg.det(turn) > 0.0):
        raise InputError(f"{where}: rotation; got {matrix.tolist()}; expected a rotation matrix")
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn, np.asarray(T, np.float64).reshape(3)
    values = np.ravel(np.asarray(distortion, np.float64))
    try:
        return Camera(size[0], size[1], K, values if values.any() else None, pose, name)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def number(text: object, where: str) -> float:
    """A finite number."""
    try:
        value = float(str(text))
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise InputError(f"{where}; got {str(text).strip()!r}; expected a number")
    return value


def from_angles(first: float, second: float, third: float) -> Array:
    """Rz(third) Ry(second) Rx(first), degrees."""
    (ca, cb, cc), (sa, sb, sc) = (f(np.radians([first, second, third])) for f in (np.cos, np.sin))
    x = np.array([[1.0, 0.0, 0.0], [0.0, ca, -sa], [0.0, sa, ca]])
    y = np.array([[cb, 0.0, sb], [0.0, 1.0, 0.0], [-sb, 0.0, cb]])
    z = np.array([[cc, -sc, 0.0], [sc, cc, 0.0], [0.0, 0.0, 1.0]])
    result: Array = z @ y @ x
    return result


def angles_of(R: Array) -> tuple[float, float, float]:
    """The angles (degrees) of which `from_angles` makes R."""
    flat = float(np.hypot(R[0, 0], R[1, 0]))
    second = np.arctan2(-R[2, 0], flat)
    if flat > 1e-9:
        first, third = np.arctan2(R[2, 1], R[2, 2]), np.arctan2(R[1, 0], R[0, 0])
    else:  # first and third turn about the same axis
        first, third = np.arctan2(-R[1, 2], R[1, 1]), 0.0
    a, b, c = np.degrees([first, second, third])
    return float(a), float(b), float(c)


def pose_of(camera: Camera) -> tuple[Array, Array]:
    """Rotation (3, 3) and translation (3,) of X_camera = R X + T."""
    return camera.camera_from_world[:3, :3], camera.camera_from_world[:3, 3]


def relative(camera: Camera, base: Camera) -> Array:
    """(4, 4): from the frame of camera ``base`` to that of ``camera``."""
    result: Array = camera.camera_from_world @ np.linalg.inv(base.camera_from_world)
    return result


def five(camera: Camera, where: str, tangential: bool = True) -> Array:
    """k1 k2 p1 p2 k3 of a camera; refused if its lens needs more."""
    values = np.zeros(14)
    if camera.distortion is not None:
        values[: len(camera.distortion)] = camera.distortion
    if values[5:].any() or (values[2:4].any() and not tangential):
        allowed = "k1 k2 k3" + (" p1 p2" if tangential else "")
        raise InputError(
            f"{where}: camera {camera.name!r} distortion; got {values.tolist()}; expected only "
            f"{allowed}, which is all that this format holds"
        )
    return values[:5]
