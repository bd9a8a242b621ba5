"""The stiffness operator y = K u on the host, by differences of displacements (see ``block_rows``).

The device's is `gpusim.fem.device.stiffness`.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
from scipy.sparse import bsr_matrix

from gpusim.arrays.array_types import Float, Long
from gpusim.fem.sparse.block_rows import BlockRows, ranges
from gpusim.parallel.threads import shared

# nodes of a task
_CHUNK = 1024


def apply_stiffness(rows: BlockRows, u: Float, absolute: bool = False) -> Float:
    """K u in NumPy float64: ``u`` (L,N,3) -> (L,N,3); with ``absolute`` the sum of the absolute
    values of its terms K_ij (u_j - u_i)."""
    result = np.zeros_like(u)
    count = rows.node_count
    if rows.class_count <= count // 8:
        # all load cases of a node side by side: its neighbours are looked up once
        together = np.ascontiguousarray(u.transpose(1, 0, 2))
        shared(partial(_apply_class, rows, together, result, absolute), list(_by_class(rows)))
    else:
        by_range = [(first, min(first + _CHUNK, count)) for first in range(0, count, _CHUNK)]
        for case in range(len(u)):
            part = partial(_apply_range, rows, u[case], result[case], absolute)
            shared(part, by_range)
    return result


def _by_class(rows: BlockRows) -> Iterator[tuple[int, Long]]:
    """(class, some of its nodes), a chunk at a time."""
    order = np.argsort(rows.row_class, kind="stable")
    end = np.cumsum(np.bincount(rows.row_class, minlength=rows.class_count)).tolist()
    for number, (first, last) in enumerate(zip([0, *end[:-1]], end, strict=True)):
        for start in range(first, last, _CHUNK):
            yield number, order[start : min(start + _CHUNK, last)]


def _apply_class(
    rows: BlockRows, u: Float, result: Float, absolute: bool, task: tuple[int, Long]
) -> None:
    number, nodes = task
    blocks = rows.table[rows.table_start[number] : rows.table_start[number + 1]]
    at = rows.start[nodes][:, None] + np.arange(len(blocks))
    difference = np.take(u, rows.neighbour[at], axis=0)
    difference -= u[nodes, None]
    # (3, neighbours x 3): the row of blocks as one matrix
    row = blocks.transpose(1, 0, 2).reshape(3, -1)
    if absolute:
        row = np.abs(row)
        np.abs(difference, out=difference)
    for case, into in enumerate(result):
        into[nodes] = difference[:, :, case].reshape(len(nodes), -1) @ row.T


def _apply_range(
    rows: BlockRows, u: Float, result: Float, absolute: bool, task: tuple[int, int]
) -> None:
    first, last = task
    low, high = rows.start[first], rows.start[last]
    degree = rows.degree[first:last]
    classes = rows.row_class[first:last]
    difference = np.take(u, rows.neighbour[low:high], axis=0)
    difference -= np.take(u, np.repeat(np.arange(first, last), degree), axis=0)
    if classes[0] + len(classes) - 1 == classes[-1] and rows.class_count == rows.node_count:
        blocks = rows.table[low:high]
    else:
        blocks = rows.table[ranges(rows.table_start[classes], degree)]
    if absolute:
        blocks, difference = np.abs(blocks), np.abs(difference)
    # each difference is the entry of a vector of its own
    columns_and_start = np.arange(high - low), rows.start[first : last + 1] - low
    matrix = bsr_matrix(
        (blocks, *columns_and_start), shape=(3 * (last - first), 3 * int(high - low))
    )
    result[first:last] = (matrix @ difference.ravel()).reshape(-1, 3)
