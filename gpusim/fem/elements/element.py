"""Solid elements and their faces as pure data: shape functions at the points of integration rules.

Shapes and rules live in ``gpusim.mesh`` (mesh quality needs them too); here they meet the
formulations: which rule a named formulation integrates its stiffness with, and the internal modes
of the incompatible hexahedron. Face loads and areas integrate with faces.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np

from gpusim.arrays.array_types import Float, Int, Long
from gpusim.mesh import Faces
from gpusim.mesh.cell_types import CELL_TYPES
from gpusim.mesh.quadrature import FULL_POINTS, cell_rule, face_rule
from gpusim.mesh.shape_functions import FACE_TYPES, shape_functions, shape_gradients
from gpusim.validation import require_one_of


@dataclass(frozen=True, eq=False)
class Rule:
    """Q quadrature points of an element with k nodes.

    ``points`` (Q,3) reference coordinates, ``weight`` (Q,), ``shape`` (Q,k), ``gradient`` (Q,k,3)
    d(shape)/d(xi).
    """

    points: Float
    weight: Float
    shape: Float
    gradient: Float


@dataclass(frozen=True, eq=False)
class Element:
    """One element type.

    Parameters
    ----------
    name : cell type.
    rules : formulation -> rule of its stiffness; the first one is the default.
    mass : rule that is exact for products of two shape functions on a straight cell.
    centre_gradient : (k,3) shape gradients at the centre of the reference cell.
    """

    name: str
    rules: Mapping[str, Rule]
    mass: Rule
    centre_gradient: Float

    @property
    def formulations(self) -> tuple[str, ...]:
        """The names it takes, default first."""
        return tuple(self.rules)

    def rule(self, formulation: str | None = None) -> Rule:
        """The stiffness rule of a formulation; None: of the default one.

        Raises InputError for a name that the element doesn't have.
        """
        if formulation is None:
            return next(iter(self.rules.values()))
        require_one_of(f"formulation: not available for {self.name}", formulation, self.rules)
        return self.rules[formulation]


def mode_gradient(rule: Rule) -> Float:
    """(Q,3,3) reference gradients of the modes 1 - xi^2, 1 - eta^2, 1 - zeta^2 of a hexahedron."""
    modes = np.zeros((len(rule.weight), 3, 3))
    for axis in range(3):
        modes[:, axis, axis] = -2.0 * rule.points[:, axis]
    return modes


# Formulation -> number of points; the first one is the default.
_RULES: dict[str, dict[str, int]] = {
    **{kind: {"full": count} for kind, count in FULL_POINTS.items()},
    "hex8": {"incompatible": 8, "full": FULL_POINTS["hex8"], "bbar": 8},
    "hex20": {"full": FULL_POINTS["hex20"], "reduced": 8},
    "tet10": {"full": FULL_POINTS["tet10"], "exact": 14, "bbar": 4},
    "wedge6": {"full": FULL_POINTS["wedge6"], "exact": 6},
}
_MASS_POINTS = {
    "hex8": 8, "hex20": 27, "hex27": 27, "tet4": 4, "tet10": 14, "wedge6": 6, "wedge15": 18,
    "pyramid5": 8, "pyramid13": 27,
}  # fmt: skip


def quadrature(kind: str, count: int) -> Rule:
    """The rule of ``count`` points of a cell type."""
    points, weight = cell_rule(kind, count)
    tables = shape_functions(kind, points), shape_gradients(kind, points)
    for table in tables:
        table.setflags(write=False)
    return Rule(points, weight, *tables)


def _element(kind: str) -> Element:
    rules = {count: quadrature(kind, count) for count in _RULES[kind].values()}
    # the centroid of the reference cell: the one point of the smallest rules
    centre, _ = cell_rule(kind, 2 if CELL_TYPES[kind].linear == "wedge6" else 1)
    return Element(
        name=kind,
        rules={name: rules[count] for name, count in _RULES[kind].items()},
        mass=quadrature(kind, _MASS_POINTS[kind]),
        centre_gradient=shape_gradients(kind, centre.mean(axis=0, keepdims=True))[0],
    )


ELEMENTS: dict[str, Element] = {kind: _element(kind) for kind in _RULES}


@dataclass(frozen=True, eq=False)
class FaceElement:
    """One face type with Q quadrature points and n nodes.

    ``columns`` (n,) of `Faces.nodes` hold its nodes. ``shape`` (Q,n), ``gradient`` (Q,n,2)
    d(shape)/d(xi), ``weight`` (Q,). With nodes at x (n,3) the area vector of a point is the cross
    product of the columns of x^T gradient, times the weight; it points outward.
    """

    name: str
    columns: Long
    shape: Float
    gradient: Float
    weight: Float

    def tangents(self, points: Float, nodes: Int) -> Float:
        """(F,Q,3,2) derivatives of position of faces with ``nodes`` (F,n) at ``points`` (N,3)."""
        corners = points[nodes]
        # relative to the first corner: large offsets don't cost digits
        corners = corners - corners[:, :1]
        return np.asarray(np.einsum("fki,qkj->fqij", corners, self.gradient))

    def area_vectors(self, points: Float, nodes: Int) -> Float:
        """(F,Q,3) outward, as large as the area that belongs to each point."""
        tangent = self.tangents(points, nodes)
        return np.cross(tangent[..., 0], tangent[..., 1]) * self.weight[:, None]


_POINTS = {"tri3": 3, "tri6": 6, "quad4": 4, "quad8": 9, "quad9": 9}


@cache
def face_element(name: str, count: int | None = None) -> FaceElement:
    """A face type with ``count`` points, or as many as loads on faces take."""
    points, weight = face_rule(name, count or _POINTS[name])
    shape, gradient = shape_functions(name, points), shape_gradients(name, points)
    columns = np.array(FACE_TYPES[name])
    for table in (columns, shape, gradient):
        table.setflags(write=False)
    return FaceElement(name, columns, shape, gradient, weight)


def face_groups(
    faces: Faces,
) -> Iterator[tuple[FaceElement, Long, Int]]:
    """Yield (face type, rows (K,) of ``faces``, nodes (K,n)) for each type that occurs."""
    for name, rows in faces.kinds():
        element = face_element(name)
        yield element, rows, faces.nodes[np.ix_(rows, element.columns)]
