"""Nodes, elements and sets of an Abaqus or CalculiX file, from its cards."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from gpusim.distinct import distinct
from gpusim.errors import InputError
from gpusim.mesh.inp_cards import Card, nearest
from gpusim.mesh.inp_types import NODES, SOLID_TYPES
from gpusim.mesh.inp_values import Names, number, whole

__all__ = ["ElementBlock", "InpContent", "read_content"]

Float = npt.NDArray[np.float64]
Int = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class ElementBlock:
    """One *ELEMENT card: labels (M,), node labels (M,k), the type as written, and its card."""

    type: str
    labels: Int
    nodes: Int
    card: Card


@dataclass(eq=False)
class InpContent:
    """What a file says about its mesh, by label: labels are the file's own numbers.

    ``node_labels`` (N,) sorted, ``points`` (N,3) in that order; ``cell_labels`` sorted, of all
    blocks. ``node_sets`` and ``cell_sets`` map a name to sorted labels, ``surfaces`` to pairs
    (element label, face 1…6).
    """

    node_labels: Int
    points: Float
    blocks: list[ElementBlock] = field(default_factory=list)
    cell_labels: Int = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    node_sets: Names[Int] = field(default_factory=lambda: Names("node set"))
    cell_sets: Names[Int] = field(default_factory=lambda: Names("element set"))
    surfaces: Names[Int] = field(default_factory=lambda: Names("surface"))

    def node_index(self, labels: Int, where: Callable[[int], str]) -> Int:
        """Positions of node labels; ``where(k)`` tells where ``labels[k]`` stands."""
        return _positions(self.node_labels, labels, "node", where)

    def nodes_named(self, text: str, where: str) -> Int:
        """Labels of a node or of a node set. Raises InputError for an unknown one."""
        return _named(text, self.node_sets, self.node_labels, where)

    def cells_named(self, text: str, where: str) -> Int:
        """Labels of an element or of an element set. Raises InputError for an unknown one."""
        return _named(text, self.cell_sets, self.cell_labels, where)


def read_content(cards: Sequence[Card]) -> InpContent:
    """Nodes, elements, sets and surfaces. Raises InputError with file and line."""
    _refuse_assemblies(cards)
    content = _nodes(cards)
    cell_parts: dict[str, list[Int]] = {}
    shown: dict[str, str] = {}
    for card in cards:
        if card.keyword == "ELEMENT":
            block = _elements(card)
            content.blocks.append(block)
            name = card.parameters.get("ELSET", "")
            if name:
                cell_parts.setdefault(name.upper(), []).append(block.labels)
                shown.setdefault(name.upper(), name)
    for key, parts in cell_parts.items():
        content.cell_sets.set(shown[key], distinct(np.concatenate(parts)))
    numbers = [block.labels for block in content.blocks]
    content.cell_labels = np.sort(np.concatenate([np.zeros(0, dtype=np.int64), *numbers]))
    _refuse_repeated(content)
    for card in cards:
        if card.keyword == "ELSET":
            _add(content.cell_sets, _name(card, "ELSET"), _cell_members(card, content))
        elif card.keyword == "NSET":
            _add(content.node_sets, _name(card, "NSET"), _node_members(card, content))
        elif card.keyword == "SURFACE":
            _surface(card, content)
    return content


def _refuse_assemblies(cards: Sequence[Card]) -> None:
    """Labels count within a part, so a file of several parts would need renumbering."""
    for keyword in ("PART", "INSTANCE"):
        found = [card for card in cards if card.keyword == keyword]
        if len(found) > 1:
            raise InputError(
                f"{found[1].where()}: a second one; got {len(found)}; expected one part and one "
                "instance of it (or a flat file)"
            )
        if keyword == "INSTANCE" and found and any(True for _ in found[0].rows()):
            raise InputError(
                f"{found[0].where()}: a moved instance isn't supported; expected one in place"
            )


def _named(text: str, sets: Names[Int], known: Int, where: str) -> Int:
    if not text.lstrip("+-").isdigit():
        return sets.get(text, where)
    label = np.array([whole(text, where)])
    _positions(known, label, sets.what.removesuffix(" set"), lambda _: where)
    return label


def _positions(known: Int, labels: Int, what: str, where: Callable[[int], str]) -> Int:
    if len(known) == 0:
        raise InputError(f"{where(0)}: undefined {what}; got {what} {labels[0]}; none is defined")
    place = np.minimum(np.searchsorted(known, labels), len(known) - 1)
    wrong = np.flatnonzero(known[place] != labels)
    if wrong.size:
        raise InputError(
            f"{where(int(wrong[0]))}: undefined {what}; got {what} {labels[wrong[0]]}; expected "
            f"one of the {len(known)} defined, {known[0]} … {known[-1]}"
        )
    return place


def _nodes(cards: Sequence[Card]) -> InpContent:
    labels: list[Int] = []
    points: list[Float] = []
    sets: list[tuple[str, Int]] = []
    for card in cards:
        if card.keyword != "NODE":
            continue
        if card.parameters.get("SYSTEM", "R").upper() not in ("R", ""):
            raise InputError(
                f"{card.where()}: coordinate system; got SYSTEM={card.parameters['SYSTEM']}; "
                "expected rectangular coordinates"
            )
        table = _node_table(card)
        labels.append(table[:, 0].astype(np.int64))
        points.append(table[:, 1:])
        if card.parameters.get("NSET"):
            sets.append((card.parameters["NSET"], labels[-1]))
    if not labels or not sum(len(one) for one in labels):
        where = cards[0].file if cards else "input file"
        raise InputError(f"{where}: no nodes; got no *NODE with data; expected a mesh")
    label, point = np.concatenate(labels), np.concatenate(points)
    # a node defined again takes its last place, as in CalculiX
    unique, last = np.unique(label[::-1], return_index=True)
    content = InpContent(unique, point[::-1][last])
    for name, members in sets:
        _add(content.node_sets, name, members)
    return content


def _node_table(card: Card) -> Float:
    """(K,4) label and coordinates; missing coordinates are zero."""
    if all(line.count(",") == 3 for line in card.lines) and card.lines:
        try:
            table = np.array(",".join(card.lines).split(","), dtype=np.float64).reshape(-1, 4)
        except ValueError:
            pass
        else:
            labels = table[:, 0]
            if np.isfinite(table).all() and (np.abs(labels) < 2**53).all():
                if (labels % 1.0 == 0.0).all():
                    return table
    rows = []
    for line, row in card.rows():
        where = card.where(line)
        if not 1 <= len(row) <= 4:
            # more fields are normals, which solids don't have
            row = row[:4]
        coordinates = [number(text or "0", where) for text in row[1:]]
        rows.append([float(whole(row[0], where)), *coordinates, *[0.0] * (4 - len(row))])
    return np.array(rows, dtype=np.float64).reshape(-1, 4)


def _elements(card: Card) -> ElementBlock:
    written = card.parameters.get("TYPE", "").upper()
    width = NODES.get(written, 0)
    if not width:
        raise InputError(
            f"{card.where()}: element type; got TYPE={written or '(none)'}; expected one of "
            f"{', '.join(SOLID_TYPES)}{nearest(written, list(SOLID_TYPES))}"
        )
    tokens: list[str] = []
    starts: list[int] = []  # position in tokens at which each line starts
    for text in card.lines:
        starts.append(len(tokens))
        stripped = text.rstrip().rstrip(",")
        tokens.extend(stripped.split(","))
    try:
        flat = np.array(tokens, dtype=np.int64)
    except (ValueError, OverflowError):
        for k, row in card.rows():
            for field_ in row:
                whole(field_, card.where(k))
        raise InputError(f"{card.where()}: element data; expected whole numbers") from None
    first = np.arange(0, len(flat), width + 1)
    begun = np.isin(first, starts)
    if not begun.all() or len(flat) % (width + 1):
        # the record before the first one that doesn't begin a line has the wrong length
        wrong = max(int(np.argmin(begun)) - 1, 0) if not begun.all() else len(first) - 1
        line = int(np.searchsorted(starts, first[wrong], side="right")) - 1
        end = next((s for s in starts if s > first[wrong]), len(flat))
        raise InputError(
            f"{card.where(card.numbers[line])}: element {flat[first[wrong]]}; got "
            f"{end - first[wrong] - 1} node numbers in its line; expected {width} for {written}, "
            "over as many lines as they need (is the file cut off?)"
        )
    table = flat.reshape(-1, width + 1)
    return ElementBlock(written, table[:, 0], table[:, 1:], card)


def _refuse_repeated(content: InpContent) -> None:
    known = content.cell_labels
    twice = known[1:][known[1:] == known[:-1]]
    if twice.size:
        last = [block for block in content.blocks if twice[0] in block.labels][-1]
        raise InputError(
            f"{last.card.where()}: {twice.size} element numbers used twice; got element "
            f"{twice[0]}; expected each number once"
        )


def _name(card: Card, key: str) -> str:
    name = card.parameters.get(key, "")
    if not name:
        raise InputError(f"{card.where()}: no name; got {card.shown}; expected {key}=name")
    return name


def _add(sets: Names[Int], name: str, labels: Int) -> None:
    if name.upper() in sets.values:
        labels = np.union1d(sets.values[name.upper()], labels)
    sets.set(name, distinct(labels))


def _members(card: Card, sets: Names[Int], known: Int) -> Int:
    """Labels of a set's data lines: numbers, names of sets, or first, last, step.

    A range may run over numbers that aren't defined; a number by itself may not.
    """
    plain = _plain_numbers(card)
    if plain is not None and len(known):
        place = np.minimum(np.searchsorted(known, plain), len(known) - 1)
        if (known[place] == plain).all():
            return plain
    labels: list[Int] = [np.zeros(0, dtype=np.int64)]
    generate = "GENERATE" in card.parameters
    for line, row in card.rows():
        where = card.where(line)
        if generate:
            if len(row) not in (2, 3):
                raise InputError(
                    f"{where}: GENERATE; got {len(row)} fields; expected first, last, step"
                )
            first, last = whole(row[0], where), whole(row[1], where)
            step = whole(row[2], where) if len(row) == 3 else 1
            if step < 1 or last < first:
                raise InputError(
                    f"{where}: GENERATE; got {', '.join(row)}; expected first <= last, step >= 1"
                )
            inside = known[np.searchsorted(known, first) : np.searchsorted(known, last, "right")]
            labels.append(inside[(inside - first) % step == 0])
            continue
        for text in row:
            if text:
                labels.append(_named(text, sets, known, where))
    return np.concatenate(labels)


def _plain_numbers(card: Card) -> Int | None:
    """All data as whole numbers at once, or None where something else stands there."""
    if "GENERATE" in card.parameters:
        return None
    try:
        fields = [text for text in ",".join(card.lines).split(",") if text.strip()]
        return np.array(fields, dtype=np.int64)
    except (ValueError, OverflowError):
        return None


def _cell_members(card: Card, content: InpContent) -> Int:
    return _members(card, content.cell_sets, content.cell_labels)


def _node_members(card: Card, content: InpContent) -> Int:
    source = card.parameters.get("ELSET", "")
    if not source:
        return _members(card, content.node_sets, content.node_labels)
    wanted = content.cell_sets.get(source, card.where())
    parts = [block.nodes[np.isin(block.labels, wanted)].ravel() for block in content.blocks]
    return distinct(np.concatenate(parts))


def _surface(card: Card, content: InpContent) -> None:
    kind = card.parameters.get("TYPE", "ELEMENT").upper()
    name = _name(card, "NAME")
    if kind == "NODE":
        _add(content.node_sets, name, _node_members(card, content))
        return
    if kind != "ELEMENT":
        raise InputError(f"{card.where()}: surface type; got TYPE={kind}; expected ELEMENT or NODE")
    pairs: list[Int] = [np.zeros((0, 2), dtype=np.int64)]
    for line, row in card.rows():
        where = card.where(line)
        face = row[1].upper() if len(row) == 2 else ""
        if not (len(face) == 2 and face[0] == "S" and face[1] in "123456"):
            raise InputError(
                f"{where}: surface; got {', '.join(row)}; expected an element or element set and "
                "its face S1 … S6"
            )
        labels = content.cells_named(row[0], where)
        pairs.append(np.stack([labels, np.full(len(labels), int(face[1]))], axis=1))
    content.surfaces.set(name, np.concatenate(pairs))
