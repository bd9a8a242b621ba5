"""The stiffness operator y = K u: NumPy twin and kernel driver of ``shaders/fem/stiffness.wgsl``.

K is held as distinct block rows (see ``block_rows``). On the device nodes are put in packs: four
nodes with the same row where rows repeat (their reads of the table are shared), one node
otherwise. Neighbours are stored in slices of 8 packs; the table row after row where rows repeat,
else in slices of 8 rows. Everything is float64 or double-single, never float32.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.fem.arena import Allocator
from gpusim.fem.block_rows import BlockRows
from gpusim.gpu import Bindings, Device, Recording, compare, twin_check
from gpusim.gpu.buffer import Buffer, RealBuffer

__all__ = ["DeviceStiffness", "apply_stiffness"]

Float = npt.NDArray[np.float64]
Long = npt.NDArray[np.int64]

SLICE = 8


def apply_stiffness(rows: BlockRows, u: Float, chunk: int = 65536) -> Float:
    """K u in NumPy float64: ``u`` (L,N,3) -> (L,N,3)."""
    result = np.empty_like(u)
    for first in range(0, rows.node_count, chunk):
        last = min(first + chunk, rows.node_count)
        degree = rows.degree[first:last]
        width = int(degree.max(initial=0))
        slots = np.arange(width)
        at = rows.start[first:last, None] + slots
        own = np.arange(first, last)
        # past the end of a row: the node itself, whose difference is zero
        valid = slots < degree[:, None]
        neighbour = np.where(
            valid, rows.neighbour[np.minimum(at, len(rows.neighbour) - 1)], own[:, None]
        )
        blocks = rows.table[rows.row_class[first:last], :width]
        left = blocks.transpose(0, 2, 1, 3).reshape(len(own), 3, 3 * width)
        difference = u[:, neighbour] - u[:, own, None]
        right = difference.reshape(len(u), len(own), 3 * width, 1)
        result[:, first:last] = np.matmul(left[None], right)[..., 0]
    return result


@dataclass(frozen=True)
class _Part:
    """Packs whose tables fit one binding each."""

    packs: int
    stride: int
    buffers: dict[str, Buffer]


class DeviceStiffness:
    """K on the device, divided by ``scale``.

    Large unstructured models are split into parts that each fit the binding limit.
    """

    def __init__(self, device: Allocator, rows: BlockRows, scale: float, cases: int) -> None:
        self.device, self.cases, self.nodes = device, cases, rows.node_count
        nodes, self.width = _packs(rows)
        self._kernel = device.kernel("fem/stiffness", entry=f"apply{self.width}")
        limit = device.limits["max-storage-buffer-binding-size"]
        self._parts = [
            _upload(device, rows, nodes[first:last], scale)
            for first, last in _ranges(rows, nodes, limit)
        ]
        self._bound: dict[tuple[int, int], list[Bindings]] = {}

    def record(self, recording: Recording, u: RealBuffer, result: RealBuffer) -> None:
        """Record result = K u; both hold (L,N,3) values."""
        key = (id(u), id(result))
        if key not in self._bound:
            self._bound[key] = [
                self._kernel.bind(
                    **part.buffers,
                    u_in=u,
                    k_out=result,
                    params={
                        "packs": part.packs,
                        "nodes": self.nodes,
                        "cases": self.cases,
                        "stride": part.stride,
                    },
                )
                for part in self._parts
            ]
        for part, bindings in zip(self._parts, self._bound[key], strict=True):
            recording.dispatch(self._kernel, bindings, threads=(part.packs * self.cases,))


def _packs(rows: BlockRows) -> tuple[Long, int]:
    """(P,w) node numbers, w = 4 or 1 nodes with equal rows; padding repeats the first node."""
    single = np.arange(rows.node_count)[:, None]
    order = np.argsort(rows.row_class, kind="stable")
    sizes = np.bincount(rows.row_class)
    packs = -(-sizes // 4)
    # reads per neighbour: 9 of the table, then 4 per node
    if 25 * int(packs.sum()) >= 13 * rows.node_count:
        return single, 1
    start = np.cumsum(sizes) - sizes
    group = np.repeat(np.arange(len(sizes)), packs)
    number = np.arange(len(group)) - np.repeat(np.cumsum(packs) - packs, packs)
    local = 4 * number[:, None] + np.arange(4)
    local = np.where(local < sizes[group, None], local, local[:, :1])
    nodes = order[start[group, None] + local]
    # by node, so that neighbouring packs read neighbouring memory
    return nodes[np.argsort(nodes[:, 0], kind="stable")], 4


def _ranges(rows: BlockRows, nodes: Long, limit: int) -> list[tuple[int, int]]:
    """Ranges of packs, multiples of a slice, whose neighbours and table rows fit ``limit``."""
    width = max(1, rows.table.shape[1])
    shared = rows.table.nbytes <= limit // 2
    per_pack = 4 * nodes.shape[1] * width if shared else 72 * width
    count = max(SLICE, (limit - limit // 64) // per_pack // SLICE * SLICE)
    return [(first, min(first + count, len(nodes))) for first in range(0, len(nodes), count)]


def _upload(device: Allocator, rows: BlockRows, nodes: Long, scale: float) -> _Part:
    width = nodes.shape[1]
    degree = rows.degree[nodes[:, 0]]
    slice_start, target, source, size = slice_layout(degree, np.zeros(len(nodes), dtype=np.int64))
    pack = np.repeat(np.arange(len(nodes)), degree)
    neighbour = np.zeros(size * width, dtype=np.uint32)
    # entry (slot, lane of the pack): the width interleaves with the slices of 8
    place = (target // SLICE) * SLICE * width + target % SLICE
    for lane in range(width):
        value = rows.neighbour[rows.start[nodes[pack, lane]] + source]
        neighbour[place + lane * SLICE] = value
    used, local_class = np.unique(rows.row_class[nodes[:, 0]], return_inverse=True)
    class_degree = np.zeros(len(used), dtype=np.int64)
    class_degree[local_class] = degree
    stride = SLICE if width == 1 else 1
    table, start = _table(rows.table[used].reshape(len(used), -1, 9) / scale, class_degree, stride)
    info = np.stack([start[local_class], degree], axis=1).astype(np.uint32)
    return _Part(
        len(nodes),
        stride,
        {
            "slice_start": device.buffer(slice_start * width, label="fem.stiffness.slice_start"),
            "neighbour": device.buffer(neighbour, label="fem.stiffness.neighbour"),
            "node_of_pack": device.buffer(
                nodes.astype(np.uint32), label="fem.stiffness.node_of_pack"
            ),
            "pack_info": device.buffer(info, label="fem.stiffness.pack_info"),
            "table": device.real_buffer(table, label="fem.stiffness.table"),
        },
    )


def _table(blocks: Float, degree: Long, stride: int) -> tuple[Float, Long]:
    """(stored table, start of each row) of (C,D,9) blocks; ``stride`` 8 interleaves 8 rows."""
    row, slot = np.nonzero(np.arange(blocks.shape[1]) < degree[:, None])
    if stride == 1:
        start = 9 * (np.cumsum(degree) - degree)
        return blocks[row, slot].reshape(-1), start
    width = np.maximum.reduceat(degree, np.arange(0, len(degree), SLICE)) * 9
    base = np.concatenate([[0], np.cumsum(width * SLICE)])
    number = np.arange(len(degree))
    start = base[number // SLICE] + number % SLICE
    table = np.zeros(max(int(base[-1]), 1))
    table[start[row, None] + (slot[:, None] * 9 + np.arange(9)) * SLICE] = blocks[row, slot]
    return table, start


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


@twin_check("fem/stiffness")
def _check(device: Device) -> None:
    from gpusim.fem.block_rows import assemble
    from gpusim.fem.material import Isotropic
    from gpusim.fem.model import Model
    from gpusim.mesh import box

    rng = np.random.default_rng(5)
    regular = box((1.0, 0.4, 0.7), (7, 6, 5))
    # moved nodes: every row is different, and packs hold one node
    irregular = regular.moved(0.02 * rng.random(regular.points.shape))
    for mesh in (regular, irregular):
        shape = mesh.points.shape
        model = Model(mesh, [Isotropic(1.0, 0.3)], fixed=np.zeros(shape, dtype=bool))
        rows = assemble(model, {"hex8": "incompatible"})
        u = rng.normal(size=(2, *shape))
        operator = DeviceStiffness(device, rows, 1.0, 2)
        source = device.real_buffer(u, label="fem.check.u")
        result = device.real_buffer(np.zeros_like(u), label="fem.check.ku")
        with device.recording("fem.check") as recording:
            operator.record(recording, source, result)
        what = f"fem/stiffness.apply{operator.width}"
        compare(what, result.read(), apply_stiffness(rows, u), atol=1e-11, rtol=1e-11)
