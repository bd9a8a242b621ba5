"""Nodes, elements and sets of an Abaqus or CalculiX file, from its cards."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.mesh.formats.abaqus.assembly import Assembly, find_assembly
from gpusim.mesh.formats.abaqus.cards import Card
from gpusim.mesh.formats.abaqus.content import InpContent, Numbering
from gpusim.mesh.formats.abaqus.elements import ElementBlock, read_elements
from gpusim.mesh.formats.abaqus.nodes import NODE_CARDS, Nodes
from gpusim.mesh.formats.abaqus.sets import add_members, read_set
from gpusim.mesh.formats.abaqus.values import Names

__all__ = ["read_content"]

Float = npt.NDArray[np.float64]
Int = npt.NDArray[np.int64]


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
        raise InputError(
            f"{last.card.where()}: {twice.size} element numbers used twice; got element "
            f"{twice[0]}; expected each number once"
        )
    return content


def _nodes(cards: Sequence[Card]) -> Nodes:
    nodes = Nodes()
    for place, card in enumerate(cards):
        if card.keyword in NODE_CARDS:
            nodes.read(card, partial(_set_so_far, nodes, cards[:place]))
    return nodes


def _set_so_far(nodes: Nodes, cards: Sequence[Card], name: str, where: str) -> Int:
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

    def numbering(what: str, known: list[Int]) -> Numbering:
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
            raise InputError(f"{card.where()}: INSTANCE inside of a part; expected it outside")
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
