"""Boxes of equal labels in a grid."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["equal_boxes"]

Long = npt.NDArray[np.int64]


def equal_boxes(label: Long, wanted: npt.NDArray[np.bool_]) -> Long:
    """(B,7) boxes that cover the ``wanted`` places of ``label`` (X,Y,Z), each of one label.

    A line is the label, then first and stop along x, y and z. Equal neighbours are joined along
    z, stretches of the same extent along y, and these along x; the boxes don't overlap.
    """
    x, y, z = np.nonzero(wanted)
    value = label[wanted]
    boxes = np.stack([value, x, x + 1, y, y + 1, z, z + 1], axis=1).astype(np.int64)
    for axis in (2, 1, 0):
        first, stop = 1 + 2 * axis, 2 + 2 * axis
        others = [column for column in range(7) if column not in (first, stop)]
        boxes = boxes[np.lexsort([boxes[:, first], *(boxes[:, column] for column in others)])]
        joined = (boxes[1:, others] == boxes[:-1, others]).all(axis=1)
        joined &= boxes[1:, first] == boxes[:-1, stop]
        begins = np.concatenate([[True], ~joined])[: len(boxes)]
        ends = np.concatenate([~joined, [True]])[: len(boxes)]
        merged = boxes[begins]
        merged[:, stop] = boxes[ends, stop]
        boxes = merged
    return boxes
