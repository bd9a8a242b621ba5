"""Elements of an Abaqus or CalculiX file: their types, given and generated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gpusim.arrays.array_types import Long
from gpusim.errors import InputError
from gpusim.mesh.cell_types import CELL_TYPES
from gpusim.mesh.formats.abaqus.cards import Card, nearest, numbers_at_once, whole
from gpusim.mesh.formats.abaqus.nodes import MAX_GENERATED

# Solid element types that share nodes and node order with ours, but for the middles of C3D27, which
# are told by where they lie.
SOLID_TYPES = {
    "C3D8": "hex8", "C3D8I": "hex8", "C3D8R": "hex8", "C3D8H": "hex8",
    "C3D8IH": "hex8", "C3D8RH": "hex8",
    "C3D20": "hex20", "C3D20R": "hex20", "C3D20H": "hex20", "C3D20RH": "hex20",
    "C3D27": "hex27",
    "C3D4": "tet4", "C3D4H": "tet4", "C3D10": "tet10", "C3D10M": "tet10", "C3D10H": "tet10",
    "C3D10T": "tet10", "C3D6": "wedge6", "C3D6H": "wedge6", "C3D15": "wedge15", "C3D15H": "wedge15",
    "C3D5": "pyramid5",
}  # fmt: skip

# Nodes of element types that aren't solids; shells and plane elements may name faces.
_FLAT_TYPES = {
    "S3": 3, "S3R": 3, "STRI3": 3, "STRI65": 6, "S4": 4, "S4R": 4, "S6": 6, "S8": 8, "S8R": 8,
    "CPS3": 3, "CPS4": 4, "CPS6": 6, "CPS8": 8, "CPE3": 3, "CPE4": 4, "CPE6": 6, "CPE8": 8,
    "CPS4R": 4, "CPS8R": 8, "CPE4R": 4, "CPE8R": 8, "CAX3": 3, "CAX4": 4, "CAX6": 6, "CAX8": 8,
    "CAX8R": 8, "M3D3": 3, "M3D4": 4, "M3D6": 6, "M3D8": 8, "SFM3D3": 3, "SFM3D4": 4,
}  # fmt: skip
_LINE_TYPES = {
    "T3D2": 2, "T3D3": 3, "B31": 2, "B31R": 2, "B32": 3, "B32R": 3, "B31H": 2, "B32H": 3, "D": 3,
    "SPRING1": 1, "SPRING2": 2, "SPRINGA": 2, "DASHPOT1": 1, "DASHPOT2": 2, "DASHPOTA": 2,
    "CONN3D2": 2, "GAPUNI": 2, "MASS": 1, "ROTARYI": 1, "DCOUP3D": 1, "R3D3": 3, "R3D4": 4,
}  # fmt: skip

ABAQUS_NODES = {
    **{name: CELL_TYPES[kind].nodes for name, kind in SOLID_TYPES.items()},
    **_FLAT_TYPES,
    **_LINE_TYPES,
}
"""Number of nodes of every element type that can be read."""


_ELGEN = "the master element, and three times a count, an increment of nodes and one of elements"


@dataclass(frozen=True, eq=False)
class ElementBlock:
    """One card's elements: labels (M,), node labels (M,k), the type as written, the card, and the
    name of their element set ("": none). ``offset`` is what an instance adds to the file's numbers.
    """

    type: str
    labels: Long
    nodes: Long
    card: Card
    name: str
    offset: int = 0

    def where(self, position: int) -> str:
        """File, line, keyword and number of the element at ``position``."""
        label = int(self.labels[position]) - self.offset
        line = next((k for k, row in self.card.rows() if row[0] == str(label)), None)
        return f"{self.card.where(line)}: element {label}"


def read_elements(cards: Sequence[Card]) -> tuple[list[ElementBlock], list[tuple[str, Long]]]:
    """Blocks of *ELEMENT and *ELGEN in their order, and (name, labels) of the sets they name.

    Raises InputError with file and line.
    """
    blocks: list[ElementBlock] = []
    sets: list[tuple[str, Long]] = []
    generated = 0
    for card in cards:
        name = card.parameters.get("ELSET", "")
        if card.keyword == "ELEMENT":
            blocks.append(_elements(card))
            sets += [(name, blocks[-1].labels)] if name else []
        elif card.keyword == "ELGEN":
            for where, row in card.records(2, 10, _ELGEN, counted=True):
                master, block = _generated(card, where, row, blocks)
                generated += len(block.labels)
                if generated > MAX_GENERATED:
                    raise InputError(
                        f"{where}: would make {generated} elements; expected at most "
                        f"{MAX_GENERATED}"
                    )
                blocks.append(block)
                sets += [(name, np.append(block.labels, master))] if name else []
    return blocks, sets


def _elements(card: Card) -> ElementBlock:
    written = card.parameters.get("TYPE", "").upper()
    width = ABAQUS_NODES.get(written, 0)
    if not width:
        card.fail(
            f"element type; got TYPE={written or '(none)'}; expected one of "
            f"{', '.join(SOLID_TYPES)}{nearest(written, list(SOLID_TYPES))}"
        )
    tokens: list[str] = []
    starts: list[int] = []  # position in tokens at which each line starts
    for text in card.lines:
        starts.append(len(tokens))
        stripped = text.rstrip().rstrip(",")
        tokens.extend(stripped.split(","))
    flat = numbers_at_once(tokens, np.int64)
    if flat is None:
        for k, row in card.rows():
            for field in row:
                whole(field, card.where(k))
        card.fail("element data; expected whole numbers")
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
    name = card.parameters.get("ELSET", "")
    return ElementBlock(written, table[:, 0], table[:, 1:], card, name)


def _generated(
    card: Card, where: str, row: list[str], blocks: Sequence[ElementBlock]
) -> tuple[int, ElementBlock]:
    """*ELGEN: master element; count and increments of nodes and elements in a row, over rows, over
    layers. Returns the master and the new elements."""
    values = [whole(text or "0", where) for text in row]
    values += [0] * (10 - len(values))
    # what is left out is 1 in the first row; further counts are 1, their increments 0
    counts = [values[1], values[4] or 1, values[7] or 1]
    node_steps = [values[2] or 1, values[5], values[8]]
    steps = [values[3] or 1, values[6], values[9]]
    far = max(abs(one) for one in (*steps, *node_steps)) * max(counts)
    total = counts[0] * counts[1] * counts[2]
    if min(counts) < 1 or total > MAX_GENERATED or far >= 2**53:
        raise InputError(
            f"{where}: got counts {counts}; expected counts >= 1 and at most {MAX_GENERATED} "
            "elements"
        )
    master = next((block for block in blocks if values[0] in block.labels), None)
    if master is None:
        raise InputError(
            f"{where}: element {values[0]} isn't there yet; expected it above this line"
        )
    at = np.indices(counts).reshape(3, -1).T[1:]
    nodes = master.nodes[master.labels == values[0]][0]
    return values[0], ElementBlock(
        master.type,
        values[0] + at @ np.array(steps),
        nodes + (at @ np.array(node_steps))[:, None],
        card,
        card.parameters.get("ELSET", ""),
    )
