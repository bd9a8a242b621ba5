"""The order in which a kernel's invocations take their work, where some have much more of it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["WORKGROUP", "dealt"]

WORKGROUP = 64


def dealt(order: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """``order`` workgroup by workgroup, so that any run of them has those that it begins with and
    others.

    Software rasterisers give each of their threads one run.
    """
    group = np.arange(len(order)) // WORKGROUP
    turn = np.where(group < len(order) // WORKGROUP, group % WORKGROUP, WORKGROUP)
    return order[np.argsort(turn, kind="stable")]
