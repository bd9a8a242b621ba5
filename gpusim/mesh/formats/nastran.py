"""Nastran's bulk data (.bdf, .nas, .fem, .dat): nodes and solid and shell elements."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from gpusim.arrays.array_types import Float, Long
from gpusim.errors import InputError
from gpusim.files.input_file import read_input
from gpusim.mesh.cell_types import CELL_TYPES
from gpusim.mesh.file_content.cell_blocks import (
    RawBlock,
    RawMesh,
    assemble,
    in_numbers_of_file,
    index_of,
)
from gpusim.mesh.file_content.coordinate_systems import Frame, from_cylindrical, from_spherical
from gpusim.mesh.file_content.numbering import from_upright_first
from gpusim.mesh.formats.abaqus.cards import Source
from gpusim.mesh.formats.nastran_cards import (
    NASTRAN_ELEMENTS,
    SYSTEMS,
    BdfCard,
    check_card,
    integer,
    integers,
    read_bdf_cards,
    real,
    reals,
)
from gpusim.mesh.mesh import Mesh

_LONGEST_CHAIN = 100


@dataclass(frozen=True, eq=False)
class _System:
    """``kind`` R, C or S; three points in the system ``reference``, or at three grid points."""

    card: BdfCard
    kind: str
    reference: int
    points: Float | None
    grids: tuple[int, ...] = ()


class Systems:
    """CORD1R, CORD1C, CORD1S, CORD2R, CORD2C and CORD2S; 0 is the basic system.

    ``grids`` maps a grid point to its system and its coordinates there.
    """

    def __init__(self) -> None:
        self.known: dict[int, _System] = {}
        self.grids: Mapping[int, tuple[int, Float]] = {}
        self._frames: dict[int, Frame] = {}

    def read(self, card: BdfCard) -> None:
        """One card; CORD1 may define two systems. Raises InputError."""
        kind = card.name[5]
        if card.name[4] == "1":
            for start in (0, 4):
                if card.field(start):
                    numbers = [integer(card.field(start + k), card) for k in range(4)]
                    one = _System(card, kind, 0, None, tuple(numbers[1:]))
                    self._add(numbers[0], one)
            return
        points = np.array([real(card.field(k), card) for k in range(2, 11)]).reshape(3, 3)
        reference = integer(card.field(1) or "0", card)
        self._add(integer(card.field(0), card), _System(card, kind, reference, points))

    def _add(self, number: int, system: _System) -> None:
        if number in self.known or number == 0:
            system.card.fail(f"a second coordinate system {number}; expected numbers of their own")
        self.known[number] = system

    def place(
        self, number: int, points: Float, card: BdfCard, chain: tuple[int, ...] = ()
    ) -> Float:
        """Basic coordinates (N,3) of points (N,3) in a system, for ``card``. Raises InputError."""
        if number == 0:
            return points
        if number not in self.known:
            card.fail(f"in coordinate system {number}; expected 0 or one that a CORD card defines")
        if number in chain or len(chain) > _LONGEST_CHAIN:
            card.fail(
                f"coordinate system {number} is defined by itself; expected a chain that ends"
            )
        system = self.known[number]
        if system.kind == "C":
            points = from_cylindrical(points)
        elif system.kind == "S":
            points = from_spherical(points)
        if number not in self._frames:
            self._frames[number] = self._frame(system, (*chain, number))
        return self._frames[number].place(points)

    def _frame(self, system: _System, chain: tuple[int, ...]) -> Frame:
        if system.points is not None:
            corners = self.place(system.reference, system.points, system.card, chain)
        else:
            rows = []
            for grid in system.grids:
                if grid not in self.grids:
                    system.card.fail(f"names node {grid}, which isn't there")
                number, point = self.grids[grid]
                rows.append(self.place(number, point[None], system.card, chain)[0])
            corners = np.array(rows)
        return Frame.from_z(corners[0], corners[1], corners[2], system.card.where)


_SHELLS = ("CTRIA", "CQUAD")


@dataclass
class _Cells:
    """Elements of one kind: cards, node labels in rows, properties, as written."""

    cards: list[BdfCard] = field(default_factory=list)
    nodes: list[list[str]] = field(default_factory=list)
    properties: list[list[str]] = field(default_factory=list)


def read_bdf(source: Source) -> Mesh:
    """Read GRID, GRDSET, CORD1 and CORD2 systems, CTETRA, CHEXA, CPENTA, CPYRAM and shells, in
    short, long and free fields, with included files.

    The solids of property 3 are the cell set "property_3", its shells the face set "surface_3".

    Raises InputError, with the line, for cards that move, make or select nodes in other ways or
    that aren't known, numbers that are none, elements without all of their nodes, a cut-off file.
    """
    file = read_input(source, "Nastran bulk data")
    path = str(file.path)
    grids: dict[int, BdfCard] = {}
    elements: dict[int, BdfCard] = {}
    cells: dict[str, _Cells] = {}
    systems = Systems()
    default: BdfCard | None = None
    for card in read_bdf_cards(file):
        check_card(card)
        if card.name == "GRID":
            label = integer(card.field(0), card)
            if label in grids:
                card.fail(f"a second card for node {label}; expected one")
            grids[label] = card
        elif card.name == "GRDSET":
            if default is not None:
                card.fail(f"a second one; got the first in line {default.line}; expected one")
            default = card
        elif card.name in SYSTEMS:
            systems.read(card)
        elif card.name in NASTRAN_ELEMENTS:
            label = integer(card.field(0), card)
            if label in elements:
                card.fail(
                    f"a second card for element {label}; got the first at "
                    f"{elements[label].where}; expected each number once"
                )
            elements[label] = card
            _add_element(card, cells)
    labels = np.array(list(grids), dtype=np.int64)
    points = _points(list(grids.values()), labels, default, systems)
    blocks = [RawBlock(kind, _rows(kind, found, labels), _groups(kind, found))
              for kind, found in cells.items()]  # fmt: skip
    solids = [card for kind, found in cells.items() if kind in CELL_TYPES for card in found.cards]
    try:
        return assemble(RawMesh(points, tuple(blocks)), path)
    except InputError as error:
        text = in_numbers_of_file(str(error), lambda k: f"{solids[k].where} {solids[k].fields[0]}")
        raise InputError(text) from None


def _points(
    cards: Sequence[BdfCard], labels: Long, default: BdfCard | None, systems: Systems
) -> Float:
    """(N,3) basic coordinates. A system that a GRID doesn't name is that of GRDSET, else basic."""
    rows = [[*card.fields, "", "", "", "", ""][:5] for card in cards]
    points = reals([row[2:] for row in rows], cards).reshape(-1, 3)
    usual = integer((default.field(1) if default else "") or "0", default or BdfCard("", [], "", 0))
    system = integers([[row[1] or str(usual)] for row in rows], cards).ravel()
    systems.grids = {
        label: (number, point)
        for label, number, point in zip(labels.tolist(), system.tolist(), points, strict=True)
    }
    placed = points.copy()
    for number in np.unique(system).tolist():
        mine = np.flatnonzero(system == number)
        placed[mine] = systems.place(number, points[mine], cards[mine[0]])
    return placed


def _add_element(card: BdfCard, cells: dict[str, _Cells]) -> None:
    kinds = NASTRAN_ELEMENTS[card.name]
    nodes = card.fields[2 : 2 + max(kinds)]
    while nodes and not nodes[-1]:
        nodes.pop()
    # shells have further fields after their nodes, solids haven't
    count = min(kinds) if card.name.startswith(_SHELLS) else len(nodes)
    if count not in kinds or len(nodes) < count or not all(nodes[:count]):
        expected = " or ".join(str(number) for number in kinds)
        given = sum(1 for node in nodes if node)
        card.fail(f"{card.field(0)} with {given} nodes; expected {expected}: cut off?")
    found = cells.setdefault(kinds[count], _Cells())
    found.cards.append(card)
    found.nodes.append(nodes[:count])
    found.properties.append([card.field(1) or card.field(0)])


def _rows(kind: str, found: _Cells, labels: Long) -> Long:
    nodes = integers(found.nodes, found.cards)
    ordered = np.sort(nodes, axis=1)
    twice = np.argwhere(ordered[:, 1:] == ordered[:, :-1])
    if len(twice):
        card = found.cards[twice[0, 0]]
        card.fail(f"{card.field(0)} names node {ordered[tuple(twice[0])]} twice; expected "
                  f"{nodes.shape[1]} different nodes")  # fmt: skip
    rows = index_of(labels, nodes.ravel()).reshape(nodes.shape)
    wrong = np.argwhere(rows < 0)
    if len(wrong):
        card = found.cards[wrong[0, 0]]
        card.fail(f"{card.field(0)} names node {nodes[tuple(wrong[0])]}, which isn't there")
    return from_upright_first(kind, rows)


def _groups(kind: str, found: _Cells) -> dict[str, Long]:
    word = "surface" if kind.startswith(("tri", "quad")) else "property"
    properties = integers(found.properties, found.cards).ravel()
    return {f"{word}_{tag}": np.flatnonzero(properties == tag) for tag in np.unique(properties)}
