"""K u of quadratic tetrahedra, no K formed: twin and driver of
``shaders/fem/device/tet_forces.wgsl``; and the choice between them and rows of blocks.

A straight element's forces are written once and read once, 240 bytes; its share of the blocks of
an assembled K are 40, 3 kB. Curved elements differ by three more sets of gradients.
"""

from __future__ import annotations

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.fem.assembly.assembly import Assembled
from gpusim.fem.device.block_texels import block_texels_bytes, rows_of_matrix
from gpusim.fem.device.node_texels import Allocator, Pair, pair
from gpusim.fem.device.stiffness import DeviceStiffness
from gpusim.fem.device.tet_elements import TetElements, TetTexels, tet_elements, tet_texels_bytes
from gpusim.fem.elements.element import ELEMENTS
from gpusim.fem.sparse.block_rows import BlockRows, block_matrix
from gpusim.gpu import Bindings, Kernel, Recording


def element_forces(elements: TetElements, u: Float) -> Float:
    """(M,10,3) forces of each element in NumPy float64, ``u`` (N,3), by quadrature."""
    gradient = ELEMENTS["tet10"].rule("full").gradient
    nodes = u[elements.cells]
    derivative = np.einsum("qak,mai->mqki", gradient, nodes - nodes[:, :1])
    straight = np.repeat(elements.straight[:, None], len(gradient), axis=1)
    roots = np.concatenate([straight, elements.curved])
    stress = np.einsum("mqki,mqkj->mqij", derivative, roots)
    swelling = elements.ratio[:, None] * np.einsum("mqii->mq", stress)
    stress = stress + stress.transpose(0, 1, 3, 2)
    stress += swelling[:, :, None, None] * np.eye(3)
    back = np.einsum("mqij,mqkj->mqki", stress, roots)
    return np.asarray(np.einsum("qak,mqki->mai", gradient, back))


def apply_tets(elements: TetElements, u: Float) -> Float:
    """K u for ``u`` (L,N,3) -> (L,N,3)."""
    result = np.zeros_like(u)
    nodes = elements.cells.ravel()
    for case, into in enumerate(result):
        forces = element_forces(elements, u[case]).reshape(-1, 3)
        for axis in range(3):
            into[:, axis] = np.bincount(nodes, forces[:, axis], minlength=len(into))
    return result


class DeviceTets:
    """K on the device, divided by ``scale``, as ``DeviceStiffness``; others may share ``texels``.

    Load cases take turns: their forces use the same memory.
    """

    def __init__(
        self, device: Allocator, elements: TetElements, nodes: int, scale: float, cases: int
    ) -> None:
        self.device, self.cases, self.nodes = device, cases, nodes
        self.texels = TetTexels(device, elements, nodes, scale, "fem.tets")
        self._bound: dict[tuple[int, int], list[tuple[Kernel, Bindings, int]]] = {}

    def vector(self, u: Float, *, rounded: bool = False) -> Pair:
        """Float64 values (L,N,3) in the form that ``record`` takes and, not ``rounded``, gives."""
        result = pair(self.device, len(u), self.nodes, "fem.tets.u", rounded=rounded)
        result.write(u)
        return result

    def record(self, recording: Recording, u: Pair, result: Pair) -> None:
        """Record result = K u, (L,N,3) values; ``result`` not rounded."""
        key = (id(u.high), id(result.high))
        if key not in self._bound:
            self._bound[key] = [
                step for case in range(self.cases) for step in self._steps(u, result, case)
            ]
        for kernel, bindings, threads in self._bound[key]:
            recording.dispatch(kernel, bindings, threads=(threads,))

    def _steps(self, u: Pair, result: Pair, case: int) -> list[tuple[Kernel, Bindings, int]]:
        texels = self.texels
        base = case * (self.nodes + 1)
        steps = []
        constants = {"rounded": float(u.rounded)}
        for entry, first, count in texels.parts:
            kernel = self.device.kernel("fem/device/tet_forces", entry=entry, constants=constants)
            bindings = kernel.bind(
                cells=texels.cells, roots=texels.roots, u_high=u.high, u_low=u.second,
                forces_out=texels.forces, params={"first": first, "count": count, "base": base},
            )  # fmt: skip
            steps.append((kernel, bindings, count))
        kernel = self.device.kernel("fem/device/tet_forces", entry="sums", constants=constants)
        bindings = kernel.bind(
            info=texels.info, lists=texels.lists, forces=texels.forces, k_high=result.high,
            k_low=result.second, params={"first": 0, "count": self.nodes, "base": base},
        )  # fmt: skip
        return [*steps, (kernel, bindings, self.nodes)]


DeviceOperator = DeviceStiffness | DeviceTets


def device_tets(device: Allocator, assembled: Assembled) -> TetElements | None:
    """The elements, where the device should multiply by them: tet10 of isotropic materials that
    don't repeat. Their matrices are ten times their geometry."""
    nodes = assembled.rows.node_count
    elements = tet_elements(assembled.groups)
    fits = elements is not None and TetTexels.fits(device, elements, nodes)
    return elements if fits else None


def operator_bytes(assembled: Assembled, elements: TetElements | None) -> int:
    """Bytes on a device; never less."""
    rows = assembled.rows
    if elements is not None:
        return tet_texels_bytes(elements, rows.node_count)
    # with a diagonal, where rows need one
    more = 0 if assembled.groups else 1
    return block_texels_bytes(rows.degree + more, np.diff(rows.table_start) + more, exact=True)


def _in_differences(assembled: Assembled) -> BlockRows:
    """Rows that may be multiplied by differences: where they aren't a sum of elements they needn't
    add up to zero."""
    rows = assembled.rows
    return rows if assembled.groups else rows_of_matrix(block_matrix(rows))


def upload_operator(
    device: Allocator,
    assembled: Assembled,
    elements: TetElements | None,
    scale: float,
    cases: int,
) -> DeviceOperator:
    """K / ``scale`` for ``cases`` load cases; ``elements`` of ``device_tets``."""
    if elements is None:
        return DeviceStiffness(device, _in_differences(assembled), scale, cases)
    return DeviceTets(device, elements, assembled.rows.node_count, scale, cases)
