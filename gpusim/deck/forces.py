"""Nodal forces, pressures and body forces of a deck, kept from step to step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.deck.amplitudes import Scale
from gpusim.deck.constraints import Axes
from gpusim.deck.materials import Body
from gpusim.errors import InputError
from gpusim.fem import body_force, centrifugal
from gpusim.fem.elements.isoparametric_map import add_to
from gpusim.mesh import Faces, Mesh, set_faces
from gpusim.mesh.formats.abaqus.cards import Card, number, whole
from gpusim.mesh.quadrature import face_rule
from gpusim.mesh.shape_functions import FACE_TYPES, shape_functions, shape_gradients


def pressure_forces(
    mesh: Mesh, faces: Faces, values: Float, formulation: Mapping[str, str]
) -> Float:
    """(N,3) consistent forces of ``values`` (F,), positive into the body, on undeformed faces."""
    forces = np.zeros((mesh.node_count, 3))
    for kind, first, block in mesh.blocks():
        inside = np.flatnonzero((faces.cell >= first) & (faces.cell < first + len(block)))
        if not inside.size:
            continue
        own = faces[inside]
        for name, rows in own.kinds():
            points, weight = face_rule(name, face_points(kind, formulation[kind], name))
            nodes = own.nodes[np.ix_(rows, np.array(FACE_TYPES[name]))]
            corners = mesh.points[nodes]
            tangent = np.einsum(
                "fki,qkj->fqij", corners - corners[:, :1], shape_gradients(name, points)
            )
            normal = np.cross(tangent[..., 0], tangent[..., 1]) * weight[:, None]
            share = np.einsum("qk,fqi->fki", shape_functions(name, points), normal)
            share *= -values[inside[rows]][:, None, None]
            add_to(forces, nodes, share)
    return forces


def face_points(kind: str, formulation: str, face: str) -> int:
    """Number of integration points on a face of an element.

    The rule counts where faces are curved. Found by running CalculiX 2.20 on curved elements:
    2x2 on C3D20R and C3D15, 3x3 on C3D20, three on the triangles of C3D10 and C3D15.
    """
    if face in ("tri3", "tri6"):
        return 3
    return 4 if face == "quad4" else _QUADRATIC_POINTS[kind, formulation]


_QUADRATIC_POINTS = {
    ("hex20", "full"): 9, ("hex20", "reduced"): 4, ("wedge15", "full"): 4,
    ("hex27", "full"): 9, ("pyramid13", "full"): 9,
}  # fmt: skip
"""On faces with eight or nine nodes; CalculiX hasn't the last two."""


_EXPECTED = "P1 … P6, BX, BY, BZ, GRAV or CENTRIF"
_UNIT = np.eye(3)


@dataclass(eq=False)
class _BodyLoad:
    """``kind`` GRAV, CENTRIF or B; ``value`` its size, ``vectors`` direction or point and axis.

    ``follows`` as in ``Scale``.
    """

    kind: str
    cells: Long
    value: float
    vectors: tuple[tuple[float, ...], ...]
    step: int
    follows: int
    where: str


class Forces:
    """What acts now. Given again in the same step adds up, in a later step replaces."""

    def __init__(self, body: Body, axes: Axes) -> None:
        self.body = body
        self.content, self.labelled = body.content, body.labelled
        self.axes = axes
        mesh = body.mesh
        self.force = np.zeros((mesh.node_count, 3))
        self.force_step = np.zeros((mesh.node_count, 3), dtype=np.int32)
        self.force_follows = np.zeros((mesh.node_count, 3), dtype=np.int32)
        self.face_value = np.zeros((mesh.cell_count, 6))
        self.face_step = np.zeros((mesh.cell_count, 6), dtype=np.int32)
        self.face_follows = np.zeros((mesh.cell_count, 6), dtype=np.int32)
        self.bodies: list[_BodyLoad] = []
        self.loose = {int(node): "" for node in mesh.dangling_nodes}  # and where a force is given

    def clear_nodal(self) -> None:
        self.force[:] = 0.0

    def clear_distributed(self) -> None:
        self.face_value[:] = 0.0
        self.bodies.clear()

    def nodal(self, card: Card, scale: Scale, step: int) -> None:
        """*CLOAD: node or node set, degree of freedom, force (in the node's own axes)."""
        for where, row in card.records(3, 3, "node or set, degree of freedom, force"):
            nodes = self.content.node_rows(row[0], where)
            axis = whole(row[1], where)
            if not 1 <= axis <= 3:
                raise InputError(
                    f"{where}: degree of freedom; got {axis}; expected 1, 2 or 3 (solids take "
                    "no moments)"
                )
            value = scale.factor * number(row[2], where)
            again = self.force_step[nodes, axis - 1] == step
            _refuse_mixed(again & (self.force_follows[nodes, axis - 1] != scale.follows), where)
            kept = np.where(again, self.force[nodes, axis - 1], 0.0)
            self.force[nodes, axis - 1] = kept + value
            self.force_step[nodes, axis - 1] = step
            if self.loose:
                self.loose |= dict.fromkeys(self.loose.keys() & nodes.tolist(), where)
            self.force_follows[nodes, axis - 1] = scale.follows

    def distributed(self, card: Card, scale: Scale, step: int) -> None:
        """*DLOAD: element or element set, label, value, and what the label needs."""
        for where, row in card.records(3, None, "element or set, label, value"):
            cells = self._cells(row[0], where)
            label = row[1].upper()
            value = scale.factor * number(row[2], where)
            if len(label) == 2 and label[0] == "P" and label[1] in "123456":
                side = np.full(len(cells), int(label[1]))
                labels = self.labelled.cell_labels[cells]
                faces = np.stack([labels, side], axis=1)
                self._press(faces, value, scale, step, where)
            elif label in ("BX", "BY", "BZ"):
                direction = _UNIT["XYZ".index(label[1])]
                self._add("B", cells, value, (tuple(direction.tolist()),), scale, step, where)
            elif label == "GRAV":
                direction = _vector(row[3:], 3, where, "a direction")
                unit = direction / _length(direction, where)
                self._add("GRAV", cells, value, (tuple(unit.tolist()),), scale, step, where)
            elif label == "CENTRIF":
                both = _vector(row[3:], 6, where, "a point on the axis and its direction")
                _length(both[3:], where)
                if value < 0.0:
                    raise InputError(
                        f"{where}: CENTRIF; got {value:g}; expected the square of the angular "
                        "velocity, >= 0"
                    )
                vectors = (tuple(both[:3].tolist()), tuple(both[3:].tolist()))
                self._add("CENTRIF", cells, value, vectors, scale, step, where)
            else:
                raise InputError(f"{where}: load {row[1]} isn't supported; expected {_EXPECTED}")

    def surface(self, card: Card, scale: Scale, step: int) -> None:
        """*DSLOAD: surface, P, pressure."""
        for where, row in card.records():
            if len(row) != 3 or row[1].upper() != "P":
                raise InputError(f"{where}: got {', '.join(row)!r}; expected surface, P, pressure")
            pairs = self.content.surfaces.get(row[0], where)
            self._press(pairs, scale.factor * number(row[2], where), scale, step, where)

    def refuse_loose(self, fixed: Bool) -> None:
        """Forces on nodes that no element has must be held. Raises InputError."""
        for node, where in self.loose.items():
            if (self.force[node] * ~fixed[node]).any():
                label = self.content.nodes.shown(int(self.content.node_labels[node]))
                raise InputError(
                    f"{where}: node {label} belongs to no solid element; expected forces on nodes "
                    "of elements"
                )

    def total(self, factors: Float) -> Float:
        """(N,3) consistent nodal forces of everything that acts now, in global axes.

        ``factors`` : value of each amplitude that loads follow; the first is 1.
        """
        mesh, formulation = self.body.mesh, self.body.formulation
        total = self.force * factors[self.force_follows]
        for node, rows in self.axes.rows.items():
            total[node] = rows.T @ total[node]
        pressures = self.face_value * factors[self.face_follows]
        cell, side = np.nonzero(pressures)
        if cell.size:
            labelled = np.stack([self.labelled.cell_labels[cell], side + 1], axis=1)
            faces = set_faces(mesh, self.labelled.face_pairs(labelled))
            total += pressure_forces(mesh, faces, pressures[cell, side], formulation)
        rho = np.array([one.density for one in self.body.materials])[self.body.material_of_cell]
        for load in self.bodies:
            value = load.value * float(factors[load.follows])
            share = np.zeros(mesh.cell_count)
            share[load.cells] = 1.0 if load.kind == "B" else rho[load.cells]
            light = load.cells[share[load.cells] == 0.0]
            if light.size:
                raise InputError(
                    f"{load.where}: {load.kind} on elements without *DENSITY; got element "
                    f"{self.content.cells.shown(self.labelled.cell_labels[light[0]])}; expected a "
                    "density in its material"
                )
            if load.kind == "CENTRIF":
                point, axis = load.vectors
                # the factor of an amplitude may be negative, an angular velocity's square not
                size = float(np.sqrt(abs(value)))
                outward = centrifugal(mesh, share, point, axis, size, formulation=formulation)
                total += np.sign(value) * outward
            else:
                acceleration = value * np.array(load.vectors[0])
                total += body_force(mesh, share, acceleration, formulation=formulation)
        return total

    def _cells(self, text: str, where: str) -> Long:
        if not text:
            return np.arange(self.labelled.mesh.cell_count)
        return self.labelled.cell_index(self.content.cells_named(text, where))

    def _press(self, labelled: Long, value: float, scale: Scale, step: int, where: str) -> None:
        try:
            self.labelled.face_pairs(labelled)
        except InputError as error:
            raise InputError(f"{where}: {error}") from None
        cell, side = self.labelled.cell_index(labelled[:, 0]), labelled[:, 1] - 1
        again = self.face_step[cell, side] == step
        _refuse_mixed(again & (self.face_follows[cell, side] != scale.follows), where)
        kept = np.where(again, self.face_value[cell, side], 0.0)
        self.face_value[cell, side] = kept + value
        self.face_step[cell, side] = step
        self.face_follows[cell, side] = scale.follows

    def _add(
        self,
        kind: str,
        cells: Long,
        value: float,
        vectors: tuple[tuple[float, ...], ...],
        scale: Scale,
        step: int,
        where: str,
    ) -> None:
        for load in self.bodies:
            same = load.kind == kind and load.vectors == vectors
            if same and np.array_equal(load.cells, cells):
                if load.step == step and load.follows == scale.follows:
                    load.value += value
                    return
                if load.step != step:
                    load.value, load.step, load.follows = value, step, scale.follows
                    return
        self.bodies.append(_BodyLoad(kind, cells, value, vectors, step, scale.follows, where))


def _refuse_mixed(mixed: Bool, where: str) -> None:
    if mixed.any():
        raise InputError(
            f"{where}: two amplitudes for one degree of freedom or face in one step; expected one"
        )


def _vector(fields: Sequence[str], count: int, where: str, what: str) -> Float:
    if len(fields) != count:
        raise InputError(f"{where}: got {len(fields)} further numbers; expected {count}: {what}")
    return np.array([number(text, where) for text in fields])


def _length(vector: Float, where: str) -> float:
    length = float(np.linalg.norm(vector))
    if not length > 0.0:
        raise InputError(f"{where}: direction; got {vector.tolist()}; expected one that isn't zero")
    return length
