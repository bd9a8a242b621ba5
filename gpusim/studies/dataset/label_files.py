"""Labels as files: flow as Middlebury, KITTI and float TIFF have it; other layers as TIFF."""

from __future__ import annotations

import struct

import cv2
import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.export.images import encoded_picture
from gpusim.export.layers import LAYERS
from gpusim.validation import require

_UNKNOWN = 1e10
"""What stands for no flow in .flo: readers take more than 1e9 for it."""
_STEPS, _ZERO = 64.0, 32768.0
"""Of KITTI's 16 bit: steps a px, and where 0 px is."""
_PLAIN = [cv2.IMWRITE_TIFF_COMPRESSION, 1]


def flo_bytes(flow: Float) -> bytes:
    """Flow (H, W, 2) px, NaN where there is none, as a .flo file.

    "PIEH", width and height as little-endian int32, then u, v of each pixel as float32, row by row
    (Baker et al., A database and evaluation methodology for optical flow, IJCV 92, 2011).

    Examples
    --------
    >>> from gpusim.studies.dataset.label_files import flo_bytes
    >>> flo_bytes(np.zeros((1, 1, 2)))
    b'PIEH\\x01\\x00\\x00\\x00\\x01\\x00\\x00\\x00\\x00\\x00\\x00\\x00\\x00\\x00\\x00\\x00'
    """
    require(flow.ndim == 3 and flow.shape[2] == 2, "flow", f"shape {flow.shape}", "(H, W, 2)")
    known = np.isfinite(flow).all(axis=2, keepdims=True)
    values = np.where(known, flow, _UNKNOWN).astype("<f4")
    return b"PIEH" + struct.pack("<ii", flow.shape[1], flow.shape[0]) + values.tobytes()


def kitti_bytes(flow: Float) -> bytes:
    """Flow (H, W, 2) px as KITTI's PNG of 16 bit: red u, green v, each 64 times + 32768, blue 1
    where there is one (Menze & Geiger, Object scene flow for autonomous vehicles, CVPR 2015).

    Values are rounded to 1/64 px; those of 512 px and more have no place there, and no label.

    Examples
    --------
    >>> from gpusim.studies.dataset.label_files import kitti_bytes
    >>> kitti_bytes(np.zeros((1, 1, 2)))[1:4]
    b'PNG'
    """
    require(flow.ndim == 3 and flow.shape[2] == 2, "flow", f"shape {flow.shape}", "(H, W, 2)")
    coded = np.rint(flow * _STEPS + _ZERO)
    with np.errstate(invalid="ignore"):
        valid = ((coded >= 0) & (coded <= 65535)).all(axis=2, keepdims=True)
    return encoded_picture(
        np.concatenate([np.where(valid, coded, 0), valid], axis=2).astype(np.uint16), ".png"
    )


def label_bytes(layer: str, values: Float, flow_format: str) -> tuple[str, bytes]:
    """The ending and the content of the file of a layer's ``values`` (H, W) or (H, W, k).

    Layers of two components have a third one in a TIFF, 1 where they are known: OpenCV reads none
    of two.

    Examples
    --------
    >>> from gpusim.studies.dataset.label_files import label_bytes
    >>> label_bytes("depth", np.ones((2, 3), np.float32), "flo")[0]
    'tiff'
    """
    if layer in ("flow", "forward_flow"):
        if flow_format == "flo":
            return "flo", flo_bytes(values)
        if flow_format == "kitti":
            return "png", kitti_bytes(values)
        known = np.isfinite(values).all(axis=2, keepdims=True)
        values = np.concatenate([values, known], axis=2)
    floats = np.dtype(LAYERS[layer].dtype).kind == "f"
    stored = values.astype(np.float32 if floats else np.int32)
    return "tiff", encoded_picture(stored, ".tiff", _PLAIN)
