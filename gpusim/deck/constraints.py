"""Supports of a step, in the axes of each node, and linear equations between nodes.

Ties join surfaces whose meshes don't match: each node of one follows a point of the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from gpusim.arrays.array_types import Bool, Float
from gpusim.deck.amplitudes import Moment, Ramped, Scale
from gpusim.errors import InputError
from gpusim.fem.model.constraints import NEAR, Equations, follow
from gpusim.mesh import set_faces
from gpusim.mesh.file_content.coordinate_systems import Frame
from gpusim.mesh.formats.abaqus.cards import Card, number, whole
from gpusim.mesh.formats.abaqus.content import InpContent
from gpusim.mesh.formats.abaqus.reader import LabelledMesh
from gpusim.mesh.nearest_places import nearest_on_surface
from gpusim.validation import require

# columns (3 node + axis), factors and right side of one equation
Row = tuple[Sequence[int], Sequence[float], float]


def read_tie(card: Card, content: InpContent, labelled: LabelledMesh) -> Equations:
    """*TIE: dependent surface (of faces or nodes), independent surface (of faces).

    Each dependent node follows the nearest point of the independent surface (see
    ``gpusim.fem.tie``). A node may lie up to POSITION TOLERANCE away (default 0.025 of the face's
    size, as in CalculiX) with ADJUST=NO; otherwise the surfaces must touch, for nodes aren't moved.
    Raises InputError.
    """
    where = card.where()
    rows = [row for _, row in card.rows()]
    if len(rows) != 1 or len(rows[0]) != 2:
        raise InputError(f"{where}: got {len(rows)} lines; expected one with two surfaces")
    adjust = card.parameters.get("ADJUST", "YES").upper()
    mesh = labelled.mesh
    pairs = labelled.face_pairs(content.surfaces.get(rows[0][1], where))
    faces = set_faces(mesh, pairs)
    if rows[0][0] in content.surfaces:
        own = content.surfaces.get(rows[0][0], where)
        nodes = set_faces(mesh, labelled.face_pairs(own)).node_numbers().astype(np.int64)
    else:
        members = content.node_sets.get(rows[0][0], where)
        nodes = np.searchsorted(content.node_labels, members)
    nodes = np.setdiff1d(nodes, faces.node_numbers())
    given = card.parameters.get("POSITIONTOLERANCE", "")
    face, distance, shares = nearest_on_surface(faces, mesh.points[nodes])
    size = np.sqrt(faces.areas)[face]
    reach = np.full(len(nodes), number(given, where)) if given else NEAR * size
    closed = np.minimum(reach, 1e-6 * size) if adjust == "YES" else reach
    far = np.flatnonzero(~(distance <= closed))
    if far.size:
        label = content.nodes.shown(labelled.node_labels[nodes[far[0]]])
        gap = f"{distance[far[0]]:.3g}"
        what = f"would have to be moved by {gap}; expected surfaces that touch, or ADJUST=NO"
        if not distance[far[0]] <= reach[far[0]]:
            where_from = f"the surface {rows[0][1]}; got a distance of {gap}"
            what = f"lies off {where_from}; expected every node of {rows[0][0]} on it"
        raise InputError(f"{where}: node {label} {what}")
    return follow(faces, nodes, face, shares)


# Abaqus' names for groups of degrees of freedom; rotations don't exist in solids.
_GROUPS = {
    "ENCASTRE": (0, 1, 2), "PINNED": (0, 1, 2),
    "XSYMM": (0,), "YSYMM": (1,), "ZSYMM": (2,),
    "XASYMM": (1, 2), "YASYMM": (0, 2), "ZASYMM": (0, 1),
}  # fmt: skip


@dataclass(eq=False)
class Axes:
    """Local axes of nodes from *TRANSFORM: ``rows[node]`` is (3,3), a unit vector in each row."""

    content: InpContent
    rows: dict[int, Float] = field(default_factory=dict)

    def read(self, card: Card) -> None:
        """TYPE=R: x' through a, b in the x'y' plane; TYPE=C: cylindrical about the line a-b."""
        kind = card.parameters.get("TYPE", "R").upper()
        name = card.parameters.get("NSET", "")
        labels = self.content.node_sets.get(name, card.where())
        nodes = np.searchsorted(self.content.node_labels, labels)
        values = [number(text, card.where(line)) for line, row in card.rows() for text in row]
        if kind not in ("R", "C") or len(values) != 6:
            card.fail(
                f"got TYPE={kind} and {len(values)} numbers; expected TYPE=R or C "
                "and the points a and b"
            )
        a, b = np.array(values[:3]), np.array(values[3:])
        for node in nodes.tolist():
            label = self.content.nodes.shown(int(self.content.node_labels[node]))
            where = f"{card.where()}: no direction at node {label}"
            frame = (
                Frame.from_x(np.zeros(3), a, b, where)
                if kind == "R"
                else Frame.from_z(a, b, self.content.points[node], where)
            )
            self.rows[node] = frame.axes


class Constraints:
    """Supports and equations; ``assembled`` gives what acts at a moment of a step."""

    def __init__(self, content: InpContent, axes: Axes) -> None:
        self.content = content
        self.axes = axes
        count = len(content.node_labels)
        self.fixed = np.zeros((count, 3), dtype=bool)
        self.given = Ramped(np.zeros((count, 3)))
        self.equations: list[list[tuple[int, int, float]]] = []
        self.ties: list[Equations] = []
        self._rows: list[Row] = []
        self._own: tuple[Equations, ...] = ()

    def clear(self) -> None:
        self.fixed[:] = False
        self.given.clear()

    def boundary(self, card: Card, scale: Scale) -> None:
        """*BOUNDARY: node or set, first and last degree of freedom, value."""
        for where, row in card.records(2, None, "node or set, degree of freedom, …"):
            nodes = self.content.node_rows(row[0], where)
            value = number(row[3], where) if len(row) > 3 and row[3] else 0.0
            group = _GROUPS.get(row[1].upper())
            if group is None:
                first = whole(row[1], where)
                last = whole(row[2], where) if len(row) > 2 and row[2] else first
                group = self._directions(first, last, value, where)
            fits = value == 0.0 or bool(scale.step)
            expected = "zero there, other values inside of a step"
            require(fits, f"{where}: displacement before the first step", f"{value:g}", expected)
            for axis in group:
                self.fixed[nodes, axis] = True
                self.given.put((nodes, axis), value, scale)

    def equation(self, card: Card) -> None:
        """*EQUATION: the number of terms, then node, degree of freedom, coefficient of each."""
        rows = card.rows()
        for line, row in rows:
            where = card.where(line)
            count = whole(row[0], where) if len(row) == 1 else 0
            if count < 1:
                raise InputError(f"{where}: got {', '.join(row)!r}; expected the number of terms")
            fields: list[str] = []
            while len(fields) < 3 * count:
                more = next(rows, None)
                if more is None:
                    raise InputError(
                        f"{where}: got {len(fields) // 3} terms; expected {count} (cut off?)"
                    )
                fields += more[1]
            terms = []
            for k in range(0, 3 * count, 3):
                axis = whole(fields[k + 1], where)
                require(1 <= axis <= 3, f"{where}: degree of freedom", axis, "1, 2 or 3")
                node = self.content.node_rows(str(whole(fields[k], where)), where)[0]
                terms.append((int(node), axis - 1, number(fields[k + 2], where)))
            self.equations.append(terms)

    def assembled(self, moment: Moment) -> tuple[Bool, Float, tuple[Equations, ...]]:
        """``fixed`` and ``prescribed`` in global axes, and equations for what these can't say."""
        given = self.given.at(moment)
        fixed, value = self.fixed.copy(), given.copy()
        rows: list[Row] = []
        for node, axes in self.axes.rows.items():
            held = np.flatnonzero(self.fixed[node])
            fixed[node], value[node] = False, 0.0
            if len(held) == 3:
                fixed[node], value[node] = True, axes.T @ given[node]
                continue
            for axis in held.tolist():
                direction = axes[axis]
                along = int(np.argmax(np.abs(direction)))
                others = np.abs(np.delete(direction, along)).max()
                if others <= 1e-14:
                    fixed[node, along] = True
                    value[node, along] = given[node, axis] * np.sign(direction[along])
                else:
                    columns = [3 * node + k for k in range(3)]
                    rows.append((columns, direction.tolist(), float(given[node, axis])))
        for terms in self.equations:
            columns, weights = [], []
            for other, axis, factor in terms:
                direction = self.axes.rows[other][axis] if other in self.axes.rows else _UNIT[axis]
                columns += [3 * other + k for k in range(3) if direction[k] != 0.0]
                weights += [factor * float(d) for d in direction if d != 0.0]
            rows.append((columns, weights, 0.0))
        if rows != self._rows:
            # steps that say the same share them
            self._rows, self._own = rows, (Equations.build(rows, fixed.size),) if rows else ()
        return fixed, value, (*self.ties, *self._own)

    def _directions(self, first: int, last: int, value: float, where: str) -> tuple[int, ...]:
        fits = 1 <= first <= last <= 6 and (last <= 3 or value == 0.0)
        expected = "1 … 3 (4 … 6, rotations, only as zero: solids have none)"
        require(fits, f"{where}: degree of freedom", f"{first} … {last}", expected)
        return tuple(range(first - 1, min(last, 3)))


_UNIT = np.eye(3)
