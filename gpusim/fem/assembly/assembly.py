"""Assembly: from element matrices to block rows, many elements at a time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.sparse import bsr_matrix

from gpusim.arrays.array_types import Float, Int, Long
from gpusim.arrays.unique import unique_rows
from gpusim.fem.assembly.element_batches import (
    Elements,
    Group,
    lattice_group,
    model_groups,
)
from gpusim.fem.assembly.node_graph import NodeGraph
from gpusim.fem.lattice.lattice import CORNERS, Lattice, find_lattice, node_offsets
from gpusim.fem.lattice.stencil import Stencil
from gpusim.fem.model.model import Model
from gpusim.fem.sparse.block_rows import BlockRows
from gpusim.mesh.cell_types import CELL_TYPES

# elements per distinct matrix from which on rows are compared: each is a sum over several elements,
# and where rows repeat less often than about eight times a table of them is only one thing more
_ROWS_REPEAT = 16


@dataclass(frozen=True, eq=False)
class Assembled:
    """A model's block rows, the elements they came from, and their lattice if there is one. Without
    ``groups`` rows aren't a sum of elements (constraints), and needn't add up to zero."""

    rows: BlockRows
    groups: Sequence[Elements]
    lattice: Lattice | None


def model_lattice(model: Model) -> Lattice | None:
    """The lattice of a model's nodes and cells, if it has one."""
    mesh = model.mesh
    if set(mesh.cells) != {"hex8"} or mesh.dangling_nodes.size:
        return None
    return find_lattice(mesh.points, mesh.cells["hex8"])


def assemble(
    model: Model, formulation: Mapping[str, str], lattice: Lattice | None = None
) -> Assembled:
    """Element matrices and block rows of a model, by way of a lattice where its mesh has one
    (``lattice``, if it is known already)."""
    mesh = model.mesh
    lattice = model_lattice(model) if lattice is None else lattice
    if lattice is None:
        groups = model_groups(model, formulation)
        rows = assemble_groups(groups, mesh.node_count)
        for group in groups:
            # levels without midsides are made of them; nothing else is until rounding shows
            if isinstance(group, Group) and not CELL_TYPES[group.name].has_midsides:
                group.forget()
        return Assembled(rows, groups, None)
    group = lattice_group(model, lattice, formulation)
    return Assembled(assemble_lattice(group, lattice), [group], lattice)


def assemble_groups(groups: Sequence[Elements], count: int) -> BlockRows:
    """Block rows of elements of any kind on ``count`` nodes."""
    pattern = NodeGraph([group.cells for group in groups], count)
    classes = sum(group.distinct for group in groups)
    elements = sum(len(group.cells) for group in groups)
    shared = [group for group in groups if isinstance(group, Group)]
    if classes * _ROWS_REPEAT <= elements and len(shared) == len(groups):
        return pattern.rows(shared, *pattern.equal_rows(shared))
    return pattern.fill(groups)


def group_matrix(groups: Sequence[Elements], count: int) -> bsr_matrix:
    """The same as a SciPy block matrix, with the diagonal blocks that the elements give.

    For coarse levels, where fixed unknowns are left out and rows don't add up to zero.
    """
    start, column, data = NodeGraph([group.cells for group in groups], count).with_diagonal(groups)
    return bsr_matrix((data, column, start), shape=(3 * count, 3 * count))


def _lattice_rows(group: Group, lattice: Lattice) -> tuple[Long, Long, Float]:
    """(first node of each class, class of each node, its 27 blocks (C,27,3,3))."""
    around, representative, row_class = _rows_around(lattice.grid(group.matrix_of), lattice)
    blocks = np.zeros((len(representative), 27, 3, 3))
    split = group.matrices.reshape(-1, 8, 3, 8, 3).transpose(0, 1, 3, 2, 4)
    # in lattice order, so that either end of an edge adds its cells up in the same order: K_ij and
    # K_ji^T are equal to the last bit
    for corner in np.lexsort(CORNERS.T).tolist():
        number = around[:, corner]
        here = np.flatnonzero(number >= 0)
        blocks[here[:, None], node_offsets(corner)] += split[number[here], corner]
    return representative, row_class, blocks


def _rows_around(kind: Long, lattice: Lattice) -> tuple[Long, Long, Long]:
    """(cells around the nodes of each class (C,8), its first node, the class of each node).

    ``kind`` (X-1,Y-1,Z-1) of the cells. Of planes of nodes that lie between equal layers of cells
    one is looked at.
    """
    chosen, number = [], []
    for axis in range(3):
        layers = np.moveaxis(kind, axis, 0)
        differs = np.ones(len(layers) + 1, dtype=bool)
        differs[1:-1] = (layers[1:] != layers[:-1]).any(axis=(1, 2))
        new = differs.copy()
        new[1:] |= differs[:-1]
        chosen.append(np.flatnonzero(new))
        number.append(np.cumsum(new) - 1)
    padded = np.pad(kind, 1, constant_values=-1)
    around = np.stack(
        [
            padded[
                np.ix_(*(planes + 1 - step for planes, step in zip(chosen, corner, strict=True)))
            ]
            for corner in CORNERS
        ],
        axis=-1,
    )
    present = (around >= 0).any(axis=-1)
    first, classes = unique_rows(around[present])
    row_class = np.full(present.shape, -1, dtype=np.int64)
    row_class[present] = classes
    of_node = lattice.gathered(row_class[np.ix_(*number)])
    # numbered by their first nodes: where all rows differ, a row's class is its node
    node = np.empty(len(first), dtype=np.int64)
    node[of_node[::-1]] = np.arange(len(of_node))[::-1]
    order = np.argsort(node)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return around[present][first][order], node[order], rank[of_node]


def assemble_lattice(group: Group, lattice: Lattice) -> BlockRows:
    """Block rows of hex8 elements on a lattice: no sorting, and one row per kind of node."""
    representative, row_class, blocks = _lattice_rows(group, lattice)
    linked = lattice.linked(representative)
    table = blocks[linked]
    diagonal = -np.where(linked[..., None, None], blocks, 0.0).sum(axis=1)
    return BlockRows(
        partial(_lattice_links, lattice),
        row_class.astype(np.int32),
        table,
        np.concatenate([[0], np.cumsum(linked.sum(axis=1))]).astype(np.int64),
        0.5 * (diagonal + diagonal.transpose(0, 2, 1)),
        len(group.matrices),
    )


def _lattice_links(lattice: Lattice) -> tuple[Long, Int]:
    linked = lattice.linked(np.arange(lattice.node_count))
    start = np.concatenate([[0], np.cumsum(linked.sum(axis=1))]).astype(np.int64)
    return start, lattice.neighbours()[linked]


def lattice_stencil(group: Group, lattice: Lattice, scale: float = 1.0) -> Stencil:
    """The same over ``scale`` by place on the lattice, with the diagonal blocks that the elements
    give."""
    _, row_class, blocks = _lattice_rows(group, lattice)
    return Stencil(lattice, row_class.astype(np.int32), blocks / scale)
