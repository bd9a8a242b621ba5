"""Meshes from Abaqus and CalculiX input files."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpusim.arrays.array_types import Long
from gpusim.errors import InputError
from gpusim.mesh.file_content.cell_blocks import (
    in_numbers_of_file,
    index_of,
    match_faces,
    padded,
    side_pairs,
)
from gpusim.mesh.file_content.numbering import ABAQUS_SIDES, middles_in_order
from gpusim.mesh.formats.abaqus.assembly import read_content
from gpusim.mesh.formats.abaqus.cards import Source, read_cards
from gpusim.mesh.formats.abaqus.content import InpContent
from gpusim.mesh.formats.abaqus.elements import SOLID_TYPES, ElementBlock
from gpusim.mesh.formats.abaqus.keywords import check_mesh_cards
from gpusim.mesh.mesh import Mesh
from gpusim.validation import require


@dataclass(frozen=True, eq=False)
class LabelledMesh:
    """A mesh and the numbers that its file gives to nodes and elements.

    ``node_labels`` (N,) and ``cell_labels`` (M,) follow the mesh's own order.
    """

    mesh: Mesh
    node_labels: Long
    cell_labels: Long

    def cell_index(self, labels: Long) -> Long:
        """Global cell numbers of element labels; labels that aren't solids are left out."""
        cells = index_of(self.cell_labels, labels)
        return cells[cells >= 0]

    def face_pairs(self, labelled: Long) -> Long:
        """(K,2) pairs (cell, local face) of (element label, Abaqus face 1…6) pairs."""
        cells = index_of(self.cell_labels, labelled[:, 0])
        solid = cells >= 0
        labels, side = labelled[solid, 0], labelled[solid, 1] - 1
        return side_pairs(self.mesh, cells[solid], side, ABAQUS_SIDES, labels, "face")


def read_inp(source: Source) -> Mesh:
    """The solid mesh of an Abaqus or CalculiX input file.

    Node sets, element sets (as cell sets) and element surfaces (as face sets) keep their names,
    spelled as at their first definition; those of one of several instances are ``INSTANCE.NAME``.
    An element set of shell or plane elements that lie on faces of solids is a face set.
    Nodes are ordered by their number in the file, cells by type and then in file order. Loads,
    materials and steps are read by ``gpusim.deck.load_deck``.

    Raises InputError with file and line: not a text file, no solid elements, an unknown element
    type or keyword, a keyword that moves or makes nodes and isn't read, undefined nodes or sets,
    an element with missing nodes, a number that isn't one.
    """
    cards = read_cards(source)
    check_mesh_cards(cards)
    return label_mesh(read_content(cards), cards[0].file).mesh


def label_mesh(content: InpContent, path: str) -> LabelledMesh:
    """The mesh of what a file says, with the file's numbers. Raises InputError."""
    parts: dict[str, list[ElementBlock]] = {}
    flat: list[ElementBlock] = []
    for block in content.blocks:
        if block.type in SOLID_TYPES and len(block.labels):
            parts.setdefault(SOLID_TYPES[block.type], []).append(block)
        elif len(block.labels):
            flat.append(block)
    kinds = ", ".join(sorted({block.type for block in flat})) or "no elements"
    expected = f"one of {', '.join(SOLID_TYPES)}"
    require(bool(parts), f"{path}: no solid elements", kinds, expected)
    cells = {
        kind: np.concatenate([_node_rows(block, content) for block in blocks])
        for kind, blocks in parts.items()
    }
    solid = [block for blocks in parts.values() for block in blocks]
    labels = np.concatenate([block.labels for block in solid])
    try:
        if "hex27" in cells:
            cells["hex27"] = middles_in_order(content.points, cells["hex27"])
        plain = LabelledMesh(Mesh(content.points, cells), content.node_labels, labels)
    except InputError as error:
        text = in_numbers_of_file(str(error), lambda cell: _shown(cell, solid))
        raise InputError(f"{path}: {text}") from None
    node_sets = {
        name: np.searchsorted(content.node_labels, members).astype(np.int32)
        for name, members in content.node_sets.items()
    }
    cell_sets = {
        name: np.sort(plain.cell_index(members)).astype(np.int32)
        for name, members in content.cell_sets.items()
    }
    face_sets = {
        name: plain.face_pairs(pairs).astype(np.int32) for name, pairs in content.surfaces.items()
    }
    flat_labels, flat_faces = _flat_faces(plain.mesh, flat, content)
    for name, members in content.cell_sets.items():
        pairs = np.unique(flat_faces[np.isin(flat_labels, members)], axis=0).astype(np.int32)
        if len(pairs):
            known = face_sets.get(name, np.zeros((0, 2), dtype=np.int32))
            face_sets[name] = np.concatenate([known, pairs])
    # a set of shells only is no set of cells
    solid_sets = {
        name: members
        for name, members in cell_sets.items()
        if len(members) or name not in face_sets
    }
    mesh = plain.mesh.with_sets(node_sets, face_sets, solid_sets)
    return LabelledMesh(mesh, content.node_labels, labels)


def _shown(cell: int, blocks: list[ElementBlock]) -> str:
    """File, line and number of the element behind a cell number; cells follow the blocks."""
    ends = np.cumsum([len(block.labels) for block in blocks])
    place = int(np.searchsorted(ends, cell, side="right"))
    return blocks[place].where(cell - int(ends[place]) + len(blocks[place].labels))


def _node_rows(block: ElementBlock, content: InpContent) -> Long:
    width = block.nodes.shape[1]
    ordered = np.sort(block.nodes, axis=1)
    twice = np.flatnonzero((ordered[:, 1:] == ordered[:, :-1]).any(axis=1))
    if twice.size and block.type in SOLID_TYPES:
        row, first = ordered[twice[0]], int(twice[0])
        node = row[1:][row[1:] == row[:-1]][0] - block.offset
        raise InputError(
            f"{block.where(first)}: got node {node} twice; expected {width} different nodes"
        )
    nodes = content.nodes.positions(block.nodes.ravel(), lambda k: block.where(k // width))
    return nodes.reshape(-1, width)


def _flat_faces(mesh: Mesh, flat: list[ElementBlock], content: InpContent) -> tuple[Long, Long]:
    """(K,) labels of the flat elements that lie on faces of solids, and (K,2) those faces, as
    pairs (cell, local face)."""
    wide = [block for block in flat if block.nodes.shape[1] >= 3]
    if not wide:
        return np.zeros(0, dtype=np.int64), np.zeros((0, 2), dtype=np.int64)
    corners = [
        padded(_node_rows(block, content)[:, : 3 if block.nodes.shape[1] in (3, 6) else 4])
        for block in wide
    ]
    pairs, found = match_faces(mesh, np.concatenate(corners))
    return np.concatenate([block.labels for block in wide])[found], pairs[found]
