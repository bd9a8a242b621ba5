"""Stress and motion that are there before the first step, and what a temperature does."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from gpusim.arrays.array_types import Float, Int, Long
from gpusim.deck.materials import FROM_ABAQUS, Body
from gpusim.errors import InputError
from gpusim.fem.elements.element import ELEMENTS
from gpusim.fem.elements.isoparametric_map import add_to
from gpusim.fem.elements.strain import internal_force, point_stress
from gpusim.mesh.formats.abaqus.cards import Card, number, whole
from gpusim.mesh.quadrature import cell_rule
from gpusim.mesh.shape_functions import shape_functions
from gpusim.validation import require

if TYPE_CHECKING:
    from gpusim.deck.deck import Deck


class InitialStress:
    """*INITIAL CONDITIONS, TYPE=STRESS at integration points.

    ``values`` maps a cell type to (M,Q,6) float64, order xx yy zz xy yz zx; empty: none is given.
    """

    def __init__(self, body: Body) -> None:
        self.body = body
        self.values: dict[str, Float] = {}

    def read(self, card: Card) -> None:
        """Element or element set, integration point (left out: all), and six stresses.

        CalculiX names points one by one; Abaqus leaves them out. Bricks only: other elements'
        points are counted differently by different programs. Raises InputError.
        """
        expected = "element, integration point (or none: all), six stresses"
        for where, row in card.records(7, 8, expected, counted=True):
            cells = self.body.labelled.cell_index(self.body.content.cells_named(row[0], where))
            stress = np.array([number(text, where) for text in row[-6:]])[FROM_ABAQUS]
            point = whole(row[1], where) if len(row) == 8 else None
            self._set(cells, point, stress, where)

    def _set(self, cells: Long, point: int | None, stress: Float, where: str) -> None:
        for kind, first, block in self.body.mesh.blocks():
            mine = cells[(cells >= first) & (cells < first + len(block))] - first
            if not mine.size:
                continue
            count = len(ELEMENTS[kind].rule(self.body.formulation[kind]).weight)
            if not kind.startswith("hex"):
                raise InputError(f"{where}: initial stress of {kind}; expected C3D8 or C3D20 types")
            if point is not None and not 1 <= point <= count:
                raise InputError(f"{where}: integration point; got {point}; expected 1 … {count}")
            values = self.values.setdefault(kind, np.zeros((len(block), count, 6)))
            values[mine, slice(None) if point is None else point - 1] = stress

    def forces(self) -> Float:
        """(N,3) nodal forces that the stress exerts where nothing holds it."""
        mesh = self.body.mesh
        forces = np.zeros((mesh.node_count, 3))
        for kind, _, block in mesh.blocks():
            if kind in self.values:
                held = internal_force(
                    kind, self.body.formulation[kind], mesh.points[block], self.values[kind]
                )
                add_to(forces, block, -held)
        return forces


class InitialMotion:
    """*INITIAL CONDITIONS, TYPE=DISPLACEMENT and VELOCITY: ``u`` and ``v`` (N,3) in global axes."""

    def __init__(self, body: Body) -> None:
        self.body = body
        self.u, self.v = np.zeros((2, body.mesh.node_count, 3))
        self.where = ""

    def read(self, card: Card, turned: Iterable[int]) -> None:
        """Node or node set, degree of freedom, value; nodes that are ``turned`` are refused, as
        programs differ about their axes. Raises InputError."""
        values = self.v if card.parameters["TYPE"].upper() == "VELOCITY" else self.u
        for where, row in card.records(3, 3, "node or set, degree of freedom, value"):
            nodes, axis = self.body.content.node_rows(row[0], where), whole(row[1], where)
            require(1 <= axis <= 3, f"{where}: degree of freedom", axis, "1, 2 or 3")
            own = not np.isin(nodes, [*turned]).any()
            require(
                own, f"{where}: nodes", "some with *TRANSFORM", "nodes without axes of their own"
            )
            values[nodes, axis - 1] = number(row[2], where)
            self.where = where


_CHUNK = 8192


def temperature_forces(body: Body | Deck, change: Float) -> Float:
    """(N,3) nodal forces of the change of temperature ``change`` (N,) at the nodes."""
    forces = np.zeros((body.mesh.node_count, 3))
    for kind, cells, held in _stresses(body, np.zeros_like(forces), change):
        # cells whose nodes are held push against them with minus the wanted forces
        own = internal_force(kind, body.formulation[kind], body.mesh.points[cells], held)
        add_to(forces, cells, -own)
    return forces


def point_stresses(body: Body | Deck, u: Float, change: Float | None) -> dict[str, Float]:
    """Cell type -> (M,Q,6) stress of ``u`` (N,3) at the points of its rule, xx yy zz xy yz zx."""
    found: dict[str, list[Float]] = {}
    for kind, _, stress in _stresses(body, u, change):
        found.setdefault(kind, []).append(stress)
    return {kind: np.concatenate(parts) for kind, parts in found.items()}


def _stresses(
    body: Body | Deck, u: Float, change: Float | None
) -> Iterator[tuple[str, Int, Float]]:
    """Cell type, some cells (C,k) of it, and their stress (C,Q,6), chunk by chunk."""
    moduli = np.stack([one.stiffness() for one in body.materials])
    expansion = np.stack([one.expansion_strain() for one in body.materials])
    for kind, first, block in body.mesh.blocks():
        name = body.formulation[kind]
        weights = point_weights(kind, name)
        for start in range(0, len(block), _CHUNK):
            cells = block[start : start + _CHUNK]
            own = body.material_of_cell[first + start : first + start + len(cells)]
            free = None
            if change is not None:
                free = (change[cells] @ weights.T)[..., None] * expansion[own][:, None]
            stress, _ = point_stress(
                kind, name, body.mesh.points[cells], u[cells], moduli[own], free
            )
            yield kind, cells, stress


@cache
def point_weights(kind: str, formulation: str) -> Float:
    """(Q,k) temperature at the points of the stiffness rule from that at the nodes.

    Found by running CalculiX 2.20 on random temperatures: C3D8 and C3D8I take the mean of their
    nodes; C3D20 is trilinear through the values at 2x2x2 points, so that the free strain is of
    the order of the element's own; all others interpolate with their shape functions.
    """
    points = ELEMENTS[kind].rule(formulation).points
    if kind == "hex8":
        return np.full((len(points), 8), 1.0 / 8.0)
    if (kind, formulation) == ("hex20", "full"):
        inner, _ = cell_rule("hex20", 8)
        corners = np.linalg.solve(shape_functions("hex8", inner), shape_functions("hex20", inner))
        return np.asarray(shape_functions("hex8", points) @ corners)
    return shape_functions(kind, points)
