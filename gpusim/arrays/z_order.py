"""Places in space along a curve that keeps neighbours together."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float

_BITS = 21
# masks of the bits of one coordinate, spread to every third place step by step
_SPREAD = (
    (32, 0x001F00000000FFFF), (16, 0x001F0000FF0000FF), (8, 0x100F00F00F00F00F),
    (4, 0x10C30C30C30C30C3), (2, 0x1249249249249249),
)  # fmt: skip


def z_order(points: Float) -> npt.NDArray[np.uint64]:
    """(N,) places of points (N, 3) along a Z-order curve (Morton 1966), coordinates to 21 bits of
    the extent."""
    if not len(points):
        return np.zeros(0, np.uint64)
    low = points.min(axis=0)
    extent = float((points.max(axis=0) - low).max()) or 1.0
    place = ((points - low) * ((2**_BITS - 1) / extent)).astype(np.uint64)
    for shift, mask in _SPREAD:
        place = (place | (place << np.uint64(shift))) & np.uint64(mask)
    return np.asarray(place[:, 0] | (place[:, 1] << np.uint64(1)) | (place[:, 2] << np.uint64(2)))
