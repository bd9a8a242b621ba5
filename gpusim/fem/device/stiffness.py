"""The stiffness operator y = K u: NumPy twin and kernel driver of
``shaders/fem/device/stiffness.wgsl``.

K is held as distinct block rows (see ``block_rows``), on the device as texels (``block_texels``).
K is a sum of two float32 there, 48 bits, and so is u, unless it is rounded; the arithmetic is
float64 or double-single.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
import numpy.typing as npt
from scipy.sparse import bsr_matrix

from gpusim.fem.assembly.block_rows import BlockRows, ranges
from gpusim.fem.assembly.matrix_product import shared
from gpusim.fem.device.arena import Allocator
from gpusim.fem.device.block_product import RowsOnDevice
from gpusim.fem.device.block_texels import BlockTexels
from gpusim.fem.device.node_texels import Pair, pair

__all__ = ["DeviceStiffness", "apply_stiffness"]

Float = npt.NDArray[np.float64]
Long = npt.NDArray[np.int64]

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
    left = blocks.transpose(1, 0, 2).reshape(3, -1)
    if absolute:
        left = np.abs(left)
        np.abs(difference, out=difference)
    for case, into in enumerate(result):
        into[nodes] = difference[:, :, case].reshape(len(nodes), -1) @ left.T


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
    own = np.arange(high - low), rows.start[first : last + 1] - low
    matrix = bsr_matrix((blocks, *own), shape=(3 * (last - first), 3 * int(high - low)))
    result[first:last] = (matrix @ difference.ravel()).reshape(-1, 3)


class DeviceStiffness(RowsOnDevice):
    """K on the device, divided by ``scale``; ``texels`` are its blocks, which others may share."""

    def __init__(self, device: Allocator, rows: BlockRows, scale: float, cases: int) -> None:
        self.nodes = rows.node_count
        texels = BlockTexels(device, rows, scale, "fem.stiffness", exact=True)
        super().__init__(device, texels, self.nodes, cases, plain=False)

    def vector(self, u: Float, *, rounded: bool = False) -> Pair:
        """Float64 values (L,N,3) in the form that ``record`` takes and, not ``rounded``, gives."""
        result = pair(self.device, len(u), self.nodes, "fem.stiffness.u", rounded=rounded)
        result.write(u)
        return result
