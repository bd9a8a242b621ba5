"""The faces that may hide surroundings, and which of them matter to points that lie together.

Flat parts are joined as for shadows (`gpusim.optics.merging`), and for points far enough away bent
parts, too: a face that passes from the surface by 1 % of its distance changes next to nothing
there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.optics.casters import Casters
from gpusim.optics.hemisphere import GROUP, Around, Receivers
from gpusim.optics.merging import merge_flat
from gpusim.optics.view import View
from gpusim.surface.surface import Surface

__all__ = ["Occluders", "in_groups"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]

FLATNESS = 0.05
"""px at the nearest surface, that joined faces may pass from the surface."""

COARSER = (1.0, 6.0, 36.0, 216.0)
"""Times that, level by level."""

FAR = 50.0
"""A level is for points farther away than its faces pass from the surface, times this."""

PAIRS = 1 << 18
"""Pairs of groups and faces at a time."""


@dataclass(frozen=True, eq=False)
class Occluders:
    """``corners`` (F, 4, 3) relative to the eye, from level to level fewer and larger ones.

    ``first`` (L + 1,): where the levels begin. ``owner``: for all levels but the last, which face
    of the next level each one belongs to. ``both_sides`` (F,): of surfaces that aren't closed.
    ``sag``: how far the first level's faces may pass from the surface.
    """

    corners: Array
    both_sides: npt.NDArray[np.bool_]
    first: tuple[int, ...]
    owner: tuple[Numbers, ...]
    sag: float

    @staticmethod
    def of(view: View, surfaces: Sequence[Surface]) -> Occluders:
        """Those of ``surfaces``, to what ``view`` can tell."""
        depth = 1.0 / max(float(view.inverse_depth().max(initial=0.0)), 1e-300)
        sag = FLATNESS * depth / float(np.abs(np.diag(view.camera.K)[:2]).max())
        fine = Casters.of(surfaces, lambda points: np.full(len(points), sag))
        corners, sides, owner = [fine.corners], [fine.both_sides], []
        faces, both = fine.faces, fine.both_sides
        for times in COARSER[1:]:
            merged = merge_flat(fine.points, faces, np.full(len(fine.points), times * sag))
            of = np.zeros(len(merged.faces), bool)
            of[merged.owner] = both
            faces, both = merged.faces, of
            owner.append(merged.owner)
            corners.append(fine.points[faces])
            sides.append(both)
        first = np.cumsum([0, *(len(level) for level in corners)])
        return Occluders(
            np.concatenate(corners) - view.camera.eye, np.concatenate(sides),
            tuple(first.tolist()), tuple(owner), sag,
        )  # fmt: skip

    def _used(self, away: Array) -> npt.NDArray[np.bool_]:
        """Which faces (G, F) stand for the surfaces, ``away`` (G, F) from groups of points."""
        result = np.zeros(away.shape, bool)
        done = np.zeros((len(away), self.first[-1] - self.first[-2]), bool)
        for level in range(len(COARSER) - 1, -1, -1):
            own = slice(self.first[level], self.first[level + 1])
            result[:, own] = ~done
            if level:
                result[:, own] &= away[:, own] > FAR * COARSER[level] * self.sag
                done = (done | result[:, own])[:, self.owner[level - 1]]
        return result

    def around(self, points: Receivers) -> Around:
        """Those that matter to each `GROUP` of ``points`` in order."""
        count = len(points.at)
        first = np.arange(0, count, GROUP)
        size = np.minimum(first + GROUP, count) - first
        group = np.repeat(np.arange(len(first)), size)
        middle = np.add.reduceat(points.at, first) / size[:, None] if count else points.at
        up = np.add.reduceat(points.normal, first) / size[:, None] if count else points.at
        up = up / np.maximum(np.linalg.norm(up, axis=1), 1e-300)[:, None]
        radius, lean = np.zeros(len(first)), np.zeros(len(first))
        np.maximum.at(radius, group, np.linalg.norm(points.at - middle[group], axis=1))
        np.maximum.at(lean, group, np.linalg.norm(points.normal - up[group], axis=1))
        centre = self.corners.mean(axis=1)
        reach = np.linalg.norm(self.corners - centre[:, None], axis=2).max(axis=1, initial=0.0)
        planes = np.cross(self.corners[:, 2] - self.corners[:, 0],
                          self.corners[:, 3] - self.corners[:, 1])  # fmt: skip
        planes /= np.maximum(np.linalg.norm(planes, axis=1), 1e-300)[:, None]
        starts, faces = [np.zeros(1, np.int64)], [np.zeros(0, np.int64)]
        step = max(PAIRS // max(len(centre), 1), 1)
        for begin in range(0, len(first), step):
            part = slice(begin, begin + step)
            r, tilt = radius[part, None], lean[part, None]
            to = centre[None] - middle[part, None]
            away = np.sqrt(np.einsum("gfa,gfa->gf", to, to))
            used = self._used(away - reach - r)
            # not below the horizon of all points
            height = np.einsum("gfa,ga->gf", to, up[part])
            beside = (away + reach) * tilt + r
            used &= height + reach + beside > 0.0
            # bodies hide by what they turn to a point, but those above it tell whether it's inside
            turned = np.einsum("gfa,fa->gf", to, planes)
            spread = r + 0.1 * reach + 4.0 * self.sag
            above = away * away - height * height <= (reach + beside) ** 2
            used &= self.both_sides | (turned <= spread) | above
            row, face = np.nonzero(used)
            starts.append(np.bincount(row, minlength=len(used)))
            faces.append(face)
        return Around(
            self.corners, self.both_sides, np.cumsum(np.concatenate(starts)), np.concatenate(faces)
        )


def in_groups(points: Receivers) -> Numbers:
    """The order (N,) in which points that look the same way and lie together follow each other."""
    low = points.at.min(axis=0, initial=0.0)
    size = max(float(np.ptp(points.at, axis=0).max()) if len(points.at) else 0.0, 1e-300)
    cell = np.minimum((points.at - low) / size * 1024.0, 1023.0).astype(np.int64)
    facing = np.rint(points.normal).astype(np.int64) + 1
    key = (facing[:, 0] * 3 + facing[:, 1]) * 3 + facing[:, 2]
    for bit in range(9, -1, -1):
        for axis in range(3):
            key = 2 * key + ((cell[:, axis] >> bit) & 1)
    return np.argsort(key, kind="stable")
