"""A plane through the bodies: elements beyond it aren't shown, so that one sees what is inside."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpusim.arrays.array_types import Bool, Float
from gpusim.mesh import Faces, Mesh, boundary_faces
from gpusim.surface.skin import Skin
from gpusim.surface.surface import Surface
from gpusim.view.picture.neutral import PAINT

INSIDE = "(inside)"
"""Paint of faces that the plane has laid bare."""


@dataclass(frozen=True)
class Cut:
    """A plane across an axis of the world (0, 1, 2), ``share`` of the way through the bodies at
    rest. Shown are whole elements, whose middle lies before it or, ``beyond``, behind it.

    Examples
    --------
    >>> from gpusim.view.content.cut import Cut
    >>> Cut(0, 0.25).place(np.array([[0, 0, 0], [0.4, 1, 1]]))
    0.1
    """

    axis: int
    share: float = 0.5
    beyond: bool = False

    def place(self, bounds: Float) -> float:
        """Where on the axis, of bodies within ``bounds`` (2, 3)."""
        low, high = bounds[:, self.axis].tolist()
        return float(low + self.share * (high - low))

    def describe(self, bounds: Float) -> str:
        """For people."""
        side = "from" if self.beyond else "up to"
        return f"cut: elements {side} {'xyz'[self.axis]} = {1e3 * self.place(bounds):.4g} mm"

    def kept(self, mesh: Mesh, bounds: Float) -> Bool:
        """(M,) of the elements of a mesh."""
        along = mesh.points[:, self.axis]
        middle = np.concatenate([along[cells].mean(axis=1) for _, _, cells in mesh.blocks()])
        return np.asarray((middle > self.place(bounds)) == self.beyond)


def cut_body(skin: Skin, surface: Surface, kept: Bool) -> tuple[Skin, Surface]:
    """Skin and surface at rest of a body's elements that are ``kept`` (M,); a face if none is.

    Nodes and elements have their numbers as before; faces that were inside are grey.
    """
    if kept.all():
        return skin, surface
    if not kept.any():
        one = Skin(skin.mesh, skin.faces[[0]])
        return one, one.surface({INSIDE: PAINT}, np.zeros(1, np.int32), {}, surface.name)
    blocks = skin.mesh.blocks()
    cells = {kind: cells[kept[first : first + len(cells)]] for kind, first, cells in blocks}
    some = boundary_faces(Mesh.trusted(skin.mesh.points, cells))
    cell = np.flatnonzero(kept)[some.cell].astype(np.int32)
    faces = Faces(some.nodes, cell, some.local, some.points)
    own, whole = (8 * one.cell.astype(np.int64) + one.local for one in (faces, skin.faces))
    _, here, before = np.intersect1d(own, whole, assume_unique=True, return_indices=True)
    painted = np.empty(len(skin.faces), np.int32)
    painted[skin.face_of_piece] = surface.regions
    region = np.full(len(faces), len(surface.paints), np.int32)
    region[here] = painted[before]
    found = Skin(skin.mesh, faces)
    paints = {**surface.paints, INSIDE: PAINT}
    return found, found.surface(paints, region, surface.frames, surface.name)
