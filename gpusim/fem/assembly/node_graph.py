"""Pairs of nodes that share an element, and numbers in which they lie close together in memory.

The graph is the pattern of a matrix, and tells where its blocks add up. Sorting and adding are done
by SciPy's own kernels (``matrix_product``): a matrix transposed is a stable counting sort, a matrix
of ones times rows of nine numbers adds blocks up in the order of elements.

Mesh generators number corners before midsides, surfaces before the inside: the entries of a
vector that one row of the matrix meets are then all over it. Along a space-filling curve they lie
together, and a product with 660,000 unknowns takes a fifth of the time (``Numbering``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.sparse import csr_matrix

from gpusim.arrays.array_types import Bool, Float, Int, Long
from gpusim.arrays.unique import mix, unique_hashes
from gpusim.arrays.z_order import z_order
from gpusim.fem.assembly.element_batches import Elements, Group, portions, repeating
from gpusim.fem.model.model import Model
from gpusim.fem.model.solution import Solution
from gpusim.fem.sparse.block_rows import BlockRows, ranges
from gpusim.fem.sparse.matrix_product import add_rows, counting_sort, transpose_pattern
from gpusim.mesh import Mesh
from gpusim.parallel.threads import ahead, shared

# edges that are mirrored at a time
_MIRRORED = 1 << 14
# entry ij of a block where its transpose has ji
_TRANSPOSED = np.array([0, 3, 6, 1, 4, 7, 2, 5, 8])
# nodes whose vectors fit the nearest cache in any order
_FEW = 10_000
# node numbers may be this many times as far apart in a cell as in a well numbered cube
_FAR = 4.0


class NodeGraph:
    """Edges between ``count`` nodes, each from its lesser node, sorted; pairs are the edges of one
    element, by pair (a,b) of its nodes and then by element. ``start`` (N+1,) int64 and
    ``neighbour`` int32: every edge from either end, neighbours ascending.

    It knows ``cells`` (M,k) kind by kind and no matrices: it is made once, and filled with any
    groups of the same cells as often as their matrices change."""

    def __init__(self, cells: Sequence[Int], count: int) -> None:
        self.count, self._cells = count, cells
        self._sizes = [one.shape[1] * (one.shape[1] - 1) // 2 for one in cells]
        row, column, pair = self._sorted_pairs()
        new = np.empty(len(pair), dtype=bool)
        new[:1] = True
        np.not_equal(column[1:], column[:-1], out=new[1:])
        # rows without pairs begin where the next one does, or behind the last pair
        new[row[:-1][row[:-1] < len(pair)]] = True
        number = np.cumsum(new, dtype=np.int32)
        self._edge_of_pair = np.empty(len(pair), dtype=np.int32)
        self._edge_of_pair[pair] = number - 1
        del pair
        first = np.concatenate([[np.int32(0)], number])[row]
        self._edges = int(first[-1])
        high = column[new]
        low = np.repeat(np.arange(count, dtype=np.int32), np.diff(first))
        count_below = np.bincount(high, minlength=count)
        count_above = np.diff(first)
        self.start = np.concatenate([[0], np.cumsum(count_below + count_above)]).astype(np.int64)
        # the same edges by their greater nodes
        _, lower, below = counting_sort(high, low, count)
        at_below = ranges(self.start[:-1], count_below)
        self.neighbour = np.empty(int(self.start[-1]), dtype=np.int32)
        self.neighbour[at_below] = lower
        # where the blocks of an edge stand, the row of its lesser node first
        self._above = ranges(self.start[:-1] + count_below, count_above).astype(np.int32)
        self._below = np.empty(self._edges, dtype=np.int32)
        self._below[below] = at_below
        self.neighbour[self._above] = high

    def _ends(self) -> tuple[Int, Int]:
        """Lesser and greater node of every pair."""
        length = sum(
            size * len(cells) for size, cells in zip(self._sizes, self._cells, strict=True)
        )
        low, high = (np.empty(length, dtype=np.int32) for _ in range(2))
        at = 0
        for cells in self._cells:
            columns = np.ascontiguousarray(cells.T)
            for a, b in zip(*np.triu_indices(len(columns), 1), strict=True):
                part = slice(at, at + len(cells))
                np.minimum(columns[a], columns[b], out=low[part])
                np.maximum(columns[a], columns[b], out=high[part])
                at = part.stop
        return low, high

    def _sorted_pairs(self) -> tuple[Int, Int, Int]:
        """Pairs sorted by low, then by high: where each low begins, high and the pairs'
        positions."""
        low, high = self._ends()
        start, column, position = counting_sort(high, low, self.count)
        del low, high
        return transpose_pattern(start, column, position)

    def _pair_numbers(self) -> list[Int]:
        """(pairs, elements) edge of every pair, per group."""
        ends = np.cumsum(
            [size * len(cells) for size, cells in zip(self._sizes, self._cells, strict=True)]
        )
        return [
            part.reshape(size, -1)
            for part, size in zip(np.split(self._edge_of_pair, ends[:-1]), self._sizes, strict=True)
        ]

    def fill(self, groups: Sequence[Elements]) -> BlockRows:
        """Block rows of the elements' matrices, each node's of its own kind.

        Elements are formed some hundred at a time, on all processors, and added in their order."""
        every = np.arange(self.count)
        return self.rows(groups, every, every)

    def rows(self, groups: Sequence[Elements], representative: Long, row_class: Long) -> BlockRows:
        """Block rows of which those of the nodes ``representative`` (C,) are formed; ``row_class``
        (N,) tells whose a node has."""
        degree = np.diff(self.start)[representative]
        table_start = np.concatenate([[0], np.cumsum(degree)]).astype(np.int64)
        table = self.blocks(groups, None if len(representative) == self.count else representative)
        diagonal = -row_sums(table_start, table)
        # the pattern alone: where blocks came from isn't asked again
        links = self.start, self.neighbour
        return BlockRows(
            lambda: links, row_class.astype(np.int32), table, table_start,
            0.5 * (diagonal + diagonal.transpose(0, 2, 1)), sum(one.distinct for one in groups),
        )  # fmt: skip

    def blocks(self, groups: Sequence[Elements], nodes: Long | None) -> Float:
        """(T,3,3) blocks of the rows of ``nodes`` (None: all), summed over elements. K_ij and K_ji
        are transposes to the last bit."""
        if nodes is None:
            result = np.zeros((2 * self._edges, 9))
            self._add(groups, result, self._above, None)
            self._mirror(result, self._above, self._below)
            return result.reshape(-1, 3, 3)
        at = ranges(self.start[nodes], np.diff(self.start)[nodes])
        edge_of, mirrored = self._ends_of_rows()
        used, number = np.unique(edge_of[at], return_inverse=True)
        # what isn't wanted goes to one more row
        place = np.full(self._edges, len(used), dtype=np.int32)
        place[used] = np.arange(len(used), dtype=np.int32)
        value = np.zeros((len(used) + 1, 9))
        wanted = np.zeros(self.count, dtype=bool)
        wanted[nodes] = True
        self._add(groups, value, place, wanted)
        result = value[number]
        turned = mirrored[at]
        result[turned] = result[turned][:, _TRANSPOSED]
        return result.reshape(-1, 3, 3)

    def with_diagonal(self, groups: Sequence[Elements]) -> tuple[Long, Int, Float]:
        """(start, column, blocks) of the matrix with the diagonal blocks that elements give, which
        come first in each row."""
        start = self.start + np.arange(self.count + 1)
        # blocks stand behind the diagonal ones of their row and of the rows before
        nodes = np.arange(1, self.count + 1, dtype=np.int32)
        shift = np.repeat(nodes, np.diff(self.start))
        above, below = (one + shift[one] for one in (self._above, self._below))
        result = np.zeros((int(start[-1]), 9))
        self._add(groups, result, above, None, start[:-1].astype(np.int32))
        self._mirror(result, above, below)
        column = np.empty(len(result), dtype=np.int32)
        column[start[:-1]] = np.arange(self.count)
        column[np.arange(2 * self._edges) + shift] = self.neighbour
        return start, column, result.reshape(-1, 3, 3)

    def _add(
        self,
        groups: Sequence[Elements],
        table: Float,
        place: Int,
        wanted: Bool | None,
        diagonal_rows: Int | None = None,
    ) -> None:
        """Add the elements' blocks, the lesser node's row, to the rows ``place`` (edges,) of
        ``table`` (T,9), diagonal ones to ``diagonal_rows`` (N,); only elements of ``wanted``
        nodes."""
        for group, edge_of_pair in zip(groups, self._pair_numbers(), strict=True):
            which = np.arange(len(group.cells))
            if wanted is not None:
                which = np.flatnonzero(wanted[group.cells].any(axis=1))
            form = partial(_placed_blocks, group, edge_of_pair, place, diagonal_rows)
            # in the order of elements, whoever forms them: sums don't depend on processors
            for placed in ahead(form, [which[part] for part in portions(len(which))]):
                for at, blocks in placed:
                    add_rows(table, at, blocks)

    def _mirror(self, table: Float, above: Int, below: Int) -> None:
        """Fill the rows of the greater nodes."""

        def fill(first: int) -> None:
            part = slice(first, first + _MIRRORED)
            table[below[part]] = np.take(table[above[part]], _TRANSPOSED, axis=1)

        shared(fill, range(0, self._edges, _MIRRORED))

    def _ends_of_rows(self) -> tuple[Int, Bool]:
        """Edge of every block of the pattern, and whether its row is the greater node's."""
        edge_of = np.empty(2 * self._edges, dtype=np.int32)
        edge_of[self._above] = edge_of[self._below] = np.arange(self._edges, dtype=np.int32)
        mirrored = np.zeros(2 * self._edges, dtype=bool)
        mirrored[self._below] = True
        return edge_of, mirrored

    def equal_rows(self, groups: Sequence[Group]) -> tuple[Long, Long]:
        """First node of each class of equal rows, and the class of every node."""
        slot = ranges(np.zeros(self.count, dtype=np.int64), np.diff(self.start))
        number = _block_numbers(groups)
        edge_of, mirrored = self._ends_of_rows()
        hashes = []
        for seed in (100, 200):
            # sums don't depend on the order of adding; overflow wraps around, as hashes may
            edge = np.zeros(self._edges, dtype=np.uint64)
            np.add.at(edge, self._edge_of_pair, mix(number, seed))
            side = mix(edge[edge_of] + mix(mirrored.astype(np.int64), seed + 3), seed + 4)
            side = mix(side + mix(slot, seed + 1), seed + 2)
            total = np.concatenate([[np.uint64(0)], np.cumsum(side, dtype=np.uint64)])
            hashes.append(total[self.start[1:]] - total[self.start[:-1]])
        return unique_hashes(hashes[0], hashes[1])


def _placed_blocks(
    group: Elements, edge_of_pair: Int, place: Int, diagonal_rows: Int | None, which: Long
) -> list[tuple[Int, Float]]:
    """Blocks of some elements with the rows of the table that they are added to, see ``_add``."""
    cells = group.cells[which]
    a, b = np.triu_indices(cells.shape[1], 1)
    pairs, diagonal = group.blocks(which, diagonal_rows is not None)
    flat = pairs.reshape(-1, 9)
    swapped = np.flatnonzero((cells[:, a] > cells[:, b]).T)
    flat[swapped] = flat[swapped][:, _TRANSPOSED]
    placed = [(place[edge_of_pair[:, which]], flat)]
    if diagonal_rows is not None and diagonal is not None:
        placed.append((diagonal_rows[cells.T], diagonal))
    return placed


def _block_numbers(groups: Sequence[Group]) -> Long:
    """Number of each pair's block among the distinct ones, a mirrored block counted apart."""
    numbers, offset = [], 0
    for group in groups:
        a, b = np.triu_indices(group.cells.shape[1], 1)
        distinct = len(group.matrices) * len(a)
        number = group.matrix_of * len(a) + np.arange(len(a))[:, None]
        number += np.where(group.cells[:, a] > group.cells[:, b], distinct, 0).T
        numbers.append((offset + number).ravel())
        offset += 2 * distinct
    return np.concatenate(numbers)


def row_sums(start: Long, blocks: Float) -> Float:
    """(N,3,3) sums of the blocks (T,3,3) of each row, in their order."""
    one = np.ones(len(blocks))
    shape = (len(start) - 1, len(blocks))
    sums = csr_matrix((one, np.arange(len(blocks), dtype=np.int32), start), shape=shape)
    return np.asarray(sums @ blocks.reshape(-1, 9)).reshape(-1, 3, 3)


class Numbering:
    """Other numbers for the nodes of a model: the k-th is node ``order[k]`` of the model."""

    def __init__(self, order: Long) -> None:
        self.order = order
        self._place = np.empty(len(order), dtype=np.int32)
        self._place[order] = np.arange(len(order), dtype=np.int32)

    @staticmethod
    def of(model: Model) -> Numbering | None:
        """A better numbering; None where the model's is good, or repeats along with its cells."""
        mesh = model.mesh
        if mesh.node_count <= _FEW:
            return None
        # every so many cells tell enough
        reach = [
            np.ptp(cells[:: 1 + len(cells) // _FEW], axis=1).mean() * len(cells)
            for cells in mesh.cells.values()
            if len(cells)
        ]
        good = sum(reach) <= _FAR * mesh.node_count ** (2.0 / 3.0) * mesh.cell_count
        if good or repeating(model):
            return None
        return Numbering(np.argsort(z_order(mesh.points), kind="stable"))

    def renumbered(self, model: Model) -> Model:
        """The same model in the new numbers."""
        mesh = model.mesh
        cells = {kind: self._place[block] for kind, block in mesh.cells.items()}
        assert model.fixed is not None and model.prescribed is not None
        assert model.forces is not None
        points = mesh.points[self.order]
        return Model(
            Mesh.trusted(points, cells),
            model.materials,
            fixed=model.fixed[self.order],
            forces=model.forces[..., self.order, :],
            material_of_cell=model.material_of_cell,
            prescribed=model.prescribed[..., self.order, :],
            loads=[load.renumbered(self._place, points) for load in model.loads],
            temperature=None if model.temperature is None else model.temperature[:, self.order],
            constraints=[one.renumbered(self.order) for one in model.constraints],
        )

    def forward(self, values: Float) -> Float:
        """(…,N,3) nodal values in the new numbers."""
        return values[..., self.order, :]

    def backward(self, values: Float) -> Float:
        """(…,N,3) nodal values in the model's own numbers."""
        return values[..., self._place, :]

    def back(self, solution: Solution) -> Solution:
        """The solution in the model's own numbers."""
        steps = [
            replace(
                step,
                u=self.backward(step.u),
                reactions=self.backward(step.reactions),
                stress=None if step.stress is None else step.stress.renumbered(self.order),
            )
            for step in solution.steps
        ]
        return replace(
            solution,
            u=self.backward(solution.u),
            reactions=self.backward(solution.reactions),
            steps=tuple(steps),
        )
