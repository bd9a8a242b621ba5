"""The faces that may cast shadows, and how each lamp sees them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.optics.emitters import Lamp
from gpusim.surface.surface import Surface, face_normals

__all__ = ["Casters", "LampFaces"]

Array = npt.NDArray[np.float64]
MOST_WALLS = 32
"""Faces of open surfaces that are looked at one by one."""

FLAT = 1e-9
"""Distance from a face's plane, per distance and face size, that counts as on it."""


@dataclass(frozen=True, eq=False)
class LampFaces:
    """``face`` (n,): the faces that may hide a lamp from something.

    ``rim`` (n,): those at whose edges visibility may change; across all other edges a shadow goes
    on without a gap. ``side`` (n,): 1 if the whole lamp is before the face's plane, -1 behind it,
    0 if the plane meets the lamp.
    """

    face: npt.NDArray[np.int64]
    rim: npt.NDArray[np.bool_]
    side: npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Casters:
    """Faces of all surfaces: ``corners`` (F, 4, 3) world, a triangle's last corner twice.

    ``normal`` (F, 3) outward, as long as the area; ``both_sides`` (F,): of surfaces that aren't
    closed; ``beside`` (F, 4): the face across each edge, -1 for none or several.
    """

    corners: Array
    normal: Array
    both_sides: npt.NDArray[np.bool_]
    beside: npt.NDArray[np.int64]

    @staticmethod
    def of(surfaces: Sequence[Surface]) -> Casters:
        """Collect the faces of ``surfaces``."""
        corners, normals, both, beside = [], [], [], []
        first = 0
        for surface in surfaces:
            faces = surface.faces.astype(np.int64)
            faces = np.where(faces >= 0, faces, np.roll(faces, 1, axis=1))
            neighbours, closed = _neighbours(faces)
            corners.append(surface.points[faces])
            normals.append(face_normals(surface.points, surface.faces))
            both.append(np.full(len(faces), not closed))
            beside.append(np.where(neighbours >= 0, neighbours + first, neighbours))
            first += len(faces)
        if not corners:
            empty = np.zeros((0, 4), np.int64)
            return Casters(np.zeros((0, 4, 3)), np.zeros((0, 3)), np.zeros(0, bool), empty)
        return Casters(
            np.concatenate(corners), np.concatenate(normals), np.concatenate(both),
            np.concatenate(beside),
        )  # fmt: skip

    def seen_by(self, lamp: Lamp, receivers: Array) -> LampFaces:
        """The faces that may hide ``lamp`` from some of ``receivers`` (R, 3), world.

        Of closed bodies those that turn their outside to no part of the lamp, or only to some:
        a shadow begins where a ray enters a body from behind, as seen from the lamp.
        """
        corner = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
        places = lamp.centre + corner[:, :1] * lamp.u + corner[:, 1:] * lamp.v
        if not lamp.extended:
            places = places[:1]
        near = 0.0 if lamp.far else 1.0
        to = places[None] - near * self.corners[:, :1]
        height = np.einsum("fka,fa->fk", to, self.normal)
        scale = np.linalg.norm(to, axis=2).max(axis=1) * np.linalg.norm(self.normal, axis=1)
        lit = (height >= -FLAT * scale[:, None]).all(axis=1)
        dark = (height <= FLAT * scale[:, None]).all(axis=1)
        side = np.where(dark, -1, np.where(lit, 1, 0))
        caster = self.both_sides | (side < 1)
        # a wall that has all receivers and the lamp before it hides nothing
        for face in np.flatnonzero(self.both_sides & lit)[:MOST_WALLS]:
            ahead = (receivers - self.corners[face, 0]) @ self.normal[face]
            reach = float(np.abs(receivers - self.corners[face, 0]).max(initial=0.0))
            size = float(np.linalg.norm(self.normal[face]))
            caster[face] = bool((ahead < -1e-7 * reach * size).any())
        # a face goes on into its neighbour where both turn the same side to the lamp
        known = self.beside >= 0
        same = side[np.where(known, self.beside, 0)] == side[:, None]
        own_edge = self.beside == -2  # an edge of a triangle's double corner
        smooth = ((known & same) | own_edge).all(axis=1) & (side != 0)
        face = np.flatnonzero(caster)
        return LampFaces(face, ~smooth[face], side[face])


def _neighbours(faces: npt.NDArray[np.int64]) -> tuple[npt.NDArray[np.int64], bool]:
    """Across each edge of (F, 4) faces: -1 none or several, -2 no edge. Whether all have one."""
    count = len(faces)
    a, b = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    owner = np.repeat(np.arange(count), 4)
    result = np.full(4 * count, -1, np.int64)
    result[a == b] = -2
    real = np.flatnonzero(a != b)
    low, high = np.minimum(a, b)[real], np.maximum(a, b)[real]
    key = low * (int(faces.max(initial=0)) + 1) + high
    order = np.argsort(key, kind="stable")
    key, slot = key[order], real[order]
    first = np.flatnonzero(np.r_[True, key[1:] != key[:-1]]) if len(key) else np.zeros(0, int)
    uses = np.diff(np.r_[first, len(key)])
    pair = first[uses == 2]
    result[slot[pair]] = owner[slot[pair + 1]]
    result[slot[pair + 1]] = owner[slot[pair]]
    return result.reshape(-1, 4), bool((uses == 2).all())
