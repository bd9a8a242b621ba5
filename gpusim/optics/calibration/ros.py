"""What ROS adds to a calibration: CameraInfo messages, and the part of the sensor that is read."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.optics.calibration.common import number
from gpusim.optics.calibration.document import Document

__all__ = ["from_message", "read_out"]

Array = npt.NDArray[np.float64]
Size = tuple[int, int] | None


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


def read_out(node: Document, K: Array, size: Size, where: str) -> tuple[Array, Size]:
    """The matrix and the size of the pictures, where ``roi`` or ``binning_x`` say that they show a
    part of the sensor, or several of its pixels in one.

    K and ``size`` are those of the whole sensor; ``roi`` is in its pixels and comes before the
    binning. Pixel centres are whole numbers, so pixel 0 that is made of n of the sensor's lies at
    their (n - 1) / 2.
    """
    columns, x0 = _side(node, "width", "x_offset", size and size[0], where)
    rows, y0 = _side(node, "height", "y_offset", size and size[1], where)
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


def _side(
    node: Document, length: str, offset: str, whole: int | None, where: str
) -> tuple[int | None, int]:
    """Pixels of the sensor along a side that are read (None: not known), and the first of them."""
    roi: Any = node.get("roi")
    if not isinstance(roi, dict):  # none, or what OpenCV calls so: the valid part once undistorted
        return whole, 0
    first, count = (_count(roi, key, f"{where}: roi") for key in (offset, length))
    if count == 0:
        count = 0 if whole is None else whole - first
    if whole is not None and not 0 < count <= whole - first:
        raise InputError(
            f"{where}: roi.{length}; got {count} from {offset} {first}; expected a part of the "
            f"sensor's {whole} pixels"
        )
    return count or None, first


def _count(node: Document, key: str, where: str) -> int:
    found = number(node.get(key, 0), f"{where}.{key}")
    if not (found == int(found) and 0 <= found <= 1_000_000):
        raise InputError(f"{where}.{key}; got {found:g}; expected a whole number of pixels")
    return int(found)
