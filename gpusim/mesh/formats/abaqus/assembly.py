"""Parts and their instances in Abaqus files: which card belongs where, and where it is placed.

`read_content` makes of them the nodes, elements and sets of the whole file.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from gpusim.arrays.array_types import Float, Long
from gpusim.errors import InputError
from gpusim.mesh.file_content.coordinate_systems import rotation
from gpusim.mesh.formats.abaqus.cards import Card, Names, number
from gpusim.mesh.formats.abaqus.content import InpContent, Numbering, add_members, read_set
from gpusim.mesh.formats.abaqus.elements import ElementBlock, read_elements
from gpusim.mesh.formats.abaqus.nodes import NODE_CARDS, Nodes


@dataclass(frozen=True, eq=False)
class Instance:
    """A part in its place: ``cards`` of the part and of the instance itself, and points x of the
    part at ``turn`` x + ``shift``."""

    name: str
    cards: Sequence[Card]
    turn: Float
    shift: Float

    def place(self, points: Float) -> Float:
        return np.asarray(points @ self.turn.T + self.shift)


@dataclass(eq=False)
class Assembly:
    """A file's cards: ``own`` are those of the assembly and the model, outside of parts. A file
    without instances, and with one part at most, is all its own."""

    name: str = ""
    where: str = ""
    own: list[Card] = field(default_factory=list)
    instances: list[Instance] = field(default_factory=list)

    def history(self) -> list[Card]:
        """All cards but those of nodes and elements, in their order, as a flat file would say
        them: sections of a part once for each instance, with the names of its sets.

        Raises InputError for cards inside of a part that mean something else for each instance.
        """
        found: dict[Card, None] = {}  # a material of a part stands for all of its instances
        for instance in self.instances:
            for card in instance.cards:
                found |= dict.fromkeys(_of_instance(card, instance))
        return [*found, *self.own]


# Cards inside of a part that name no node or element, or are told from their names.
_MATERIAL = frozenset(["MATERIAL", "ELASTIC", "DENSITY", "EXPANSION"])
_NAMES = {"SOLIDSECTION": ("ELSET", "ORIENTATION"), "ORIENTATION": ("NAME",)}
# What in a part is bound to its nodes or directions, and would have to be placed with it.
_BOUND = frozenset(
    """
    BOUNDARY TRANSFORM EQUATION TIE CLOAD DLOAD DSLOAD INITIALCONDITIONS TEMPERATURE STEP STATIC
    ENDSTEP AMPLITUDE
    """.split()
)


def _of_instance(card: Card, instance: Instance) -> list[Card]:
    if card.keyword in _BOUND:
        card.fail(
            f"inside of the part of instance {instance.name}; expected it in the "
            "assembly, or after it"
        )
    if card.keyword in _MATERIAL:
        return [card]
    if card.keyword not in _NAMES:
        return []
    if card.keyword == "ORIENTATION" and not np.array_equal(instance.turn, np.eye(3)):
        card.fail(
            f"inside of the turned instance {instance.name}; expected an "
            "orientation in a part that isn't turned"
        )
    own = {
        key: f"{instance.name}.{value}"
        for key, value in card.parameters.items()
        if key in _NAMES[card.keyword] and value
    }
    return [replace(card, parameters={**card.parameters, **own})]


_OPENING = {"PART": "ENDPART", "ASSEMBLY": "ENDASSEMBLY", "INSTANCE": "ENDINSTANCE"}


def find_assembly(cards: Sequence[Card]) -> Assembly:
    """Parts and instances of a file. Raises InputError with file and line."""
    parts: dict[str, list[Card]] = {}
    placed: list[tuple[Card, list[Card]]] = []
    whole = Assembly()
    blocks: list[tuple[Card, list[Card]]] = []  # what is open, outermost first
    part_cards: list[Card] = []
    system: Card | None = None  # in which nodes outside of parts are given
    for card in cards:
        if card.keyword in _OPENING:
            _refuse_nesting(card, [one.keyword for one, _ in blocks])
            inner: list[Card] = [] if card.keyword != "ASSEMBLY" else whole.own
            if card.keyword == "PART":
                key = card.parameters.get("NAME", "").upper()
                if system is not None:
                    card.fail(
                        f"a part begins while {system.where()} is open; expected "
                        "an empty *SYSTEM before it, or the system inside of the part"
                    )
                if key in parts:
                    card.fail(f"a second part {key}; expected other names")
                parts[key] = inner
                part_cards.append(card)
            elif card.keyword == "INSTANCE":
                placed.append((card, inner))
            else:
                whole.name, whole.where = card.parameters.get("NAME", ""), card.where()
            blocks.append((card, inner))
        elif card.keyword in _OPENING.values():
            if not blocks or _OPENING[blocks[-1][0].keyword] != card.keyword:
                card.fail(f"ends nothing; expected *{card.shown[5:]} before")
            blocks.pop()
        else:
            if card.keyword == "SYSTEM" and not blocks:
                system = card if any(card.rows()) else None
            (blocks[-1][1] if blocks else whole.own).append(card)
    if blocks and placed:
        raise InputError(f"{blocks[-1][0].where()}: doesn't end; is the file cut off?")
    if not placed:
        if len(parts) > 1:
            raise InputError(
                f"{part_cards[1].where()}: a second one; got {len(parts)} parts and no *INSTANCE; "
                "expected an assembly of them (or one part)"
            )
        inside = {"PART", "ENDPART", "ASSEMBLY", "ENDASSEMBLY"}
        return Assembly(own=[card for card in cards if card.keyword not in inside])
    for card, inner in placed:
        whole.instances.append(_instance(card, inner, parts, whole.instances))
    return whole


def _refuse_nesting(card: Card, inside: list[str]) -> None:
    wanted = ["ASSEMBLY"] if card.keyword == "INSTANCE" else []
    if inside != wanted:
        place = " of ".join(f"*{one}" for one in reversed(inside)) or "no assembly"
        card.fail(
            f"inside of {place}; expected it "
            f"{'inside of *ASSEMBLY' if wanted else 'by itself'} (an end is missing?)"
        )


def _instance(
    card: Card, inner: list[Card], parts: dict[str, list[Card]], others: Sequence[Instance]
) -> Instance:
    name, part = card.parameters.get("NAME", ""), card.parameters.get("PART", "")
    if not name or any(other.name.upper() == name.upper() for other in others):
        card.fail(f"got NAME={name!r}; expected a name of its own")
    if part.upper() not in parts:
        card.fail(
            f"unknown part; got {part!r}; expected one of "
            f"{', '.join(parts) or 'none, none is defined'}"
        )
    rows = [[number(text or "0", where) for text in row] for where, row in card.records()]
    shift = np.array((rows[0] if rows else []) + [0.0] * (3 - len(rows[0] if rows else [])))
    turn = np.eye(3)
    if len(rows) > 2 or shift.shape != (3,) or (len(rows) == 2 and len(rows[1]) != 7):
        card.fail(
            f"got {len(rows)} lines; expected the shift in the first, and in a "
            "second two points of the axis and the angle"
        )
    if len(rows) == 2:
        # the instance is shifted first, then turned about the axis
        a, b, angle = np.array(rows[1][:3]), np.array(rows[1][3:6]), rows[1][6]
        if not np.linalg.norm(b - a) > 0.0:
            card.fail("no axis; got two equal points; expected two others")
        turn = rotation(b - a, angle)
        shift = turn @ (shift - a) + a
    return Instance(name, [*parts[part.upper()], *inner], turn, shift)


def read_content(cards: Sequence[Card]) -> InpContent:
    """Nodes, elements, sets and surfaces. Raises InputError with file and line."""
    assembly = find_assembly(cards)
    own = _scope(assembly.own)
    content = _assembled(assembly, own) if assembly.instances else own
    if not len(content.points):
        where = cards[0].file if cards else "input file"
        raise InputError(f"{where}: no nodes; got no *NODE with data; expected a mesh")
    for card in assembly.own:
        read_set(card, content)
    content.history = assembly.history()
    return content


def _scope(cards: Sequence[Card]) -> InpContent:
    """Nodes and elements of cards that count together, and the sets that they name at once."""
    nodes = _nodes(cards)
    labels, points = nodes.merged()
    blocks, cell_sets = read_elements(cards)
    numbers = [np.zeros(0, dtype=np.int64), *(block.labels for block in blocks)]
    content = InpContent(
        points, Numbering("node", labels), Numbering("element", np.sort(np.concatenate(numbers)))
    )
    content.blocks = blocks
    for name, members in nodes.sets:
        add_members(content.node_sets, name, members)
    for name, members in cell_sets:
        add_members(content.cell_sets, name, members)
    known = content.cells.known
    twice = known[1:][known[1:] == known[:-1]]
    if twice.size:
        last = [block for block in blocks if twice[0] in block.labels][-1]
        last.card.fail(
            f"{twice.size} element numbers used twice; got element "
            f"{twice[0]}; expected each number once"
        )
    return content


def _nodes(cards: Sequence[Card]) -> Nodes:
    nodes = Nodes()
    for place, card in enumerate(cards):
        if card.keyword in NODE_CARDS:
            nodes.read(card, partial(_set_so_far, nodes, cards[:place]))
    return nodes


def _set_so_far(nodes: Nodes, cards: Sequence[Card], name: str, where: str) -> Long:
    """Labels of a node set as the cards before a place define it, for *NFILL."""
    labels, points = nodes.merged()
    content = InpContent(points, Numbering("node", labels), Numbering("element", labels[:0]))
    for known, members in nodes.sets:
        add_members(content.node_sets, known, members)
    for card in cards:
        if card.keyword == "NSET" and "ELSET" not in card.parameters:
            read_set(card, content)
            if "UNSORTED" in card.parameters and card.parameters.get("NSET", "") == name:
                raise InputError(f"{where}: set {name} is unsorted; expected a sorted one")
    return content.node_sets.get(name, where)


def _assembled(assembly: Assembly, own: InpContent) -> InpContent:
    """All instances in their places, and what the assembly has itself.

    The first instance keeps its numbers; each further one, and at last the assembly, counts on
    from the next power of ten above all numbers.
    """
    names = [instance.name for instance in assembly.instances]
    parts = [_part(instance.cards) for instance in assembly.instances]
    every = [*parts, own]
    labels = np.concatenate([one for c in every for one in (c.nodes.known, c.cells.known)])
    stride = 10 ** len(str(int(labels.max(initial=1))))
    if labels.min(initial=1) < 1 or stride * len(every) >= 2**53:
        raise InputError(
            f"{assembly.where}: got numbers {labels.min()} … {labels.max()} of nodes and elements "
            f"in {len(names)} instances; expected numbers above 0, and smaller ones"
        )
    offsets = [stride * k for k in range(len(every))]

    def numbering(what: str, known: list[Long]) -> Numbering:
        shifted = np.concatenate([one + k for one, k in zip(known, offsets, strict=True)])
        return Numbering(what, shifted, names, offsets[:-1], offsets[-1], assembly.name)

    places = [
        instance.place(c.points) for instance, c in zip(assembly.instances, parts, strict=True)
    ]
    content = InpContent(
        np.concatenate([*places, own.points]),
        numbering("node", [one.nodes.known for one in every]),
        numbering("element", [one.cells.known for one in every]),
    )
    single = names[0] if len(names) == 1 else ""
    content.node_sets = Names("node set", single, assembly.name)
    content.cell_sets = Names("element set", single, assembly.name)
    content.surfaces = Names("surface", single, assembly.name)
    for name, part, offset in zip([*names, ""], every, offsets, strict=True):
        _add_scope(content, part, f"{name}." if name else "", offset)
    return content


def _part(cards: Sequence[Card]) -> InpContent:
    content = _scope(cards)
    for card in cards:
        if card.parameters.get("INSTANCE") and card.keyword in ("NSET", "ELSET"):
            card.fail("INSTANCE inside of a part; expected it outside")
        read_set(card, content)
    return content


def _add_scope(content: InpContent, part: InpContent, prefix: str, offset: int) -> None:
    for block in part.blocks:
        name = f"{prefix}{block.name}" if block.name else ""
        content.blocks.append(
            ElementBlock(
                block.type, block.labels + offset, block.nodes + offset, block.card, name, offset
            )
        )
    for name, labels in part.node_sets.items():
        content.node_sets.set(prefix + name, labels + offset)
    for name, labels in part.cell_sets.items():
        content.cell_sets.set(prefix + name, labels + offset)
    for name, pairs in part.surfaces.items():
        content.surfaces.set(prefix + name, pairs + np.array([offset, 0]))
