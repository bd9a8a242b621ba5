"""OpenCV's FileStorage: single cameras, stereo pairs as its samples write them, and whole rigs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.optics.calibration_parts import make, pose_of
from gpusim.optics.camera import Camera

__all__ = ["read_opencv", "write_opencv"]

Array = npt.NDArray[np.float64]
Size = tuple[int, int] | None

_MATRIX = ("camera_matrix", "cameraMatrix", "Camera_Matrix", "K")
_BENT = ("distortion_coefficients", "distCoeffs", "Distortion_Coefficients", "dist_coeffs", "D")


def read_opencv(text: str, where: str, size: Size) -> list[Camera]:
    """``cameras`` (a list of maps), M1 D1 M2 D2 R T, or camera_matrix and distortion_coefficients.

    A map may hold name, image_width, image_height, R (or rvec) and T (or tvec) of X_camera = R X +
    T. R and T of a pair lead from the first camera to the second.
    """
    try:
        flags = cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY
        storage = cv2.FileStorage(text, flags)
    except (cv2.error, SystemError) as error:
        raise InputError(f"{where}; got {error}; expected OpenCV's FileStorage") from None
    if not storage.isOpened():
        raise InputError(f"{where}; got something else; expected OpenCV's FileStorage")
    root = storage.root()
    for key in ("xi", "fisheye_model", "K_fisheye"):
        if not root.getNode(key).empty():
            raise InputError(f"{where}: {key}; got a fisheye or omnidirectional model; expected a "
                             "pinhole with radial and tangential distortion")  # fmt: skip
    rig = root.getNode("cameras")
    if not rig.empty():
        nodes = [rig.at(i) for i in range(rig.size())]
        return [_single(node, f"{where}: cameras[{i}]", f"camera {i}", size)
                for i, node in enumerate(nodes)]  # fmt: skip
    first = _first(root, ("M1", "cameraMatrix1", "K1", "camera_matrix_1"))
    if first is None:
        return [_single(root, where, "camera", size)]
    shape = _size(root, where) or size
    R, T = np.eye(3), np.zeros(3)
    cameras = []
    for i in (1, 2):
        K = _first(root, (f"M{i}", f"cameraMatrix{i}", f"K{i}", f"camera_matrix_{i}"))
        if K is None:
            break
        bent = _first(root, (f"D{i}", f"distCoeffs{i}", f"dist_coeffs_{i}"))
        if i == 2:
            found = [_first(root, (key,)) for key in ("R", "T")]
            if found[0] is None or found[1] is None:
                raise InputError(f"{where}: R, T; got nothing; expected those of the second camera")
            R, T = _rotation(found[0], where), np.ravel(found[1])
        values = np.zeros(5) if bent is None else bent
        cameras.append(make(f"{where}: M{i}", f"camera {i}", shape, K, values, R, T))
    return cameras


def _single(node: Any, where: str, name: str, size: Size) -> Camera:
    K = _first(node, _MATRIX)
    if K is None:
        raise InputError(f"{where}: camera_matrix; got nothing; expected a 3 x 3 matrix")
    bent = _first(node, _BENT)
    R, T = _first(node, ("R", "rvec", "rotation")), _first(node, ("T", "tvec", "translation"))
    label = node.getNode("name")
    return make(
        where,
        label.string() if not label.empty() and label.isString() else name,
        _size(node, where) or size,
        K,
        np.zeros(5) if bent is None else bent,
        np.eye(3) if R is None else _rotation(R, where),
        np.zeros(3) if T is None else np.ravel(T),
    )


def _rotation(R: Array, where: str) -> Array:
    """A matrix, or a Rodrigues vector turned into one."""
    if R.size == 3:
        return np.asarray(cv2.Rodrigues(R.reshape(3, 1))[0], np.float64)
    if R.shape != (3, 3):
        raise InputError(f"{where}: R; got shape {R.shape}; expected (3, 3) or a vector of three")
    return R


def _first(node: Any, keys: Sequence[str]) -> Array | None:
    for key in keys:
        child = node.getNode(key)
        if not child.empty():
            matrix = child.mat()
            if matrix is None and child.isSeq():
                matrix = np.array([child.at(i).real() for i in range(child.size())])
            if matrix is not None:
                return np.asarray(matrix, np.float64)
    return None


def _size(node: Any, where: str) -> Size:
    for keys in (("image_width", "image_height"), ("image_Width", "image_Height"),
                 ("imageWidth", "imageHeight"), ("width", "height")):  # fmt: skip
        found = [node.getNode(key) for key in keys]
        if not found[0].empty() and not found[1].empty():
            return int(found[0].real()), int(found[1].real())
    for key in ("image_size", "imageSize", "size"):
        child = node.getNode(key)
        if not child.empty() and child.isSeq() and child.size() == 2:
            return int(child.at(0).real()), int(child.at(1).real())
    return None


def write_opencv(cameras: Sequence[Camera], where: str) -> str:
    """A list ``cameras`` of maps; the suffix of the file (.xml, .json, else YAML) says how."""
    suffix = "." + where.rsplit(".", 1)[-1].lower()
    kind = suffix if suffix in (".xml", ".json") else ".yml"
    flags = cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY
    storage = cv2.FileStorage(kind, flags)
    storage.startWriteStruct("cameras", cv2.FileNode_SEQ)
    for camera in cameras:
        R, T = pose_of(camera)
        storage.startWriteStruct("", cv2.FileNode_MAP)
        storage.write("name", camera.name)
        storage.write("image_width", camera.width)
        storage.write("image_height", camera.height)
        storage.write("camera_matrix", camera.K)
        bent = np.zeros(5) if camera.distortion is None else np.asarray(camera.distortion)
        storage.write("distortion_coefficients", bent.reshape(1, -1))
        storage.write("R", np.ascontiguousarray(R))
        storage.write("T", T.reshape(3, 1))
        storage.endWriteStruct()
    storage.endWriteStruct()
    return str(storage.releaseAndGetString())
