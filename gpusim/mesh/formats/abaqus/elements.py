"""Elements of an Abaqus or CalculiX file: given and generated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.mesh.formats.abaqus.cards import Card, nearest
from gpusim.mesh.formats.abaqus.element_types import NODES, SOLID_TYPES
from gpusim.mesh.formats.abaqus.nodes import MAX_GENERATED
from gpusim.mesh.formats.abaqus.values import is_plain, whole

__all__ = ["ElementBlock", "read_elements"]

Int = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class ElementBlock:
    """One card's elements: labels (M,), node labels (M,k), the type as written, the card, and the
    name of their element set ("": none). ``offset`` is what an instance adds to the file's numbers.
    """

    type: str
    labels: Int
    nodes: Int
    card: Card
    name: str
    offset: int = 0

    def where(self, position: int) -> str:
        """File, line, keyword and number of the element at ``position``."""
        label = int(self.labels[position]) - self.offset
        line = next((k for k, row in self.card.rows() if row[0] == str(label)), None)
        return f"{self.card.where(line)}: element {label}"


def read_elements(cards: Sequence[Card]) -> tuple[list[ElementBlock], list[tuple[str, Int]]]:
    """Blocks of *ELEMENT and *ELGEN in their order, and (name, labels) of the sets they name.

    Raises InputError with file and line.
    """
    blocks: list[ElementBlock] = []
    sets: list[tuple[str, Int]] = []
    generated = 0
    for card in cards:
        name = card.parameters.get("ELSET", "")
        if card.keyword == "ELEMENT":
            blocks.append(_elements(card))
            sets += [(name, blocks[-1].labels)] if name else []
        elif card.keyword == "ELGEN":
            for line, row in card.rows():
                where = card.where(line)
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
        flat = np.array(tokens if is_plain("".join(card.lines)) else ["?"], dtype=np.int64)
    except (ValueError, OverflowError):
        for k, row in card.rows():
            for field in row:
                whole(field, card.where(k))
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
    name = card.parameters.get("ELSET", "")
    return ElementBlock(written, table[:, 0], table[:, 1:], card, name)


def _generated(
    card: Card, where: str, row: list[str], blocks: Sequence[ElementBlock]
) -> tuple[int, ElementBlock]:
    """*ELGEN: master element; count and increments of nodes and elements in a row, over rows, over
    layers. Returns the master and the new elements."""
    values = [whole(text or "0", where) for text in row]
    if not 2 <= len(values) <= 10:
        raise InputError(
            f"{where}: got {len(row)} fields; expected the master element, and three times a "
            "count, an increment of nodes and one of elements"
        )
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
