"""Four nodes in a row that share their blocks: what a lattice's numbering allows.

Where neighbours are numbered one after the other, along with the node itself, four successive
nodes with equal rows read six values instead of twelve for each three neighbours, and the blocks
once instead of four times. A row is kept as runs of three blocks for three successive nodes; the
first lies ``offset`` from the row's own node.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.fem.assembly.block_rows import BlockRows, ranges

__all__ = ["Packs", "find_packs"]

Float = npt.NDArray[np.float64]
Bool = npt.NDArray[np.bool_]
Long = npt.NDArray[np.int64]

_WIDTH = 4
_RUN = 3
# texels of a run, and of what a row lacks to a sum of zero
_RUN_TEXELS = 7
_REST_TEXELS = 3
# rows of their own beyond this share of nodes, or this many distinct rows, and packs don't pay
_MOST_ODD = 0.05
_MOST_CLASSES = 4096
# runs and the number of the row share a word
_MOST_RUNS = 256
_CHUNK = 8192
# offsets are kept as float32
_FARTHEST = 1 << 24


@dataclass(frozen=True, eq=False)
class Packs:
    """``info`` (P,4) uint32: first node, nodes (1 to 4), first texel of its row, and runs + 256
    times the number of the row; ``example`` (K,) a node with each row.

    ``table`` (T,4) float64: per row three texels with the columns of what it lacks to a sum of
    zero, then seven per run: three blocks column by column, and the offset.
    """

    info: npt.NDArray[np.uint32]
    example: Long
    table: Float


def find_packs(rows: BlockRows, free: Bool, scale: float) -> Packs | None:
    """The rows as packs, blocks divided by ``scale``; None where single nodes are cheaper.

    Nodes with the same row are all fixed alike (``free`` (N,3)).

    The node behind the last one stands for one that doesn't move, as in ``rows_of_matrix``.
    """
    count = rows.node_count
    if rows.class_count > min(_MOST_CLASSES, max(count // 4, 1)):
        return None
    _, first, kind = np.unique(
        8 * rows.row_class.astype(np.int64) + free @ np.array([1, 2, 4]),
        return_index=True,
        return_inverse=True,
    )
    odd = _odd_nodes(rows, first[kind])
    if len(odd) > _MOST_ODD * count:
        return None
    kind[odd] = len(first) + np.arange(len(odd))
    node_of_kind = np.concatenate([first, odd])
    cut = np.concatenate([[True], kind[1:] != kind[:-1]])
    start = np.flatnonzero(cut)
    place = np.arange(count) - np.repeat(start, np.diff(np.append(start, count)))
    begin = np.flatnonzero(place % _WIDTH == 0)
    size = np.diff(np.append(begin, count))
    pieces, where, runs, total = [], [], [], 0
    for node in node_of_kind:
        row = _row(rows, int(node), scale)
        if row is None:
            return None
        pieces.append(row)
        where.append(total)
        runs.append((len(row) - _REST_TEXELS) // _RUN_TEXELS)
        total += len(row)
    at, length = np.array(where), np.array(runs)
    loads = (len(begin) + (13 * length[kind[begin]]).sum()) * 1.0
    if loads > (1 + 3.5 * rows.degree).sum():
        return None
    if length.max() >= _MOST_RUNS:
        return None
    number = kind[begin]
    info = np.stack([begin, size, at[number], length[number] + _MOST_RUNS * number], axis=1)
    return Packs(info.astype(np.uint32), node_of_kind, np.concatenate(pieces))


def _odd_nodes(rows: BlockRows, example: Long) -> Long:
    """Nodes whose neighbours lie elsewhere than those of their ``example`` (N,)."""
    count = rows.node_count
    found = []
    # piece by piece: large arrays of new memory are slow to touch
    for begin in range(0, count, _CHUNK):
        own = np.arange(begin, min(begin + _CHUNK, count))
        degree = rows.degree[own]
        like = example[own]
        other = rows.degree[like] != degree
        assert not other.any(), "equal rows have as many neighbours"
        part = slice(int(rows.start[begin]), int(rows.start[own[-1] + 1]))
        mine, theirs = rows.neighbour[part], rows.neighbour[ranges(rows.start[like], degree)]
        shift = np.repeat((own - like).astype(np.int32), degree)
        # the node behind the last one is no neighbour that moves along
        same = (mine == theirs + shift) & (mine != count) & (theirs != count)
        same |= (mine == count) & (theirs == count)
        total = np.concatenate([[0], np.cumsum(~same, dtype=np.int64)])
        edge = rows.start[begin : own[-1] + 2] - rows.start[begin]
        found.append(own[total[edge[1:]] != total[edge[:-1]]])
    return np.concatenate(found)


def _row(rows: BlockRows, node: int, scale: float) -> Float | None:
    """The texels of one row; None where a neighbour is too far away."""
    part = slice(int(rows.start[node]), int(rows.start[node + 1]))
    number = int(rows.row_class[node])
    blocks = rows.table[rows.table_start[number] : rows.table_start[number + 1]] / scale
    offset = rows.neighbour[part].astype(np.int64) - node
    still = rows.neighbour[part] == rows.node_count
    rest = np.zeros((_REST_TEXELS, 4))
    # K_ij (0 - u_i)
    rest[:, :3] = -blocks[still].sum(axis=0).T
    texels = [rest]
    offset, blocks = offset[~still], blocks[~still]
    if len(offset) and np.abs(offset).max() >= _FARTHEST:
        return None
    order = np.argsort(offset, kind="stable")
    at = 0
    while at < len(order):
        run = np.zeros(4 * _RUN_TEXELS)
        begin = offset[order[at]]
        while at < len(order) and offset[order[at]] < begin + _RUN:
            slot = 9 * int(offset[order[at]] - begin)
            run[slot : slot + 9] = blocks[order[at]].T.ravel()
            at += 1
        run[-1] = begin
        texels.append(run.reshape(-1, 4))
    return np.concatenate(texels)
