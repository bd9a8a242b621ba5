"""What mesh files hold before it is a `Mesh`: blocks of any dimension, with named groups.

Readers fill a `RawMesh`; `assemble` turns its solids into cells, its surfaces into face sets, and
its lines and points into node sets.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from gpusim.arrays.array_types import Bool, Float, Int, Long
from gpusim.arrays.unique import distinct
from gpusim.errors import InputError
from gpusim.mesh.boundary import NO_NODE, all_faces, check_range, matched
from gpusim.mesh.cell_types import CELL_TYPES
from gpusim.mesh.file_content.numbering import (
    FLAT_CORNERS,
    REFUSED_SOLIDS,
    Sides,
    dimension_of,
    local_faces,
)
from gpusim.mesh.mesh import Mesh


@dataclass(frozen=True, eq=False)
class RawBlock:
    """Cells of one kind: (M,k) node numbers from 0, in gpusim's order; group name -> rows."""

    kind: str
    nodes: Long
    groups: Mapping[str, Long] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class RawMesh:
    """Points (N,3), blocks in the order of the file, node groups."""

    points: Float
    blocks: tuple[RawBlock, ...]
    node_groups: Mapping[str, Long] = field(default_factory=dict)


def index_of(labels: Long, wanted: Long) -> Long:
    """Place in ``labels`` of each of ``wanted``, -1 where it isn't there."""
    if not len(labels):
        return np.full(wanted.shape, -1, dtype=np.int64)
    if 0 <= labels.min() and labels.max() < 8 * len(labels) + 1000:  # a table is quicker
        table = np.full(int(labels.max()) + 2, -1, dtype=np.int64)
        table[labels] = np.arange(len(labels))
        return table[np.where((wanted < 0) | (wanted >= len(table)), -1, wanted)]
    order = np.argsort(labels, kind="stable")
    known = labels[order]
    place = np.minimum(np.searchsorted(known, wanted), len(known) - 1)
    return np.where(known[place] == wanted, order[place], -1)


def assemble(raw: RawMesh, source: str) -> Mesh:
    """The mesh of a file named ``source``, which every message begins with.

    Cells keep the order of the file, type by type. A group of solids becomes a cell set, one of
    surfaces a face set (of the cell with the least number where two meet), one of lines or points
    a node set; surfaces without any group become the face set "surface". Nodes that no solid has
    are left out.

    Raises
    ------
    InputError
        No solid cells, a solid of unknown type (named with its count), a node number out of range,
        surfaces that are no faces of the solids; and what `Mesh` raises.
    """
    solids = [b for b in raw.blocks if b.kind not in FLAT_CORNERS and len(b.nodes)]
    unknown = [b for b in solids if b.kind not in CELL_TYPES]
    if unknown:
        counts: dict[str, int] = {}
        for block in unknown:
            counts[block.kind] = counts.get(block.kind, 0) + len(block.nodes)
        told = ", ".join(f"{count} cells of type {kind}" for kind, count in counts.items())
        raise InputError(f"{source}: got {told}; expected {', '.join(CELL_TYPES)}{_advice(counts)}")
    if not solids:
        counts = {}
        for block in raw.blocks:
            counts[block.kind] = counts.get(block.kind, 0) + len(block.nodes)
        told = ", ".join(f"{count} {kind}" for kind, count in counts.items() if count)
        raise InputError(
            f"{source}: no solid cells; got {told or 'no cells at all'}; expected some of "
            f"{', '.join(CELL_TYPES)}"
        )
    count = len(raw.points)
    for block in raw.blocks:
        check_range(f"{source}: node of a cell of type {block.kind}", block.nodes, count)
    if not np.isfinite(raw.points).all():
        raise InputError(f"{source}: a coordinate isn't finite; expected numbers")
    used = solid_nodes(raw)
    number = np.cumsum(used) - 1
    cells, cell_sets = _solids(solids, number)
    try:
        mesh = Mesh(raw.points[used], cells)
    except InputError as error:
        raise InputError(f"{source}: {error}") from None
    return mesh.with_sets(
        _node_sets(raw, used, number), _face_sets(mesh, raw, used, number, source), cell_sets
    )


def solid_nodes(raw: RawMesh) -> Bool:
    """(N,) the nodes of the file that belong to solids: those that `assemble` keeps, in order."""
    used = np.zeros(len(raw.points), dtype=bool)
    for block in raw.blocks:
        if block.kind not in FLAT_CORNERS:
            used[block.nodes.ravel()] = True
    return used


def _advice(counts: Mapping[str, int]) -> str:
    if counts.keys() <= REFUSED_SOLIDS.keys():
        return " (without nodes in the faces: Gmsh's Mesh.SecondOrderIncomplete = 1)"
    return ""


def _solids(solids: list[RawBlock], number: Long) -> tuple[dict[str, Int], dict[str, Int]]:
    """Cells by type, and cell sets by global cell number."""
    kinds = list(dict.fromkeys(block.kind for block in solids))
    cells: dict[str, Int] = {}
    sets: dict[str, list[Long]] = {}
    first = 0
    for kind in kinds:
        blocks = [block for block in solids if block.kind == kind]
        for block in blocks:
            for name, rows in block.groups.items():
                sets.setdefault(name, []).append(first + rows)
            first += len(block.nodes)
        cells[kind] = _int32(number[np.concatenate([block.nodes for block in blocks])])
    return cells, {name: _int32(distinct(np.concatenate(parts))) for name, parts in sets.items()}


def _node_sets(raw: RawMesh, used: Bool, number: Long) -> dict[str, Int]:
    parts = {name: [nodes] for name, nodes in raw.node_groups.items()}
    for block in raw.blocks:
        if dimension_of(block.kind) < 2:
            for name, rows in block.groups.items():
                parts.setdefault(name, []).append(block.nodes[rows].ravel())
    sets = {name: distinct(np.concatenate(nodes)) for name, nodes in parts.items()}
    return {name: _int32(number[nodes[used[nodes]]]) for name, nodes in sets.items()}


def _face_sets(mesh: Mesh, raw: RawMesh, used: Bool, number: Long, source: str) -> dict[str, Int]:
    surfaces = [b for b in raw.blocks if dimension_of(b.kind) == 2 and len(b.nodes)]
    if not surfaces:
        return {}
    named = any(block.groups for block in surfaces)
    wanted: list[tuple[str, Long]] = []
    for block in surfaces:
        groups = block.groups if named else {"surface": np.arange(len(block.nodes))}
        corners = padded(block.nodes[:, : FLAT_CORNERS[block.kind]])
        wanted += [(name, corners[rows]) for name, rows in groups.items()]
    if not wanted:
        return {}
    every = np.concatenate([corners for _, corners in wanted])
    loose = ~(used[np.maximum(every, 0)] | (every < 0)).all(axis=1)
    key = np.where(every < 0, -1, number[np.maximum(every, 0)])
    pairs, found = match_faces(mesh, key)
    found &= ~loose
    sets: dict[str, list[Long]] = {}
    start = 0
    for name, corners in wanted:
        here = slice(start, start + len(corners))
        missing = int((~found[here]).sum())
        if missing:
            raise InputError(
                f"{source}: group {name!r}: {missing} of its {len(corners)} surface cells aren't "
                "faces of solid cells; expected a mesh whose surfaces and solids share their nodes"
            )
        sets.setdefault(name, []).append(pairs[here])
        start += len(corners)
    return {name: _int32(np.unique(np.concatenate(parts), axis=0)) for name, parts in sets.items()}


def _int32(numbers: Long) -> Int:
    return numbers.astype(np.int32)


def padded(corners: Long) -> Long:
    """(M,4) with -1 after the third corner of a triangle."""
    if corners.shape[1] == 4:
        return corners
    return np.column_stack([corners, np.full(len(corners), -1, dtype=np.int64)])


def match_faces(mesh: Mesh, wanted: Long) -> tuple[Long, Bool]:
    """(K,2) pairs (cell, local face) of the corners ``wanted`` (K,4), and (K,) which were found."""
    corners, pairs = all_faces(mesh)
    touched = np.zeros(mesh.node_count + 1, dtype=bool)
    touched[wanted] = touched[-1] = True  # the last one stands for the missing corner
    near = np.asarray(touched[np.minimum(corners, mesh.node_count)].all(axis=1))
    near[0] = True  # what isn't found gets this one
    corners, pairs = corners[near], pairs[near]
    every = np.concatenate([np.where(wanted < 0, NO_NODE, wanted).astype(np.int32), corners])
    order, start, count = matched(every, mesh.node_count)
    # of equal ones the first of the mesh, which is that of the least cell
    first = np.minimum.reduceat(np.where(order < len(wanted), len(every), order), start)
    face = np.empty(len(every), dtype=np.int64)
    face[order] = np.repeat(first, count)
    hit = face[: len(wanted)] < len(every)
    face = np.where(hit, face[: len(wanted)], len(wanted))
    # three corners tell a face from those of a mesh, not from others
    hit &= (np.sort(every[face], axis=1) == np.sort(every[: len(wanted)], axis=1)).all(axis=1)
    return pairs[face - len(wanted)].astype(np.int64), hit


def side_pairs(mesh: Mesh, cell: Long, side: Long, order: Sides, labels: Long, where: str) -> Long:
    """(K,2) pairs (cell, local face) of a program's sides (K,), from 0 and in its ``order``.

    Raises InputError for a side that a cell hasn't got; ``labels`` (K,) are the file's numbers of
    the cells.
    """
    local = np.full(len(cell), -1)
    for kind, first, block in mesh.blocks():
        table = local_faces(kind, order)
        mine = (cell >= first) & (cell < first + len(block))
        wrong = np.flatnonzero(mine & ((side < 0) | (side >= len(table))))
        if wrong.size:
            raise InputError(
                f"{where}: element {labels[wrong[0]]} has no face {side[wrong[0]] + 1}; expected "
                f"1 … {len(table)} for {kind}"
            )
        local[mine] = table[side[mine]]
    return np.stack([cell, local], axis=1)


_CELLS = re.compile(r"(?<=got )(?:for example )?(?:faces of )?cells? (\d+(?:(?:, | and )\d+)*)")


def in_numbers_of_file(message: str, named: Callable[[int], str]) -> str:
    """A mesh counts cells from 0: their numbers in what it says are replaced by ``named`` ones.

    Examples
    --------
    >>> in_numbers_of_file("Mesh.cells: 2 inverted cells; got cells 0, 3 (J < 0)", "e{}".format)
    '2 inverted cells; got e0 and e3 (J < 0)'
    """

    def replaced(found: re.Match[str]) -> str:
        return " and ".join(named(int(number)) for number in re.findall(r"\d+", found[1]))

    return _CELLS.sub(replaced, message.replace("Mesh.cells: ", ""))
