"""Assembly: from element matrices to block rows, by hashing and sorting whole arrays at a time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import numpy.typing as npt
from scipy.sparse import bsr_matrix

from gpusim.fem.block_rows import BlockRows, ranges
from gpusim.fem.congruence import mix, unique_hashes, unique_rows
from gpusim.fem.groups import Group, lattice_group, model_groups
from gpusim.fem.lattice import CORNERS, Lattice, find_lattice, node_offsets
from gpusim.fem.model import Model
from gpusim.fem.product import pool
from gpusim.fem.stencil import Stencil

__all__ = [
    "Assembled",
    "assemble",
    "assemble_groups",
    "assemble_lattice",
    "group_matrix",
    "lattice_stencil",
    "model_lattice",
]

Float = npt.NDArray[np.float64]
Int = npt.NDArray[np.int32]
Long = npt.NDArray[np.int64]

# equal rows are looked for where element matrices repeat at least this often on average
_REPEATS = 4


@dataclass(frozen=True, eq=False)
class Assembled:
    """A model's block rows, the elements they came from, and their lattice if there is one."""

    rows: BlockRows
    groups: list[Group]
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
        return Assembled(assemble_groups(groups, mesh.node_count), groups, None)
    group = lattice_group(model, lattice, formulation)
    return Assembled(assemble_lattice(group, lattice), [group], lattice)


def assemble_groups(groups: Sequence[Group], count: int) -> BlockRows:
    """Block rows of elements of any kind on ``count`` nodes."""
    edges = _Edges(groups, count)
    classes = sum(len(group.matrices) for group in groups)
    elements = sum(len(group.cells) for group in groups)
    if classes * _REPEATS <= elements:
        representative, row_class = edges.equal_rows()
    else:
        representative = row_class = np.arange(count, dtype=np.int64)
    degree = np.diff(edges.start)[representative]
    table_start = np.concatenate([[0], np.cumsum(degree)])
    wanted = None if len(representative) == count else representative
    table = edges.blocks(wanted)
    owner = np.repeat(np.arange(len(representative)), degree)
    diagonal = -_sums(owner, table.reshape(-1, 9), len(representative)).reshape(-1, 3, 3)
    return BlockRows(
        edges.links, row_class.astype(np.int32), table, table_start,
        0.5 * (diagonal + diagonal.transpose(0, 2, 1)), classes,
    )  # fmt: skip


def group_matrix(groups: Sequence[Group], count: int) -> bsr_matrix:
    """The same as a SciPy block matrix, with the diagonal blocks that the elements give.

    For coarse levels, where fixed unknowns are left out and rows don't add up to zero.
    """
    edges = _Edges(groups, count)
    diagonal = np.zeros((count, 9))
    for group in groups:
        width = group.cells.shape[1]
        own = group.matrices.reshape(-1, width, 3, width, 3)
        for k in range(width):
            values = own[:, k, :, k, :].reshape(-1, 9)[group.kind]
            diagonal += _sums(group.cells[:, k], values, count)
    start = edges.start + np.arange(count + 1)
    data = np.empty((int(start[-1]), 3, 3))
    column = np.empty(len(data), dtype=np.int32)
    data[start[:-1]] = diagonal.reshape(-1, 3, 3)
    column[start[:-1]] = np.arange(count)
    other = np.ones(len(data), dtype=bool)
    other[start[:-1]] = False
    data[other] = edges.blocks(None)
    column[other] = edges.neighbour
    return bsr_matrix((data, column, start), shape=(3 * count, 3 * count))


def _sums(owner: npt.NDArray[np.integer], values: Float, count: int) -> Float:
    """(count,c) sums of the rows of ``values`` (B,c) by owner."""
    result = np.empty((count, values.shape[1]))
    for column in range(values.shape[1]):
        result[:, column] = np.bincount(owner, weights=values[:, column], minlength=count)
    return result


class _Edges:
    """Pairs of nodes that share an element, and which element blocks add up on each.

    Only pairs with the lesser node first are sorted; the others mirror them.
    """

    def __init__(self, groups: Sequence[Group], count: int) -> None:
        self.count, self._groups = count, groups
        keys = []
        for group in groups:
            a, b = np.triu_indices(group.cells.shape[1], 1)
            first, second = group.cells[:, a], group.cells[:, b]
            key = np.minimum(first, second).astype(np.int64)
            key *= count
            key += np.maximum(first, second)
            keys.append(key.ravel())
        key = np.concatenate(keys) if len(keys) > 1 else keys[0]
        order = np.argsort(key)
        ordered = key[order]
        new = np.concatenate([[True], ordered[1:] != ordered[:-1]])
        self._edge_of_pair = np.empty(len(key), dtype=np.int32)
        self._edge_of_pair[order] = np.cumsum(new, dtype=np.int32) - 1
        edge = ordered[new]
        low, high = (edge // count).astype(np.int32), (edge % count).astype(np.int32)
        # the full pattern: each edge once from either end, neighbours ascending
        count_below = np.bincount(high, minlength=count)
        count_above = np.bincount(low, minlength=count)
        self.start = np.concatenate([[0], np.cumsum(count_below + count_above)]).astype(np.int64)
        below = np.argsort(high, kind="stable").astype(np.int32)
        at_below = ranges(self.start[:-1], count_below)
        at_above = ranges(self.start[:-1] + count_below, count_above)
        self.neighbour = np.empty(int(self.start[-1]), dtype=np.int32)
        self.neighbour[at_below] = low[below]
        self.neighbour[at_above] = high
        self._edge = np.empty(int(self.start[-1]), dtype=np.int32)
        self._edge[at_below] = below
        self._edge[at_above] = np.arange(len(edge), dtype=np.int32)
        self._mirrored = np.zeros(int(self.start[-1]), dtype=bool)
        self._mirrored[at_below] = True
        self._edges = len(edge)

    def links(self) -> tuple[Long, Int]:
        """The pattern, see ``BlockRows``."""
        return self.start, self.neighbour

    def blocks(self, nodes: Long | None) -> Float:
        """(T,3,3) blocks of the rows of ``nodes`` (None: all), summed over elements."""
        value = np.empty((self._edges, 3, 3))

        def add(entry: int) -> None:
            i, j = divmod(entry, 3)
            parts = [_pair_entries(group, i, j) for group in self._groups]
            weights = np.concatenate(parts) if len(parts) > 1 else parts[0]
            value[:, i, j] = np.bincount(self._edge_of_pair, weights, self._edges)

        list(pool().map(add, range(9)))
        if nodes is None:
            edge, mirrored = self._edge, self._mirrored
        else:
            at = ranges(self.start[nodes], np.diff(self.start)[nodes])
            edge, mirrored = self._edge[at], self._mirrored[at]
        result = np.empty((len(edge), 3, 3))
        np.take(value, edge, axis=0, out=result, mode="clip")
        for i, j in ((0, 1), (0, 2), (1, 2)):
            upper = result[mirrored, i, j]
            result[mirrored, i, j] = result[mirrored, j, i]
            result[mirrored, j, i] = upper
        return result

    def equal_rows(self) -> tuple[Long, Long]:
        """First node of each class of equal rows, and the class of every node."""
        slot = ranges(np.zeros(self.count, dtype=np.int64), np.diff(self.start))
        number = self._block_numbers()
        hashes = []
        for seed in (100, 200):
            # sums don't depend on the order of adding; overflow wraps around, as hashes may
            edge = np.zeros(self._edges, dtype=np.uint64)
            np.add.at(edge, self._edge_of_pair, mix(number, seed))
            side = mix(edge[self._edge] + mix(self._mirrored.astype(np.int64), seed + 3), seed + 4)
            side = mix(side + mix(slot, seed + 1), seed + 2)
            total = np.concatenate([[np.uint64(0)], np.cumsum(side, dtype=np.uint64)])
            hashes.append(total[self.start[1:]] - total[self.start[:-1]])
        return unique_hashes(hashes[0], hashes[1])

    def _block_numbers(self) -> Long:
        """Number of each pair's block among the distinct ones, a mirrored block counted apart."""
        numbers, offset = [], 0
        for group in self._groups:
            a, b = np.triu_indices(group.cells.shape[1], 1)
            distinct = len(group.matrices) * len(a)
            number = group.kind[:, None] * len(a) + np.arange(len(a))
            number += np.where(group.cells[:, a] > group.cells[:, b], distinct, 0)
            numbers.append((offset + number).ravel())
            offset += 2 * distinct
        return np.concatenate(numbers)


def _pair_entries(group: Group, i: int, j: int) -> Float:
    """Entry (i,j) of the block of each pair of an element's nodes, the lesser node's row."""
    width = group.cells.shape[1]
    a, b = np.triu_indices(width, 1)
    entries = group.matrices.reshape(-1, width, 3, width, 3)[:, :, i, :, j]
    forward, backward = entries[:, a, b], entries[:, b, a]
    if len(group.matrices) != len(group.cells) or (np.diff(group.kind) != 1).any():
        forward, backward = forward[group.kind], backward[group.kind]
    swapped = group.cells[:, a] > group.cells[:, b]
    np.copyto(forward, backward, where=swapped)
    return forward.ravel()


def _lattice_rows(group: Group, lattice: Lattice) -> tuple[Long, Long, Float]:
    """(first node of each class, class of each node, its 27 blocks (C,27,3,3))."""
    around = lattice.around(lattice.grid(group.kind))
    representative, row_class = unique_rows(around)
    blocks = np.zeros((len(representative), 27, 3, 3))
    split = group.matrices.reshape(-1, 8, 3, 8, 3).transpose(0, 1, 3, 2, 4)
    # in lattice order, so that either end of an edge adds its cells up in the same order: K_ij and
    # K_ji^T are equal to the last bit
    for corner in np.lexsort(CORNERS.T).tolist():
        number = around[representative, corner]
        here = np.flatnonzero(number >= 0)
        blocks[here[:, None], node_offsets(corner)] += split[number[here], corner]
    return representative, row_class, blocks


def assemble_lattice(group: Group, lattice: Lattice) -> BlockRows:
    """Block rows of hex8 elements on a lattice: no sorting, and one row per kind of node."""
    representative, row_class, blocks = _lattice_rows(group, lattice)
    own = lattice.linked(representative)
    table = blocks[own]
    diagonal = -np.where(own[..., None, None], blocks, 0.0).sum(axis=1)
    return BlockRows(
        partial(_lattice_links, lattice),
        row_class.astype(np.int32),
        table,
        np.concatenate([[0], np.cumsum(own.sum(axis=1))]).astype(np.int64),
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
