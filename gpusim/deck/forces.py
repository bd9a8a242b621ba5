"""Nodal forces, pressures and body forces of a deck, kept from step to step."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.deck.amplitudes import Moment, Scale, ScaledLoads
from gpusim.deck.constraints import Axes
from gpusim.deck.materials import Body
from gpusim.errors import InputError
from gpusim.fem import FollowerPressure, body_force, centrifugal
from gpusim.fem.elements.element import FaceElement, face_element
from gpusim.fem.elements.isoparametric_map import add_to
from gpusim.mesh import Faces, set_faces
from gpusim.mesh.formats.abaqus.cards import Card, number, whole
from gpusim.validation import require


def pressure_forces(body: Body, faces: Faces, values: Float) -> Float:
    """(N,3) consistent forces of ``values`` (F,), positive into the body, on undeformed faces."""
    points = body.mesh.points
    forces = np.zeros_like(points)
    for element, rows in face_elements(body, faces):
        nodes = faces.nodes[np.ix_(rows, element.columns)]
        area = element.area_vectors(points, nodes)
        share = np.einsum("qk,fqi->fki", element.shape, area)
        add_to(forces, nodes, share * -values[rows][:, None, None])
    return forces


def following_pressures(body: Body, faces: Faces, values: Float) -> tuple[FollowerPressure, ...]:
    """The same on the deformed body: one load for each value and type of faces."""
    return tuple(
        FollowerPressure(faces[rows[values[rows] == value]], value, count=len(element.weight))
        for element, rows in face_elements(body, faces)
        for value in np.unique(values[rows]).tolist()
    )


def face_elements(body: Body, faces: Faces) -> Iterator[tuple[FaceElement, Long]]:
    """Which ``faces`` (their numbers) are integrated alike, and how."""
    for kind, first, block in body.mesh.blocks():
        inside = np.flatnonzero((faces.cell >= first) & (faces.cell < first + len(block)))
        for name, rows in faces[inside].kinds():
            count = face_points(kind, body.formulation[kind], name)
            yield face_element(name, count), inside[rows]


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
    """``kind`` GRAV, CENTRIF or B; ``vector`` (3,) direction, or (6,) point and axis; its ``size``
    (1,), the ``scale`` of which was given last."""

    kind: str
    cells: Long
    vector: Float
    scale: Scale
    where: str
    size: ScaledLoads = field(default_factory=lambda: ScaledLoads(1))

    def is_more_of(self, other: _BodyLoad) -> bool:
        """Whether it adds to another load, or takes its place."""
        same = self.kind == other.kind and np.array_equal(self.vector, other.vector)
        other_amplitude = self.scale.follows != other.scale.follows
        apart = self.scale.step == other.scale.step and other_amplitude
        return same and np.array_equal(self.cells, other.cells) and not apart


class Forces:
    """What acts now. Given again in the same step adds up, in a later step replaces."""

    def __init__(self, body: Body, axes: Axes) -> None:
        self.body = body
        self.content, self.labelled = body.content, body.labelled
        self.axes = axes
        mesh = body.mesh
        self.nodal = ScaledLoads(mesh.node_count, 3)
        self.pressures = ScaledLoads(mesh.cell_count, 6)
        self.bodies: list[_BodyLoad] = []
        self.loose = {int(node): "" for node in mesh.dangling_nodes}  # and where a force is given

    def clear(self) -> None:
        self.clear_nodal()
        self.clear_distributed()

    def clear_nodal(self) -> None:
        self.nodal.clear()

    def clear_distributed(self) -> None:
        self.pressures.clear()
        for load in self.bodies:
            load.size.clear()
            load.scale = Scale()

    def end(self, moment: Moment) -> None:
        """A step has ended."""
        self.nodal.end(moment)
        self.pressures.end(moment)
        for load in self.bodies:
            load.size.end(moment)
        self.bodies = [one for one in self.bodies if one.size.values.any() or one.size.old.any()]

    def read_nodal(self, card: Card, scale: Scale) -> None:
        """*CLOAD: node or node set, degree of freedom, force (in the node's own axes)."""
        for where, row in card.records(3, 3, "node or set, degree of freedom, force"):
            nodes = self.content.node_rows(row[0], where)
            axis = whole(row[1], where)
            expected = "1, 2 or 3 (solids take no moments)"
            require(1 <= axis <= 3, f"{where}: degree of freedom", axis, expected)
            self.nodal.add((nodes, axis - 1), number(row[2], where), scale, where)
            if self.loose:
                self.loose |= dict.fromkeys(self.loose.keys() & nodes.tolist(), where)

    def read_distributed(self, card: Card, scale: Scale) -> None:
        """*DLOAD: element or element set, label, value, and what the label needs."""
        for where, row in card.records(3, None, "element or set, label, value"):
            cells = self._cells(row[0], where)
            label = row[1].upper()
            value = number(row[2], where)
            if len(label) == 2 and label[0] == "P" and label[1] in "123456":
                side = np.full(len(cells), int(label[1]))
                labels = self.labelled.cell_labels[cells]
                self._press(np.stack([labels, side], axis=1), value, scale, where)
                continue
            if label in ("BX", "BY", "BZ"):
                vector = _UNIT["XYZ".index(label[1])]
                label = "B"
            elif label == "GRAV":
                direction = _vector(row[3:], 3, where, "a direction")
                vector = direction / _length(direction, where)
            elif label == "CENTRIF":
                vector = _vector(row[3:], 6, where, "a point on the axis and its direction")
                _length(vector[3:], where)
                expected = "the square of the angular velocity, >= 0"
                require(value >= 0.0, f"{where}: CENTRIF", f"{value:g}", expected)
            else:
                raise InputError(f"{where}: load {row[1]} isn't supported; expected {_EXPECTED}")
            load = _BodyLoad(label, cells, vector, scale, where)
            known = next((one for one in self.bodies if load.is_more_of(one)), load)
            if known is load:
                self.bodies.append(load)
            known.size.add(0, value, scale, where)
            known.scale = scale

    def read_surface(self, card: Card, scale: Scale) -> None:
        """*DSLOAD: surface, P, pressure."""
        for where, row in card.records():
            if len(row) != 3 or row[1].upper() != "P":
                raise InputError(f"{where}: got {', '.join(row)!r}; expected surface, P, pressure")
            pairs = self.content.surfaces.get(row[0], where)
            self._press(pairs, number(row[2], where), scale, where)

    def refuse_loose(self, fixed: Bool) -> None:
        """Forces on nodes that no element has must be held. Raises InputError."""
        for node, where in self.loose.items():
            if (self.nodal.values[node] * ~fixed[node]).any():
                label = self.content.nodes.shown(int(self.content.node_labels[node]))
                raise InputError(
                    f"{where}: node {label} belongs to no solid element; expected forces on nodes "
                    "of elements"
                )

    def nodal_forces(self, moment: Moment) -> Float:
        """(N,3) in global axes."""
        total = self.nodal.at(moment)
        for node, rows in self.axes.rows.items():
            total[node] = rows.T @ total[node]
        return total

    def pressed(self, moment: Moment) -> tuple[Faces, Float] | None:
        """Faces under pressure, and the pressures (F,)."""
        pressures = self.pressures.at(moment)
        cell, side = np.nonzero(pressures)
        if not cell.size:
            return None
        labelled = np.stack([self.labelled.cell_labels[cell], side + 1], axis=1)
        faces = set_faces(self.body.mesh, self.labelled.face_pairs(labelled))
        return faces, pressures[cell, side]

    def body_forces(self, moment: Moment) -> Iterator[Float]:
        """(N,3) consistent nodal forces of each load on volumes of the body at rest."""
        mesh, formulation = self.body.mesh, self.body.formulation
        rho = np.array([one.density for one in self.body.materials])[self.body.material_of_cell]
        for load in self.bodies:
            (value,) = load.size.at(moment)
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
                point, axis = load.vector[:3], load.vector[3:]
                # the factor of an amplitude may be negative, an angular velocity's square not
                size = float(np.sqrt(abs(value)))
                outward = centrifugal(mesh, share, point, axis, size, formulation=formulation)
                yield np.sign(value) * outward
            else:
                yield body_force(mesh, share, value * load.vector, formulation=formulation)

    def _cells(self, text: str, where: str) -> Long:
        if not text:
            return np.arange(self.labelled.mesh.cell_count)
        return self.labelled.cell_index(self.content.cells_named(text, where))

    def _press(self, labelled: Long, value: float, scale: Scale, where: str) -> None:
        try:
            self.labelled.face_pairs(labelled)
        except InputError as error:
            raise InputError(f"{where}: {error}") from None
        cell, side = self.labelled.cell_index(labelled[:, 0]), labelled[:, 1] - 1
        self.pressures.add((cell, side), value, scale, where)


def _vector(fields: Sequence[str], count: int, where: str, what: str) -> Float:
    if len(fields) != count:
        raise InputError(f"{where}: got {len(fields)} further numbers; expected {count}: {what}")
    return np.array([number(text, where) for text in fields])


def _length(vector: Float, where: str) -> float:
    length = float(np.linalg.norm(vector))
    require(length > 0.0, f"{where}: direction", vector.tolist(), "one that isn't zero")
    return length
