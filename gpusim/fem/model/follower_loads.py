"""Loads that go with the deformed body: their forces, and what displacements change of them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from numbers import Integral

import numpy as np

from gpusim.arrays.array_types import Float, Int, Long
from gpusim.fem.elements.element import FaceElement, face_element, face_groups
from gpusim.fem.elements.isoparametric_map import cross_matrices
from gpusim.fem.materials.constants import constant
from gpusim.field_summary import field_summary
from gpusim.mesh import Faces
from gpusim.validation import require


@dataclass(frozen=True, eq=False)
class FollowerPressure:
    """Pressure ``value`` (positive pushes into the body) that stays normal to the deformed
    ``faces``, in load case ``case`` of a model; for ``Model(..., loads=[...])``.

    Where the pressed faces are closed or end at supports it has a potential, and its stiffness is
    symmetric (Schweizerhof & Ramm, Comput. Struct. 18 (1984) 1099). In linear statics it is the
    `gpusim.fem.pressure` of the undeformed faces.
    ``count``: integration points of a face, for comparison with other programs; None: as there.

    Examples
    --------
    >>> bar = gs.mesh.box(size=(2, 1, 1), divisions=(2, 1, 1))
    >>> load = gs.fem.FollowerPressure(gs.mesh.select_faces(bar, normal="+z"), 3.0)
    >>> load.forces(bar.points).sum(axis=0).round(6) + 0.0
    array([ 0.,  0., -6.])
    """

    faces: Faces
    value: float
    case: int = 0
    count: int | None = None
    __repr__ = field_summary

    def __post_init__(self) -> None:
        require(isinstance(self.faces, Faces), "FollowerPressure: faces", repr(self.faces), "Faces")
        require(len(self.faces) > 0, "FollowerPressure: faces", "none", "at least one")
        object.__setattr__(self, "value", constant(self.value, "FollowerPressure: value"))
        whole = isinstance(self.case, Integral) and not isinstance(self.case, bool)
        require(whole, "FollowerPressure: case", repr(self.case), "the number of a load case")

    def renumbered(self, place: Int, points: Float) -> FollowerPressure:
        """On a mesh in which node i is number ``place[i]``, with nodes at ``points`` (N,3)."""
        faces = self.faces
        # a face without midside nodes has -1 there
        nodes = np.append(place, place.dtype.type(-1))[faces.nodes]
        return replace(self, faces=Faces(nodes, faces.cell, faces.local, points))

    @property
    def parts(self) -> list[PressedFaces]:
        """The faces type by type."""
        return [
            PressedFaces(face_element(one.name, self.count), nodes, self.value)
            for one, _, nodes in face_groups(self.faces)
        ]

    def forces(self, points: Float) -> Float:
        """(N,3) nodal forces at factor 1 where the nodes are at ``points`` (N,3)."""
        total = np.zeros_like(points)
        for part in self.parts:
            np.add.at(total, part.cells, part.forces(points))
        return total


@dataclass(frozen=True, eq=False)
class PressedFaces:
    """Pressed faces of one type with nodes ``cells`` (K,n)."""

    element: FaceElement
    cells: Int
    value: float

    @property
    def name(self) -> str:
        """The type."""
        return self.element.name

    def forces(self, points: Float) -> Float:
        """(K,n,3): minus the pressure times the integral of shape function x area vector."""
        area = self.element.area_vectors(points, self.cells)
        return np.asarray(-self.value * np.matmul(self.element.shape.T, area))

    def stiffness(self, which: Long, points: Float) -> Float:
        """(m,3n,3n): minus the derivative of the forces of some faces.

        With tangents x_1, x_2 a node's motion v changes the area vector by N_1 v x x_2 + N_2 x_1 x
        v.
        """
        element = self.element
        tangent = element.tangents(points, self.cells[which])
        # (m,q,n,3,3): the change of the area vector by each node's motion
        change = (
            element.gradient[None, :, :, 1, None, None]
            * cross_matrices(tangent[..., 0])[:, :, None]
        )
        change -= (
            element.gradient[None, :, :, 0, None, None]
            * cross_matrices(tangent[..., 1])[:, :, None]
        )
        share = element.shape * element.weight[:, None]
        matrix = self.value * np.einsum("qa,mqbij->maibj", share, change, optimize=True)
        width = 3 * self.cells.shape[1]
        return np.asarray(matrix.reshape(len(which), width, width))
