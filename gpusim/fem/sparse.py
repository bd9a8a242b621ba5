"""Sparse matrix times vectors: NumPy twin and kernel driver of ``shaders/fem/sparse.wgsl``.

3x3 blocks, in slices of 8 block rows: block k of row i at ``slice_start[i//8] + 8k + i%8``, its
nine entries 8 apart. Used for transfer operators, coarse matrices (whose six unknowns per
aggregate are two block rows) and the dense inverse on the coarsest level.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from scipy.sparse import bsr_matrix, csc_matrix, csr_matrix

from gpusim.fem.arena import Allocator
from gpusim.gpu import Bindings, Device, Recording, compare, twin_check
from gpusim.gpu.buffer import Buffer, RealBuffer

__all__ = ["DeviceSparse", "apply_sparse"]

Float = npt.NDArray[np.float64]
Long = npt.NDArray[np.int64]

SLICE = 8


def apply_sparse(matrix: csr_matrix | csc_matrix, x: Float) -> Float:
    """A x for (L,n) rows of x: (L,m)."""
    return np.asarray((matrix @ x.T).T)


@dataclass(frozen=True)
class _Part:
    first: int
    rows: int
    buffers: dict[str, Buffer]


class DeviceSparse:
    """A sparse matrix on the device, split by rows where it exceeds the binding limit.

    Both dimensions must be multiples of 3.
    """

    def __init__(self, device: Allocator, matrix: csr_matrix, cases: int, label: str) -> None:
        self.device, self.cases = device, cases
        blocks = matrix.tobsr((3, 3))
        blocks.sort_indices()
        self.height, self.width = (int(n) // 3 for n in matrix.shape)
        self._kernel = device.kernel("fem/sparse", entry="apply")
        limit = device.limits["max-storage-buffer-binding-size"]
        self._parts = [
            _upload(device, blocks, first, last, label) for first, last in _ranges(blocks, limit)
        ]
        self._bound: dict[tuple[int, int, bool], list[Bindings]] = {}

    def record(self, recording: Recording, x: RealBuffer, y: RealBuffer, add: bool = False) -> None:
        """Record y = A x, or y += A x."""
        key = (id(x), id(y), add)
        if key not in self._bound:
            self._bound[key] = [
                self._kernel.bind(
                    **part.buffers,
                    factor=x,
                    product=y,
                    params={
                        "first": part.first, "rows": part.rows, "height": self.height,
                        "width": self.width, "cases": self.cases, "add": int(add),
                    },
                )
                for part in self._parts
            ]  # fmt: skip
        for part, bindings in zip(self._parts, self._bound[key], strict=True):
            recording.dispatch(self._kernel, bindings, threads=(part.rows * self.cases,))


def _ranges(matrix: bsr_matrix, limit: int) -> list[tuple[int, int]]:
    length = np.diff(matrix.indptr).astype(np.int64)
    rows = len(length)
    full = np.zeros(-(-rows // SLICE) * SLICE, dtype=np.int64)
    full[:rows] = length
    # bytes of each slice, padding included, as values take them
    total = np.cumsum(full.reshape(-1, SLICE).max(axis=1) * SLICE * 72)
    cuts = [0]
    while cuts[-1] < len(total):
        before = int(total[cuts[-1] - 1]) if cuts[-1] else 0
        end = int(np.searchsorted(total, before + limit, side="right"))
        cuts.append(max(end, cuts[-1] + 1))
    return [(a * SLICE, min(b * SLICE, rows)) for a, b in pairwise(cuts)]


def _upload(device: Allocator, matrix: bsr_matrix, first: int, last: int, label: str) -> _Part:
    start = matrix.indptr[first:last].astype(np.int64)
    length = np.diff(matrix.indptr[first : last + 1]).astype(np.int64)
    slice_start, target, source, size = slice_layout(length, start)
    column = np.zeros(size, dtype=np.uint32)
    column[target] = matrix.indices[source]
    value = np.zeros(9 * size)
    place = 9 * (target // SLICE) * SLICE + target % SLICE
    value[place[:, None] + SLICE * np.arange(9)] = matrix.data[source].reshape(-1, 9)
    return _Part(
        first,
        last - first,
        {
            "slice_start": device.buffer(slice_start, label=f"{label}.slice_start"),
            "row_length": device.buffer(length.astype(np.uint32), label=f"{label}.row_length"),
            "column": device.buffer(column, label=f"{label}.column"),
            "value": device.real_buffer(value, label=f"{label}.value"),
        },
    )


def slice_layout(length: Long, start: Long) -> tuple[npt.NDArray[np.uint32], Long, Long, int]:
    """Rows of different length in slices of 8: entry k of row i at slice_start[i//8] + 8k + i%8.

    Returns (slice_start, target positions, source positions, stored size), entries row by row.
    """
    rows = len(length)
    width = np.maximum.reduceat(length, np.arange(0, rows, SLICE))
    base = np.concatenate([[0], np.cumsum(width * SLICE)])
    row = np.repeat(np.arange(rows), length)
    slot = np.arange(len(row)) - np.repeat(np.cumsum(length) - length, length)
    target = base[row // SLICE] + slot * SLICE + row % SLICE
    return base[:-1].astype(np.uint32), target, start[row] + slot, max(int(base[-1]), 1)


@twin_check("fem/sparse")
def _check(device: Device) -> None:
    rng = np.random.default_rng(6)
    dense = rng.normal(size=(36, 24)) * (rng.random((36, 24)) < 0.3)
    matrix = csr_matrix(dense)
    x, y = rng.normal(size=(2, 24)), rng.normal(size=(2, 36))
    source = device.real_buffer(x, label="fem.check.x")
    result = device.real_buffer(y, label="fem.check.y")
    with device.recording("fem.check") as recording:
        DeviceSparse(device, matrix, 2, "fem.check").record(recording, source, result, add=True)
    compare("fem/sparse.apply", result.read(), y + apply_sparse(matrix, x), atol=1e-12, rtol=1e-12)
