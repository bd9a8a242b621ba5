"""Receivers of light as boxes of points: what asks for things that may hide a lamp from them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

__all__ = ["LARGE", "SINGLE", "Boxes"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]
Whole = npt.NDArray[np.int32] | npt.NDArray[np.int64]

LARGE = -1
"""In place of the number of a surface."""

SINGLE = -1.0
"""In place of how far normals lean."""


@dataclass(frozen=True, eq=False)
class Boxes:
    """``points`` (k, 3, n) around receivers, of which the first three lie in its plane; ``body``
    (n,) number of its surface where it is small, `LARGE` elsewhere: only small ones are told from
    faces beside them, of which there are few beside large ones.

    ``lean`` (n,): of patches of triangles how far the unit normals of these differ from that of the
    plane, above which all of them lie; `SINGLE` of single triangles.
    """

    points: Array
    body: Whole
    lean: Array

    @property
    def count(self) -> int:
        """n."""
        return int(self.points.shape[2])

    @property
    def single(self) -> npt.NDArray[np.bool_]:
        """(n,) which are no patches."""
        return self.lean < 0.0

    def __getitem__(self, rows: Numbers) -> Boxes:
        return Boxes(np.take(self.points, rows, axis=2), self.body[rows], self.lean[rows])

    def joined(self, others: Boxes) -> Boxes:
        """These, then others; where these have fewer points the last one is repeated."""
        most = max(len(self.points), len(others.points))
        points = [
            own[np.minimum(np.arange(most), len(own) - 1)] for own in (self.points, others.points)
        ]
        return Boxes(
            np.concatenate(points, axis=2), np.concatenate([self.body, others.body]),
            np.concatenate([self.lean, others.lean]),
        )  # fmt: skip

    @staticmethod
    def of(points: Array, body: Whole | int = LARGE) -> Boxes:
        """Single triangles with ``points`` (k, 3, n)."""
        count = points.shape[2]
        return Boxes(points, np.broadcast_to(body, count), np.full(count, SINGLE))
