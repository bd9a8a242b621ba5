"""Readers of flow, written from the formats' descriptions alone."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt


def read_flo(data: bytes) -> npt.NDArray[np.float32]:
    """Middlebury's .flo (H, W, 2), NaN where nothing is known (more than 1e9)."""
    assert np.frombuffer(data, "<f4", 1)[0] == np.float32(202021.25)
    width, height = np.frombuffer(data, "<i4", 2, offset=4)
    flow = np.frombuffer(data, "<f4", offset=12).reshape(height, width, 2).copy()
    flow[(np.abs(flow) > 1e9).any(axis=2)] = np.nan
    return flow


def read_kitti(data: bytes) -> npt.NDArray[np.float64]:
    """KITTI's flow (H, W, 2): (u - 2^15) / 64 in the first channel, v in the second one, valid in
    the third."""
    blue, green, red = cv2.split(
        cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_ANYDEPTH | cv2.IMREAD_COLOR)
    )
    assert red.dtype == np.uint16
    flow = (np.stack([red, green], axis=2).astype(np.float64) - 2.0**15) / 64.0
    flow[blue == 0] = np.nan
    return flow
