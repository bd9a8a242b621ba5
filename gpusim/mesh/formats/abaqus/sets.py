"""Sets and surfaces of an Abaqus or CalculiX file, from their cards."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.arrays.unique import distinct
from gpusim.errors import InputError
from gpusim.mesh.formats.abaqus.cards import Card
from gpusim.mesh.formats.abaqus.content import InpContent
from gpusim.mesh.formats.abaqus.values import Names, is_plain, whole

__all__ = ["add_members", "read_set"]

Int = npt.NDArray[np.int64]


def read_set(card: Card, content: InpContent) -> None:
    """*ELSET, *NSET or *SURFACE, into ``content``; other cards are left. Raises InputError."""
    if card.keyword == "ELSET":
        add_members(content.cell_sets, _name(card, "ELSET"), _members(card, content))
    elif card.keyword == "NSET":
        add_members(content.node_sets, _name(card, "NSET"), _node_members(card, content))
    elif card.keyword == "SURFACE":
        _surface(card, content)


def add_members(sets: Names[Int], name: str, labels: Int) -> None:
    """A set grows where its name is given again."""
    if name.upper() in sets.values:
        labels = np.union1d(sets.values[name.upper()], labels)
    sets.set(name, distinct(labels))


def _name(card: Card, key: str) -> str:
    name = card.parameters.get(key, "")
    if not name:
        raise InputError(f"{card.where()}: no name; got {card.shown}; expected {key}=name")
    return name


def _members(card: Card, content: InpContent) -> Int:
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
    labels: list[Int] = [np.zeros(0, dtype=np.int64)]
    for line, row in card.rows():
        where = card.where(line)
        if generate:
            labels.append(numbers.between(*_range(row, where), where, instance))
        else:
            labels += [named(text, where, instance) for text in row if text]
    return np.concatenate(labels)


def _range(row: list[str], where: str) -> tuple[int, int, int]:
    if len(row) not in (2, 3):
        raise InputError(f"{where}: GENERATE; got {len(row)} fields; expected first, last, step")
    first, last = whole(row[0], where), whole(row[1], where)
    step = whole(row[2], where) if len(row) == 3 else 1
    if step < 1 or last < first:
        raise InputError(
            f"{where}: GENERATE; got {', '.join(row)}; expected first <= last, step >= 1"
        )
    return first, last, step


def _plain_numbers(card: Card) -> Int | None:
    """All data as whole numbers at once, or None where something else stands there."""
    try:
        text = ",".join(card.lines)
        fields = [one for one in text.split(",") if one.strip()]
        return np.array(fields, dtype=np.int64) if is_plain(text) else None
    except (ValueError, OverflowError):
        return None


def _node_members(card: Card, content: InpContent) -> Int:
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
    content.surfaces.define(name, np.concatenate(pairs), card.where())
