"""Nastran's bulk data (.bdf, .nas, .fem): nodes and solid and shell elements."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.mesh.raw import RawBlock, RawMesh, index_of

__all__ = ["read_bdf"]

Long = npt.NDArray[np.int64]

# Card -> number of nodes -> kind.
_CARDS: dict[str, dict[int, str]] = {
    "CTETRA": {4: "tet4", 10: "tet10"},
    "CHEXA": {8: "hex8", 20: "hex20"},
    "CPENTA": {6: "wedge6", 15: "wedge15"},
    "CPYRAM": {5: "pyramid5", 13: "pyramid13"},
    "CPYRA": {5: "pyramid5", 13: "pyramid13"},
    "CTRIA3": {3: "tri3"},
    "CTRIAR": {3: "tri3"},
    "CTRIA6": {6: "tri6"},
    "CQUAD4": {4: "quad4"},
    "CQUADR": {4: "quad4"},
    "CQUAD8": {8: "quad8"},
}
# Nastran numbers the upright edges before those on top.
_ORDER = {
    "hex20": [*range(12), *range(16, 20), *range(12, 16)],
    "wedge15": [*range(9), *range(12, 15), *range(9, 12)],
}
_SHELLS = ("CTRIA", "CQUAD")
_SOLIDS = ("CTET", "CHEX", "CPENT", "CPYR", "CSOLID")
# 1.5-3 and 1.5D-3 stand for 1.5e-3
_EXPONENT = re.compile(r"(?<=[0-9.])([+-])(?=\d+$)")


@dataclass
class _Cells:
    """Elements of one kind: node labels in rows, and their property."""

    nodes: list[list[str]] = field(default_factory=list)
    properties: list[str] = field(default_factory=list)


def read_bdf(path: Path) -> RawMesh:
    """Read GRID, CTETRA, CHEXA, CPENTA, CPYRAM and shell cards, in short, long and free fields.

    The solids of property 3 are the group "property_3", its shells "surface_3".

    Raises InputError, with the line, for INCLUDE, nodes in a coordinate system of their own,
    numbers that are none, elements without all of their nodes, a file without ENDDATA.
    """
    return _Reader(path).read()


class _Reader:
    def __init__(self, path: Path) -> None:
        self.source = str(path)
        try:
            self.lines = path.read_bytes().decode("utf-8-sig").splitlines()
        except UnicodeDecodeError as error:
            raise InputError(
                f"{path}: not a text; got {error.reason} at byte {error.start}"
            ) from None

    def fail(self, line: int, problem: str) -> NoReturn:
        raise InputError(f"{self.source}: line {line}: {problem}")

    def read(self) -> RawMesh:
        labels: list[str] = []
        places: list[list[str]] = []
        cells: dict[str, _Cells] = {}
        strange: dict[str, int] = {}
        lines: list[int] = []
        for line, name, fields in self._cards():
            if name == "GRID":
                if len(fields) < 5:
                    fields = [*fields, "", "", "", "", ""]
                if fields[1] not in ("", "0"):
                    self.fail(
                        line, f"GRID in coordinate system {fields[1]}; expected the basic one"
                    )
                labels.append(fields[0])
                places.append(fields[2:5])
                lines.append(line)
            elif name in _CARDS:
                self._element(line, name, fields, cells)
            elif name.startswith(_SOLIDS):
                strange[name] = strange.get(name, 0) + 1
            elif name == "INCLUDE":
                self.fail(line, "INCLUDE; expected one file with all of the mesh")
        numbers = self._whole(labels, "a node's number")
        twice = np.flatnonzero(np.diff(np.sort(numbers)) == 0)
        if twice.size:
            label = np.sort(numbers)[twice[0]]
            raise InputError(f"{self.source}: two GRID cards for node {label}; expected one")
        points = self._reals(places, lines)
        blocks = [RawBlock(kind, self._rows(kind, found, numbers), self._groups(kind, found))
                  for kind, found in cells.items()]  # fmt: skip
        blocks += [
            RawBlock(name, np.zeros((count, 0), dtype=np.int64)) for name, count in strange.items()
        ]
        return RawMesh(points, tuple(blocks))

    def _cards(self) -> Iterator[tuple[int, str, list[str]]]:
        """(line, name, fields) of each card of the bulk data, continuations joined."""
        start = 0
        for number, text in enumerate(self.lines):
            if text.strip().upper().startswith("BEGIN") and "BULK" in text.upper():
                start = number + 1
        card: tuple[int, str, list[str]] | None = None
        for number in range(start, len(self.lines)):
            text = self.lines[number].split("$", 1)[0].rstrip()
            if not text:
                continue
            name, fields = _fields(text.expandtabs(8))
            if name[:1] in ("", "+", "*"):
                if card is not None:
                    card[2].extend(fields)
                continue
            if card is not None:
                yield card
            name = name.rstrip("*").strip().upper()
            if name == "ENDDATA":
                return
            if name.startswith("INCLUDE"):
                name = "INCLUDE"
            card = (number + 1, name, fields)
        raise InputError(f"{self.source}: no ENDDATA; expected one at the end: cut off?")

    def _element(self, line: int, name: str, fields: list[str], cells: dict[str, _Cells]) -> None:
        kinds = _CARDS[name]
        most = max(kinds)
        nodes = fields[2 : 2 + most]
        while nodes and not nodes[-1]:
            nodes.pop()
        # shells have further fields after their nodes, solids haven't
        count = min(kinds) if name.startswith(_SHELLS) else len(nodes)
        if count not in kinds or len(nodes) < count or not all(nodes[:count]):
            expected = " or ".join(str(number) for number in kinds)
            given = sum(1 for node in nodes if node)
            self.fail(line, f"{name} with {given} nodes; expected {expected}: cut off?")
        found = cells.setdefault(kinds[count], _Cells())
        found.nodes.append(nodes[:count])
        found.properties.append(fields[1] or fields[0])

    def _whole(self, words: list[str], what: str) -> Long:
        try:
            return np.array(words, dtype=np.int64)
        except (ValueError, OverflowError) as error:
            raise InputError(f"{self.source}: {error}; expected {what}") from None

    def _reals(self, rows: list[list[str]], lines: list[int]) -> npt.NDArray[np.float64]:
        try:
            return np.array(rows, dtype=np.float64).reshape(-1, 3)
        except ValueError:
            pass
        points = np.empty((len(rows), 3))
        for number, row in enumerate(rows):
            for k, word in enumerate(row):
                text = _EXPONENT.sub(r"e\1", word.upper().replace("D", "E").lower()) or "0"
                try:
                    points[number, k] = float(text)
                except ValueError:
                    self.fail(lines[number], f"got {word!r}; expected a coordinate")
        return points

    def _rows(self, kind: str, found: _Cells, labels: Long) -> Long:
        nodes = self._whole([word for row in found.nodes for word in row], "a node's number")
        rows = index_of(labels, nodes).reshape(len(found.nodes), -1)
        if (rows < 0).any():
            missing = nodes.reshape(rows.shape)[rows < 0][0]
            raise InputError(f"{self.source}: a {kind} names node {missing}, which isn't there")
        return rows[:, _ORDER[kind]] if kind in _ORDER else rows

    def _groups(self, kind: str, found: _Cells) -> dict[str, Long]:
        word = "surface" if kind.startswith(("tri", "quad")) else "property"
        properties = self._whole(found.properties, "a property's number")
        return {f"{word}_{tag}": np.flatnonzero(properties == tag) for tag in np.unique(properties)}


def _fields(text: str) -> tuple[str, list[str]]:
    """Name and data fields of a line; without the mark of a continuation."""
    if "," in text:
        words = [word.strip() for word in text.split(",")]
        width = 4 if "*" in words[0] else 8
        fields = words[1 : 1 + width]
        return words[0], fields + [""] * (width - len(fields))
    name = text[:8].strip()
    size = 16 if "*" in name else 8
    return name, [text[at : at + size].strip() for at in range(8, 72, size)]
