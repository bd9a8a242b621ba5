"""Faces that may hide a lamp from single receivers, of those that are listed for their tile."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.optics.corners import parts
from gpusim.optics.emitters import Lamp
from gpusim.optics.lamp_view import LampView, Reach, overlap

__all__ = ["LampPairs"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

FOOTPRINT = 0.5 + 1e-3
"""px about a receiver that samples of the lamp look from."""

TOUCH = 1e-5
"""Of the largest s, by which a face may be farther away than what it hides (a contact)."""


class LampPairs:
    """Faces with ``corners`` (F, 4, 3) as a lamp sees them, in the lamp's frame."""

    def __init__(self, lamp: Lamp, corners: Array) -> None:
        points = np.ascontiguousarray(np.moveaxis(corners, 0, 2))
        self._views = [(view, view.reach(points)) for view in LampView.of(lamp)]

    def may_hide(
        self, at: Array, across: Array, down: Array, receiver: Numbers, face: Numbers
    ) -> Flags:
        """(n,) whether each ``face`` may hide the lamp from its ``receiver``; never misses.

        ``at`` (N, 3): receivers; ``across``, ``down`` (N, 3): how they move per column and row.
        """
        right, below = FOOTPRINT * across, FOOTPRINT * down
        ends = [at + i * right + j * below for i in (-1.0, 1.0) for j in (-1.0, 1.0)]
        points = np.ascontiguousarray(np.moveaxis(np.stack(ends), 1, 2))
        result = np.zeros(len(receiver), bool)
        for view, faces in self._views:
            result |= _meet(view.half, view.reach(points), faces, receiver, face)
        return result


def _meet(
    half: tuple[float, float], own: Reach, faces: Reach, receiver: Numbers, face: Numbers
) -> Flags:
    """Whether boxes of ``faces`` lie where receivers in boxes look at a lamp, pair by pair."""
    near = own.s[0][np.isfinite(own.s[0])]
    touch = TOUCH * float(np.abs(near).max(initial=0.0))
    result = np.empty(len(face), bool)
    for part in parts(len(face)):
        with np.errstate(invalid="ignore"):  # both behind the lamp
            rise = faces.s[1][face[part]] - own.s[0][receiver[part]]
        ahead = rise >= -touch
        rise = np.clip(rise, 0.0, 1e150) + touch
        result[part] = ahead & overlap(half, own, receiver[part], faces, face[part], rise)
    return result
