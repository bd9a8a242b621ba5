"""What an Abaqus or CalculiX file says about its mesh, sets and surfaces, by its own numbers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from gpusim.arrays.array_types import Float, Long
from gpusim.arrays.unique import distinct
from gpusim.errors import InputError
from gpusim.mesh.formats.abaqus.cards import Card, Names, numbers_at_once, whole
from gpusim.mesh.formats.abaqus.elements import ElementBlock
from gpusim.validation import require


@dataclass(frozen=True, eq=False)
class Numbering:
    """Numbers of nodes, or of elements, of a whole file.

    Each part counts for itself, so that node 12 of the second instance is ``offsets[1] + 12``: its
    label. ``known`` are all labels, sorted; ``own`` is the offset of what the assembly numbers
    itself. A file without instances has no ``names`` and no offsets: a number is its label.
    """

    what: str
    known: Long
    names: Sequence[str] = ()
    offsets: Sequence[int] = ()
    own: int = 0
    assembly: str = ""

    def offset(self, instance: str, where: str) -> int:
        """Of an instance, "" for the assembly's own. Raises InputError for an unknown one."""
        if not instance:
            return self.own
        name = instance.upper()
        for one, offset in zip(self.names, self.offsets, strict=True):
            if one.upper() == name or f"{self.assembly}.{one}".upper() == name:
                return offset
        raise InputError(
            f"{where}: unknown instance; got {instance!r}; expected one of "
            f"{', '.join(self.names) or 'none, the file has none'}"
        )

    def _scopes(self, instance: str, where: str) -> list[int]:
        """Offsets that a number may have; that of a single instance needs no name."""
        offset = self.offset(instance, where)
        return [offset] if instance or len(self.names) != 1 else [offset, self.offsets[0]]

    def several(self, numbers: Long, where: str, instance: str = "") -> Long | None:
        """Labels of many numbers, None unless they are all defined in one place."""
        for offset in self._scopes(instance, where):
            labels = numbers + offset
            place = np.minimum(np.searchsorted(self.known, labels), len(self.known) - 1)
            if len(self.known) and (self.known[place] == labels).all():
                return labels
        return None

    def one(self, text: str, where: str, instance: str = "") -> Long:
        """(1,) label of ``12`` or ``INSTANCE.12``. Raises InputError for an undefined one."""
        head, _, tail = text.rpartition(".")
        number = np.array([whole(tail, where)])
        found = self.several(number, where, instance or head)
        if found is not None:
            return found
        labels = number + self.offset(instance or head, where)
        return self.known[self.positions(labels, lambda _: where)]  # which raises

    def between(self, first: int, last: int, step: int, where: str, instance: str = "") -> Long:
        """Labels of all defined numbers first, first + step, … up to last."""
        for offset in self._scopes(instance, where):
            start, end = np.searchsorted(self.known, [first + offset, last + offset + 1])
            if end > start:
                break
        inside = self.known[start:end]
        return np.asarray(inside[(inside - offset - first) % step == 0])

    def shown(self, label: int) -> str:
        """The file's own number of a label: ``12``, or ``INSTANCE.12`` where there are several."""
        if len(self.names) < 2 and label < self.own:
            return str(label)
        offsets = [*self.offsets, self.own]
        place = max(int(np.searchsorted(offsets, label)) - 1, 0)
        number = str(label - offsets[place])
        return f"{self.names[place]}.{number}" if place < len(self.names) else number

    def positions(self, labels: Long, where: Callable[[int], str]) -> Long:
        """Places of labels among ``known``; ``where(k)`` tells where ``labels[k]`` stands."""
        if len(self.known) == 0:
            raise InputError(
                f"{where(0)}: undefined {self.what}; got {self.what} {self.shown(labels[0])}; "
                "none is defined"
            )
        place = np.minimum(np.searchsorted(self.known, labels), len(self.known) - 1)
        wrong = np.flatnonzero(self.known[place] != labels)
        if wrong.size:
            raise InputError(
                f"{where(int(wrong[0]))}: undefined {self.what}; got {self.what} "
                f"{self.shown(labels[wrong[0]])}; expected one of the {len(self.known)} defined, "
                f"{self.shown(self.known[0])} … {self.shown(self.known[-1])}"
            )
        return place


@dataclass(eq=False)
class InpContent:
    """What a file says about its mesh, by label (see `Numbering`).

    ``nodes.known`` (N,) sorted, ``points`` (N,3) in that order; ``cells.known`` sorted, of all
    blocks. ``node_sets`` and ``cell_sets`` map a name to sorted labels, ``surfaces`` to pairs
    (element label, face 1…6). ``history`` are the cards of everything but nodes and elements, of
    parts too, as a flat file would have them.
    """

    points: Float
    nodes: Numbering
    cells: Numbering
    blocks: list[ElementBlock] = field(default_factory=list)
    node_sets: Names[Long] = field(default_factory=lambda: Names("node set"))
    cell_sets: Names[Long] = field(default_factory=lambda: Names("element set"))
    surfaces: Names[Long] = field(default_factory=lambda: Names("surface"))
    history: Sequence[Card] = ()

    @property
    def node_labels(self) -> Long:
        return self.nodes.known

    def nodes_named(self, text: str, where: str, instance: str = "") -> Long:
        """Labels of a node or of a node set. Raises InputError for an unknown one."""
        return _named(text, self.node_sets, self.nodes, where, instance)

    def node_rows(self, text: str, where: str) -> Long:
        """Rows of ``points`` of a node or of a node set."""
        return np.searchsorted(self.node_labels, self.nodes_named(text, where))

    def cells_named(self, text: str, where: str, instance: str = "") -> Long:
        """Labels of an element or of an element set. Raises InputError for an unknown one."""
        return _named(text, self.cell_sets, self.cells, where, instance)


def _named(text: str, sets: Names[Long], numbers: Numbering, where: str, instance: str) -> Long:
    name = f"{instance}.{text}" if instance else text
    digits = text.rpartition(".")[2].lstrip("+-")
    if digits.isdigit() and not ("." in text and name in sets):
        return numbers.one(text, where, instance)
    return sets.get(name, where)


def read_set(card: Card, content: InpContent) -> None:
    """*ELSET, *NSET or *SURFACE, into ``content``; other cards are left. Raises InputError."""
    if card.keyword == "ELSET":
        add_members(content.cell_sets, _name(card, "ELSET"), _members(card, content))
    elif card.keyword == "NSET":
        add_members(content.node_sets, _name(card, "NSET"), _node_members(card, content))
    elif card.keyword == "SURFACE":
        _surface(card, content)


def add_members(sets: Names[Long], name: str, labels: Long) -> None:
    """A set grows where its name is given again."""
    if name.upper() in sets.values:
        labels = np.union1d(sets.values[name.upper()], labels)
    sets.set(name, distinct(labels))


def _name(card: Card, key: str) -> str:
    name = card.parameters.get(key, "")
    if not name:
        card.fail(f"no name; got {card.shown}; expected {key}=name")
    return name


def _members(card: Card, content: InpContent) -> Long:
    """Labels of a set's data lines: numbers, names of sets, or first, last, step.

    A range may run over numbers that aren't defined; a number by itself may not.
    """
    numbers, named = (
        (content.cells, content.cells_named)
        if card.keyword == "ELSET"
        else (content.nodes, content.nodes_named)
    )
    instance, generate = card.parameters.get("INSTANCE", ""), "GENERATE" in card.parameters
    numbers.offset(instance, card.where())
    plain = None if generate else _plain_numbers(card)
    if plain is not None:
        quick = numbers.several(plain, card.where(), instance)
        if quick is not None:
            return quick
    labels: list[Long] = [np.zeros(0, dtype=np.int64)]
    for where, row in card.records():
        if generate:
            labels.append(numbers.between(*_range(row, where), where, instance))
        else:
            labels += [named(text, where, instance) for text in row if text]
    return np.concatenate(labels)


def _range(row: list[str], where: str) -> tuple[int, int, int]:
    require(len(row) in (2, 3), f"{where}: GENERATE", f"{len(row)} fields", "first, last, step")
    first, last = whole(row[0], where), whole(row[1], where)
    step = whole(row[2], where) if len(row) == 3 else 1
    expected = "first <= last, step >= 1"
    require(step >= 1 and last >= first, f"{where}: GENERATE", ", ".join(row), expected)
    return first, last, step


def _plain_numbers(card: Card) -> Long | None:
    """All data as whole numbers at once, or None where something else stands there."""
    fields = [one for one in ",".join(card.lines).split(",") if one.strip()]
    return numbers_at_once(fields, np.int64)


def _node_members(card: Card, content: InpContent) -> Long:
    source, instance = card.parameters.get("ELSET", ""), card.parameters.get("INSTANCE", "")
    if not source:
        return _members(card, content)
    wanted = content.cell_sets.get(f"{instance}.{source}" if instance else source, card.where())
    parts = [block.nodes[np.isin(block.labels, wanted)].ravel() for block in content.blocks]
    return distinct(np.concatenate([np.zeros(0, dtype=np.int64), *parts]))


def _surface(card: Card, content: InpContent) -> None:
    kind = card.parameters.get("TYPE", "ELEMENT").upper()
    name = _name(card, "NAME")
    if kind == "NODE":
        add_members(content.node_sets, name, _node_members(card, content))
        return
    pairs: list[Long] = [np.zeros((0, 2), dtype=np.int64)]
    for where, row in card.records():
        face = row[1].upper() if len(row) == 2 else ""
        fits = len(face) == 2 and face[0] == "S" and face[1] in "123456"
        expected = "an element or element set and its face S1 … S6"
        require(fits, f"{where}: surface", ", ".join(row), expected)
        labels = content.cells_named(row[0], where)
        pairs.append(np.stack([labels, np.full(len(labels), int(face[1]))], axis=1))
    content.surfaces.define(name, np.concatenate(pairs), card.where())
