"""Distinct block rows as texels, for kernels that take one node per thread.

Rows are padded to whole fours of neighbours with the node itself, whose difference is zero. Per
node one ``info`` texel: first texel of its neighbours, number of fours, first texel of its blocks,
the node. ``neighbour`` holds four nodes a texel; the blocks of four neighbours are nine texels,
block by block and column by column. Nodes with equal rows share their blocks.

Where every node has a row of its own, eight rows of about the same length are a slice (sliced ELL:
Monakov, Lokhmotov & Avetisyan, HiPEAC 2010): its texels are stored by place in the row first and by
row last, so that one load of eight threads is 128 bytes in a row, and a row's next texel is
``stride`` further. Where each thread went through a row of its own, waiting for memory took two
fifths of the time.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
import numpy.typing as npt
from scipy.sparse import bsr_matrix

from gpusim.arrays.array_types import Float, Long, Single
from gpusim.arrays.ragged import batches
from gpusim.arrays.unique import mix
from gpusim.fem.device.node_texels import Allocator
from gpusim.fem.sparse.block_rows import BlockRows, ranges
from gpusim.gpu.texture_array import Texels, most_texels
from gpusim.parallel.threads import ahead

SLICE = 8
# nodes are sorted by the length of their rows within as many of them
WINDOW = 2048
# texels of blocks that are put together at a time: large pieces of new memory are slow to touch
_CHUNK = 1 << 18
# texels of four blocks
_FOUR = 9
# rows that are compared at a time
_ROWS = 4096


@dataclass(frozen=True, eq=False)
class RowSlices:
    """``nodes`` eight after the other, the longest row of eight first; ``fours`` of neighbours of
    each; ``head`` those of each slice's first node, ``start`` the sum of the slices before."""

    nodes: Long
    fours: Long
    head: Long
    start: Long

    @staticmethod
    def of(degree: Long) -> RowSlices:
        """Slices of all nodes, which have ``degree`` (N,) neighbours."""
        fours = -(-degree // 4)
        # windows are whole slices
        nodes = np.lexsort((-fours, np.arange(len(degree)) // WINDOW))
        return _sliced(nodes, fours[nodes])

    def parts(self, most: int) -> list[RowSlices]:
        """Slices that take at most ``most`` texels of blocks together."""
        return [self._some(part) for part in batches(_FOUR * SLICE * self.head, most)]

    def _some(self, slices: slice) -> RowSlices:
        part = slice(SLICE * slices.start, SLICE * slices.stop)
        return _sliced(self.nodes[part], self.fours[part])

    @property
    def list_texels(self) -> int:
        return SLICE * int(self.head.sum())

    @property
    def block_texels(self) -> int:
        return _FOUR * self.list_texels

    def info(self) -> npt.NDArray[np.uint32]:
        """(n,4): first texel of its neighbours, fours of them, first texel of its blocks, node."""
        lane = np.arange(len(self.nodes)) % SLICE
        start = SLICE * np.repeat(self.start, SLICE)[: len(self.nodes)]
        columns = [start + lane, self.fours, _FOUR * start + lane, self.nodes]
        return np.stack(columns, axis=1).astype(np.uint32)

    def neighbours(self, rows: BlockRows) -> npt.NDArray[np.uint32]:
        """(t,4) neighbours; rows are filled up with the node itself."""
        degree = rows.degree[self.nodes]
        listed = np.repeat(self.nodes.astype(np.uint32), 4 * self.fours)
        into = ranges(4 * (np.cumsum(self.fours) - self.fours), degree)
        listed[into] = rows.neighbour[ranges(rows.start[self.nodes], degree)]
        result = np.zeros((self.list_texels // SLICE, SLICE, 4), dtype=np.uint32)
        result[self._places()] = listed.reshape(-1, 4)
        return result.reshape(-1, 4)

    def blocks(
        self, rows: BlockRows, scale: float, exact: bool
    ) -> Iterator[tuple[int, list[Single]]]:
        """(first texel, (t,4) texels) one after the other: blocks over ``scale`` by columns, as
        float32 and, if ``exact``, what that leaves of them."""
        parts = list(batches(self.head, _CHUNK // (_FOUR * SLICE)))
        return ahead(partial(self._halves, rows, scale, exact), parts)

    def _halves(
        self, rows: BlockRows, scale: float, exact: bool, part: slice
    ) -> tuple[int, list[Single]]:
        slices = self._some(part)
        classes = rows.row_class[slices.nodes]
        degree = rows.table_start[classes + 1] - rows.table_start[classes]
        source = ranges(rows.table_start[classes], degree)
        low, high = (int(source.min()), int(source.max()) + 1) if len(source) else (0, 0)
        blocks = rows.table[low:high].reshape(-1, 9)
        blocks = blocks if scale == 1.0 else blocks / scale
        # the block behind the last one is zero, and fills rows up
        listed = np.full(4 * int(slices.fours.sum()), high - low)
        listed[ranges(4 * (np.cumsum(slices.fours) - slices.fours), degree)] = source - low
        places = np.full((slices.list_texels // SLICE, SLICE, 4), high - low)
        places[slices._places()] = listed.reshape(-1, 4)
        halves = [blocks.astype(np.float32)]
        if exact:
            halves.append((blocks - halves[0]).astype(np.float32))
        texels = [_interleaved(half, places) for half in halves]
        return _FOUR * SLICE * int(self.start[part.start]), texels

    def _places(self) -> tuple[Long, Long]:
        """Four within the slices' sum, and lane, of each four of each node."""
        lane = np.arange(len(self.nodes)) % SLICE
        start = np.repeat(self.start, SLICE)[: len(self.nodes)]
        return ranges(start, self.fours), np.repeat(lane, self.fours)


def _sliced(nodes: Long, fours: Long) -> RowSlices:
    head = fours[::SLICE]
    return RowSlices(nodes, fours, head, np.cumsum(head) - head)


def _interleaved(blocks: Single, places: Long) -> Single:
    """(t,4) texels of blocks (B,9) at ``places`` (S,8,4): by place in the row, then by row."""
    padded = np.empty((len(blocks) + 1, 9), dtype=np.float32)
    padded[-1] = 0.0
    # by columns; pieces of three numbers would be copied one by one
    for k in range(9):
        padded[:-1, k] = blocks[:, 3 * (k % 3) + k // 3]
    # a texel is moved as one number of 16 bytes
    rows = padded.take(places.ravel(), axis=0).reshape(-1, 4).view(np.complex128)
    turned = rows.reshape(-1, SLICE, _FOUR).transpose(0, 2, 1)
    return np.ascontiguousarray(turned).view(np.float32).reshape(-1, 4)


@dataclass(frozen=True, eq=False)
class RowPart:
    """``count`` nodes whose texels fit one texture each.

    What float32 leaves of ``blocks`` begins at their texel ``low``, if that isn't 0.
    """

    count: int
    info: Texels
    neighbour: Texels
    blocks: Texels
    low: int
    stride: int = 1

    def write(self, numbers: Float, first: int) -> None:
        """Copy (t,4) numbers of blocks in, from texel ``first`` on."""
        high = numbers.astype(np.float32)
        self.blocks.write(high, first)
        if self.low:
            self.blocks.write((numbers - high).astype(np.float32), self.low + first)


class BlockTexels:
    """The rows of a matrix on the device, divided by ``scale``, in one part or several.

    ``exact`` keeps what float32 leaves of the blocks behind them.
    """

    def __init__(
        self,
        device: Allocator,
        rows: BlockRows,
        scale: float,
        label: str,
        *,
        exact: bool,
    ) -> None:
        self.nodes = rows.node_count
        self.parts: tuple[RowPart, ...]
        most = most_texels(device) // (2 if exact else 1)
        if rows.class_count == rows.node_count:
            self.parts = tuple(
                _upload_slices(device, rows, part, scale, label, exact)
                for part in RowSlices.of(rows.degree).parts(most)
            )
            return
        self.parts = tuple(
            _upload(device, rows, part.start, part.stop, scale, label, exact)
            for part in _parts(rows, most)
        )


def block_texels_bytes(degree: Long, class_degree: Long, *, exact: bool) -> int:
    """Bytes that rows take: (N,) neighbours per node and (C,) per distinct row."""
    lists, blocks = int(-(-degree // 4).sum()), _FOUR * int(-(-class_degree // 4).sum())
    if len(class_degree) == len(degree):
        slices = RowSlices.of(degree)
        lists, blocks = slices.list_texels, slices.block_texels
    return (
        Texels.footprint(len(degree))
        + Texels.footprint(lists)
        + Texels.footprint(2 * blocks if exact else blocks)
    )


def rows_of_matrix(matrix: bsr_matrix) -> BlockRows:
    """A matrix with 3x3 blocks as rows that act on differences.

    What a row lacks to a sum of zero, -sum_j A_ij, takes the diagonal block's place, with the
    node behind the last one as neighbour: that one is zero, so the product is that of the matrix.
    Rows of equal blocks are found where there are few kinds.
    """
    count = matrix.shape[0] // 3
    start = matrix.indptr.astype(np.int64)
    row = np.repeat(np.arange(count), np.diff(start))
    on_diagonal = np.flatnonzero(matrix.indices == row)
    assert (row[on_diagonal] == np.flatnonzero(np.diff(start))).all(), "a row has no diagonal"
    first, kind = _equal_rows(matrix.data, start)
    table = matrix.data[ranges(start[first], np.diff(start)[first])]
    table_start = np.concatenate([[0], np.cumsum(np.diff(start)[first])])
    total = np.zeros((len(first), 3, 3))
    filled = np.flatnonzero(np.diff(table_start))
    if filled.size:
        total[filled] = np.add.reduceat(table, table_start[filled])
    diagonal = np.zeros((len(first), 3, 3))
    # place of the diagonal in each distinct row
    here = np.full(count, -1, dtype=np.int64)
    here[row[on_diagonal]] = on_diagonal - start[row[on_diagonal]]
    has = np.flatnonzero(here[first] >= 0)
    at = table_start[has] + here[first[has]]
    diagonal[has] = table[at]
    # K_ij (0 - u_i) with K_ij = -sum is +sum u_i
    table[at] = -total[has]
    neighbour = matrix.indices.astype(np.int32)
    neighbour[on_diagonal] = count
    return BlockRows(
        lambda: (start, neighbour), kind.astype(np.int32), table, table_start, diagonal, 0
    )


def _equal_rows(blocks: Float, start: Long) -> tuple[Long, Long]:
    """First of each kind of equal rows, and the kind of every row."""
    count = len(start) - 1
    everyone = np.arange(count)
    words = blocks.reshape(-1, 9).view(np.int64)
    length = np.diff(start)
    hashes = np.concatenate(
        [_hashes(words, start[begin : begin + _ROWS + 1]) for begin in range(0, count, _ROWS)]
    )
    _, first, kind = np.unique(hashes, return_index=True, return_inverse=True)
    if len(first) > count // 8 or (length[first[kind]] != length).any():
        return everyone, everyone
    # hashes may collide: the blocks decide
    for begin in range(0, count, _ROWS):
        chunk = slice(begin, min(begin + _ROWS, count))
        model = words[ranges(start[first[kind[chunk]]], length[chunk])]
        if not np.array_equal(model, words[start[chunk.start] : start[chunk.stop]]):
            return everyone, everyone
    return first, kind


def _hashes(words: Long, start: Long) -> npt.NDArray[np.uint64]:
    """One number per row of blocks, (B,9) bit patterns."""
    part = words[start[0] : start[-1]]
    edge = start - start[0]
    mixed = mix(ranges(np.zeros(len(edge) - 1, dtype=np.int64), np.diff(edge)), 9)
    for column in range(9):
        mixed = mix(mixed.view(np.int64) ^ part[:, column], column)
    # sums wrap around, as hashes may
    total = np.concatenate([[np.uint64(0)], np.cumsum(mixed, dtype=np.uint64)])
    return np.asarray(total[edge[1:]] - total[edge[:-1]])


def _parts(rows: BlockRows, most: int) -> Iterator[slice]:
    """Ranges of nodes whose neighbours and blocks fit a texture each."""
    fours = -(-rows.degree // 4)
    shared = _FOUR * int(-(-np.diff(rows.table_start) // 4).sum()) <= most
    return batches(fours if shared else _FOUR * fours, most)


def _blocks(device: Allocator, size: int, label: str, exact: bool) -> tuple[Texels, int]:
    """``size`` texels of blocks, twice that if ``exact``, and the first of low halves."""
    both = 2 * size if exact else size
    return device.texels(both, "rgba32float", f"{label}.blocks"), size if exact else 0


def _upload_slices(
    device: Allocator, rows: BlockRows, slices: RowSlices, scale: float, label: str, exact: bool
) -> RowPart:
    part = RowPart(
        len(slices.nodes),
        device.texels(len(slices.nodes), "rgba32uint", f"{label}.info"),
        device.texels(slices.list_texels, "rgba32uint", f"{label}.neighbour"),
        *_blocks(device, slices.block_texels, label, exact),
        SLICE,
    )
    part.info.write(slices.info())
    part.neighbour.write(slices.neighbours(rows))
    for first, halves in slices.blocks(rows, scale, exact):
        for half, start in zip(halves, (0, part.low), strict=False):
            part.blocks.write(half, start + first)
    return part


def _upload(
    device: Allocator,
    rows: BlockRows,
    first: int,
    last: int,
    scale: float,
    label: str,
    exact: bool,
) -> RowPart:
    count = last - first
    # lanes that work together run as long as the longest row among them
    fours = -(-rows.degree[first:last] // 4)
    nodes = first + np.lexsort((-fours, np.arange(count) // WINDOW))
    degree = rows.degree[nodes]
    fours = -(-degree // 4)
    start = np.cumsum(fours) - fours
    neighbour = np.repeat(nodes.astype(np.uint32), 4 * fours)
    neighbour[ranges(4 * start, degree)] = rows.neighbour[ranges(rows.start[nodes], degree)]
    used, local = np.unique(rows.row_class[nodes].astype(np.int64), return_inverse=True)
    class_fours = -(-(rows.table_start[used + 1] - rows.table_start[used]) // 4)
    class_start = _FOUR * (np.cumsum(class_fours) - class_fours)
    info = np.zeros((count, 4), dtype=np.uint32)
    info[:, 0], info[:, 1], info[:, 2] = start, fours, class_start[local]
    info[:, 3] = nodes
    size = _FOUR * int(class_fours.sum())
    listed = device.texels(len(neighbour) // 4, "rgba32uint", f"{label}.neighbour")
    part = RowPart(
        count,
        device.texels(count, "rgba32uint", f"{label}.info"),
        listed,
        *_blocks(device, size, label, exact),
    )
    part.info.write(info)
    listed.write(neighbour.reshape(-1, 4))
    _write_blocks(part, rows, used, class_start, scale)
    return part


def _write_blocks(
    part: RowPart, rows: BlockRows, used: Long, class_start: Long, scale: float
) -> None:
    texels = np.diff(np.append(class_start, part.low or part.blocks.count))
    for piece in batches(texels, _CHUNK):
        classes, first = used[piece], class_start[piece.start]
        degree = rows.table_start[classes + 1] - rows.table_start[classes]
        blocks = np.zeros((int(texels[piece].sum()) // _FOUR * 4, 3, 3))
        # four blocks are nine texels
        at = ranges((class_start[piece] - first) // _FOUR * 4, degree)
        source = ranges(rows.table_start[classes], degree)
        blocks[at] = rows.table[source].transpose(0, 2, 1)
        blocks /= scale
        part.write(blocks.reshape(-1, 4), int(first))
