"""OpenCV's FileStorage: single cameras, stereo pairs as its samples write them, and whole rigs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import InputError
from gpusim.optics.calibration.document import (
    Document,
    coefficients,
    make,
    number,
    pose_of,
    read_document,
    relative,
)
from gpusim.optics.camera.pinhole import Camera
from gpusim.validation import require

Size = tuple[int, int] | None

_MATRIX = ("camera_matrix", "cameraMatrix", "Camera_Matrix", "K")
_BENT = (
    "distortion_coefficients", "distCoeffs", "Distortion_Coefficients", "dist_coeffs", "distortion",
    "D",
)  # fmt: skip
_TURN, _SHIFT = ("R", "rvec", "rotation"), ("T", "tvec", "translation")
_MODELS = ("plumb_bob", "rational_polynomial", "brown", "radtan", "opencv", "none", "")
_FISHEYE = ("fisheye", "omni", "equidist", "kannala")
"""In the name of a key, or of a model."""
_NO = ("0", "0.0", "false", "no", "")
LARGEST = 100  # rows and columns of a matrix
WIDEST = 1_000_000  # px


def read_opencv(text: str, where: str, size: Size) -> list[Camera]:
    """``cameras`` (a list of maps), M1 D1 M2 D2 R T, or camera_matrix and distortion_coefficients.

    A map may hold name, image_width, image_height, R (or rvec) and T (or tvec) of X_camera = R X +
    T. R and T of a pair lead from the first camera to the second. Matrices are OpenCV's, with or
    without its tag (ROS), or rows in brackets. `gpusim calibrate`'s own ``calibration.json`` is
    read too.
    """
    return cameras_of(read_document(text, where), where, size)


def cameras_of(root: Document, where: str, size: Size) -> list[Camera]:
    """The cameras in a document that was read already."""
    root = from_message(root)
    _check_pinhole(root, where)
    if "cameras" in root:
        rig = root["cameras"]
        if not isinstance(rig, list) or not rig or not all(isinstance(one, dict) for one in rig):
            raise InputError(f"{where}: cameras; got no list of cameras; expected at least one map")
        for i, node in enumerate(rig):
            _check_pinhole(node, f"{where}: cameras[{i}]")
        _check_poses(rig, where)
        cameras = [_single(node, f"{where}: cameras[{i}]", f"camera {i}", size)
                   for i, node in enumerate(rig)]  # fmt: skip
        beside = {key: value for key, value in root.items() if key != "cameras"}
        if any(key in beside for key in (*_pair_keys("M", 1), *_MATRIX)):
            first = cameras[0].width, cameras[0].height
            _check_agreement(cameras, cameras_of(beside, where, first), where)
        return cameras
    if _matrix(root, _pair_keys("M", 1), where) is None:
        return [_single(root, where, "camera", size)]
    return _pair(root, where, size)


def _check_pinhole(node: Document, where: str) -> None:
    """Refuse what says that it is a fisheye; ``fisheye_model: 0`` says that it is none."""
    for key, value in node.items():
        word = str(value).lower()
        named = key == "xi" or any(kind in key.lower() for kind in _FISHEYE)
        model = key in ("model", "lens_model", "camera_model") and any(k in word for k in _FISHEYE)
        if model or (named and word not in _NO):
            raise InputError(f"{where}: {key}; got a fisheye or omnidirectional model; expected a "
                             "pinhole with radial and tangential distortion")  # fmt: skip


def _check_poses(rig: Sequence[Document], where: str) -> None:
    """Where one camera has a pose, all have it: a file that ends early isn't taken for a whole."""
    for keys in (_TURN, _SHIFT):
        known = (*keys, "camera_from_first_mm")
        lack = [i for i, node in enumerate(rig) if not any(key in node for key in known)]
        expected = "it, as the other cameras have"
        key = f"{where}: cameras[{min(lack, default=0)}]: {keys[0]}"
        require(len(lack) in (0, len(rig)), key, "nothing", expected)


def _check_agreement(listed: Sequence[Camera], beside: Sequence[Camera], where: str) -> None:
    """Refuse a file that tells the same camera in two ways, as `write_opencv` does, in its list of
    cameras and in keys beside it, and was changed in one place only."""
    for k, (one, other) in enumerate(zip(listed, beside, strict=False)):
        pose = relative(one, listed[0]) if len(beside) == 2 else one.camera_from_world
        for what, got, expected in (
            ("camera_matrix", one.K, other.K),
            ("distortion_coefficients", coefficients(one), coefficients(other)),
            ("R, T", pose, other.camera_from_world),
        ):
            same = np.allclose(got, expected, rtol=1e-6, atol=1e-9)
            way_out = (
                "as the keys beside the list say; change both, or delete these keys or the list"
            )
            key = f"{where}: cameras[{k}]: {what}"
            require(same, key, got.tolist(), f"{expected.tolist()} {way_out}")


def needs_extrinsics(root: Document) -> bool:
    """Whether a document has the inside of two cameras and not how they stand to each other."""
    both = all(any(key in root for key in _pair_keys("M", i)) for i in (1, 2))
    return both and not ("R" in root and "T" in root)


def _pair_keys(letter: str, number: int) -> tuple[str, ...]:
    names = {"M": ("M", "cameraMatrix", "K", "camera_matrix_"),
             "D": ("D", "distCoeffs", "dist_coeffs_")}[letter]  # fmt: skip
    return tuple(f"{name}{number}" for name in names)


def _pair(root: Document, where: str, size: Size) -> list[Camera]:
    shape = _size(root, where) or size
    R, T = np.eye(3), np.zeros(3)
    cameras = []
    for i in (1, 2):
        K = _matrix(root, _pair_keys("M", i), where)
        if K is None:
            break
        bent = _matrix(root, _pair_keys("D", i), where)
        _check_lens(root, bent, where, f"D{i}")
        if i == 2:
            turn, shift = (_matrix(root, (key,), where) for key in ("R", "T"))
            if turn is None or shift is None:
                raise InputError(
                    f"{where}: R, T; got nothing; expected those of the second camera, here or in "
                    "the file of extrinsics beside this one"
                )
            R, T = _rotation(turn, where), _vector(shift, where)
        values = np.zeros(5) if bent is None else bent
        cameras.append(make(f"{where}: M{i}", f"camera {i}", shape, K, values, R, T))
    return cameras


def _single(node: Document, where: str, name: str, size: Size) -> Camera:
    K = _matrix(node, _MATRIX, where)
    if K is None:
        raise InputError(f"{where}: camera_matrix; got nothing; expected a 3 x 3 matrix")
    bent = _matrix(node, _BENT, where)
    _check_lens(node, bent, where, "distortion_coefficients")
    pose = _matrix(node, ("camera_from_first_mm",), where)
    if pose is not None:
        require(pose.shape == (4, 4), f"{where}: camera_from_first_mm", pose.shape, "(4, 4)")
    R = _matrix(node, _TURN, where) if pose is None else pose[:3, :3]
    T = _matrix(node, _SHIFT, where) if pose is None else pose[:3, 3]
    label = node.get("name", node.get("camera_name", name))
    require(K.shape == (3, 3), f"{where}: camera_matrix", f"shape {K.shape}", "(3, 3)")
    K, shape = read_out(node, K, _size(node, where) or size, where)
    return make(
        where,
        label if isinstance(label, str) else f"{label:g}" if isinstance(label, float) else name,
        shape,
        K,
        np.zeros(5) if bent is None else bent,
        np.eye(3) if R is None else _rotation(R, where),
        np.zeros(3) if T is None else _vector(T, where),
    )


def _check_lens(node: Document, bent: Float | None, where: str, key: str) -> None:
    """Refuse lens models that aren't OpenCV's, and coefficients under a name that isn't known."""
    model = node.get("distortion_model", "")
    known = isinstance(model, str) and model.lower() in _MODELS
    expected = "plumb_bob or rational_polynomial"
    require(known, f"{where}: distortion_model", repr(model), expected)
    unknown = [k for k in node if "dist" in k.lower() and k != "distortion_model"]
    if bent is None and unknown:
        raise InputError(f"{where}: {unknown[0]}; got an unknown key; expected {key}")


def _rotation(R: Float, where: str) -> Float:
    """A matrix, or a Rodrigues vector turned into one."""
    if R.size == 3:
        return np.asarray(cv2.Rodrigues(R.reshape(3, 1))[0], np.float64)
    fits = R.shape == (3, 3)
    require(fits, f"{where}: R", f"shape {R.shape}", "(3, 3) or a vector of three")
    return R


def _vector(T: Float, where: str) -> Float:
    require(T.size == 3, f"{where}: T", f"{T.size} numbers", "3")
    return T.ravel()


def _matrix(node: Document, keys: Sequence[str], where: str) -> Float | None:
    """The first of the keys that is there: OpenCV's rows, cols and data, or rows in brackets."""
    key = next((key for key in keys if key in node), None)
    if key is None:
        return None
    place, value = f"{where}: {key}", node[key]
    if not isinstance(value, dict):
        return _nested(value, place)
    sides = []
    for side in ("rows", "cols"):
        count = value.get(side, "nothing")
        sides.append(_whole(count, f"{place}.{side}", 1, LARGEST, f"1 to {LARGEST}"))
    size = sides[0] * sides[1]
    require("data" in value, f"{place}.data", "nothing", f"{size} numbers")
    data = _nested(value["data"], f"{place}.data").ravel()
    got = f"{data.size} numbers"
    require(data.size == size, f"{place}.data", got, f"{size}, as rows x cols")
    return data.reshape(sides)


def _nested(value: Any, place: str) -> Float:
    """A number, a list of numbers, or a list of rows."""
    rows = value if isinstance(value, list) else [value]
    require(len(rows) <= LARGEST**2, place, f"{len(rows)} entries", "a small matrix")
    if rows and all(isinstance(row, list) for row in rows):
        even = len({len(row) for row in rows}) == 1
        require(even, place, "rows of different lengths", "a matrix")
        return np.array([[number(entry, place) for entry in row] for row in rows])
    return np.array([number(entry, place) for entry in rows])


def _size(node: Document, where: str) -> Size:
    for keys in (("image_width", "image_height"), ("image_Width", "image_Height"),
                 ("imageWidth", "imageHeight"), ("width", "height")):  # fmt: skip
        if all(key in node for key in keys):
            columns, rows = (_side(node[key], f"{where}: {key}") for key in keys)
            return columns, rows
    for key in ("image_size", "imageSize", "size", "resolution_px", "resolution"):
        value = node.get(key)
        if isinstance(value, list) and len(value) == 2:
            columns, rows = (_side(side, f"{where}: {key}") for side in value)
            return columns, rows
    return None


def _side(value: Any, place: str) -> int:
    return _whole(value, place, 1, WIDEST, "a whole number of pixels")


def _whole(value: Any, place: str, least: int, most: int, expected: str) -> int:
    found = number(value, place)
    require(found == int(found) and least <= found <= most, place, f"{found:g}", expected)
    return int(found)


def write_opencv(
    cameras: Sequence[Camera], unit: str, comments: Sequence[str], suffix: str = ".yml"
) -> str:
    """A list ``cameras`` of maps, as YAML or as the ``suffix`` .xml or .json says. Beside it stand,
    of one camera, the keys of OpenCV's calibration sample, of two those of its stereo sample.

    ``length_unit`` is a key of its own, which OpenCV's programs pass over.
    """
    flags = cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY
    storage = cv2.FileStorage(suffix if suffix in (".xml", ".json") else ".yml", flags)
    storage.write("length_unit", unit)
    for text in comments:
        storage.writeComment(text)
    if len(cameras) == 1:
        _write_camera(storage, cameras[0])
    elif len(cameras) == 2:
        _write_pair(storage, cameras[0], cameras[1])
    storage.startWriteStruct("cameras", cv2.FileNode_SEQ)
    for camera in cameras:
        storage.startWriteStruct("", cv2.FileNode_MAP)
        storage.write("name", camera.name)
        _write_camera(storage, camera)
        storage.endWriteStruct()
    storage.endWriteStruct()
    return str(storage.releaseAndGetString())


def _write_camera(storage: cv2.FileStorage, camera: Camera) -> None:
    R, T = pose_of(camera)
    storage.write("image_width", camera.width)
    storage.write("image_height", camera.height)
    storage.write("camera_matrix", camera.K)
    storage.write("distortion_coefficients", _row(camera))
    storage.write("R", np.ascontiguousarray(R))
    storage.write("T", T.reshape(3, 1))


def _write_pair(storage: cv2.FileStorage, first: Camera, second: Camera) -> None:
    """R and T lead from the first camera to the second."""
    for place, camera in enumerate((first, second), start=1):
        storage.write(f"M{place}", camera.K)
        storage.write(f"D{place}", _row(camera))
    pose = relative(second, first)
    storage.write("R", np.ascontiguousarray(pose[:3, :3]))
    storage.write("T", pose[:3, 3].reshape(3, 1))


def _row(camera: Camera) -> Float:
    values = np.zeros(5) if camera.distortion is None else np.asarray(camera.distortion)
    return values.reshape(1, -1)


def from_message(root: Document) -> Document:
    """A CameraInfo message, as ``ros topic echo`` prints it, with the keys of a camera YAML; any
    other document as it is.

    ROS 1 names its matrices K, D, R, P, ROS 2 k, d, r, p. R is no pose: it rectifies.
    """
    letters = next(
        (some for some in ("KDRP", "kdrp") if all(letter in root for letter in some)), None
    )
    if letters is None or "distortion_model" not in root or "T" in root:
        return root
    found = {key: value for key, value in root.items() if key not in letters}
    found["camera_matrix"] = {"rows": 3.0, "cols": 3.0, "data": root[letters[0]]}
    found["distortion_coefficients"] = root[letters[1]] or [0.0]
    header = root.get("header")
    frame = header.get("frame_id") if isinstance(header, dict) else None
    return {**found, "name": frame} if isinstance(frame, str) and frame else found


def read_out(node: Document, K: Float, size: Size, where: str) -> tuple[Float, Size]:
    """The matrix and the size of the pictures, where ``roi`` or ``binning_x`` say that they show a
    part of the sensor, or several of its pixels in one.

    K and ``size`` are those of the whole sensor; ``roi`` is in its pixels and comes before the
    binning. Pixel centres are whole numbers, so pixel 0 that is made of n of the sensor's lies at
    their (n - 1) / 2.
    """
    columns, x0 = _read_side(node, "width", "x_offset", size and size[0], where)
    rows, y0 = _read_side(node, "height", "y_offset", size and size[1], where)
    bins = [max(1, _count(node, key, where)) for key in ("binning_x", "binning_y")]
    if columns is None or rows is None:
        if (x0, y0, *bins) == (0, 0, 1, 1):
            return K, size
        raise InputError(
            f"{where}: roi or binning; got a part of the sensor; expected its image_width and "
            "image_height, too"
        )
    moved = K.copy()
    for row, (first, bin_) in enumerate(zip((x0, y0), bins, strict=True)):
        moved[row] /= bin_
        moved[row, 2] = (K[row, 2] - first + 0.5) / bin_ - 0.5
    return moved, (columns // bins[0], rows // bins[1])


def _read_side(
    node: Document, length: str, offset: str, whole: int | None, where: str
) -> tuple[int | None, int]:
    """Pixels of the sensor along a side that are read (None: not known), and the first of them."""
    roi: Any = node.get("roi")
    if not isinstance(roi, dict):  # none, or what OpenCV calls so: the valid part once undistorted
        return whole, 0
    first, count = (_count(roi, key, f"{where}: roi") for key in (offset, length))
    if count == 0:
        count = 0 if whole is None else whole - first
    fits = whole is None or 0 < count <= whole - first
    got = f"{count} from {offset} {first}"
    require(fits, f"{where}: roi.{length}", got, f"a part of the sensor's {whole} pixels")
    return count or None, first


def _count(node: Document, key: str, where: str) -> int:
    return _whole(node.get(key, 0), f"{where}.{key}", 0, WIDEST, "a whole number of pixels")
