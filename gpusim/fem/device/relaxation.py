"""Smoothing on the device in float32: twin and driver of ``shaders/fem/device/relaxation.wgsl``.

Where ``smoothers`` works on float64 numbers in buffers and blocks of any size, this takes nodes
with 3x3 blocks as texels, and does product, scaling and update in one dispatch that writes one
vector.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.sparse import bsr_matrix

from gpusim.arrays.array_types import Float
from gpusim.fem.device.block_texels import BlockTexels, block_texels_bytes, rows_of_matrix
from gpusim.fem.device.linear_combination import DeviceSum
from gpusim.fem.device.node_texels import Allocator, Pair, row_threads, vector_texels
from gpusim.fem.device.tet_elements import TetTexels
from gpusim.fem.device.tet_forces_single import SingleForces
from gpusim.fem.multigrid.smoothers import Relaxation
from gpusim.gpu import Bindings, Recording
from gpusim.gpu.texture_array import Texels


def relax_nodes(
    apply: Callable[[Float], Float],
    inverse: Float,
    x: Float,
    before: Float | None,
    b: Float,
    step: Relaxation,
) -> Float:
    """x + keep (x - before) + gain D^-1 (b - A x) for (L,N,3) vectors, in float64.

    The step of ``smoothers.relax`` with its change d = x - before; ``apply`` gives A x, ``inverse``
    (N,3,3), ``before`` None is zero.
    """
    residual = b - apply(x)
    change = x if before is None else x - before
    scaled = np.matmul(inverse, residual[..., None])[..., 0]
    return np.asarray(x + step.keep * change + step.gain * scaled)


class DeviceRelaxation:
    """A matrix and its inverted diagonal blocks (N,3,3), zero on fixed unknowns, on the device."""

    def __init__(
        self,
        device: Allocator,
        texels: BlockTexels | TetTexels,
        inverse: Float,
        cases: int,
        label: str,
    ) -> None:
        self.device, self.cases, self.nodes = device, cases, len(inverse)
        self._texels = texels
        columns = np.zeros((len(inverse), 3, 4), dtype=np.float32)
        columns[:, :, :3] = inverse.transpose(0, 2, 1)
        # whether the unknown is free
        columns[:, :, 3] = np.einsum("nii->ni", inverse) != 0.0
        self._inverse = device.texels(3 * len(inverse), "rgba32float", f"{label}.inverse")
        self._inverse.write(columns.reshape(-1, 4))
        self._bound: dict[object, list[tuple[Bindings, int]]] = {}

    def vector(self, label: str) -> Texels:
        """A vector of zeros, one texel per node."""
        return vector_texels(self.device, self.cases, self.nodes, label)

    def begin(self, recording: Recording, b: Texels, out: Texels, gain: float) -> None:
        """Record out = gain D^-1 b."""
        self._dispatch(recording, "begin", (0.0, 0.0, gain), b_in=b, x_out=out)

    def relax(
        self,
        recording: Recording,
        x: Texels,
        before: Texels | None,
        b: Texels,
        step: Relaxation,
        out: Texels,
    ) -> None:
        """Record what ``relax_nodes`` does; ``out`` must be none of the others."""
        lag = 0.0 if before is None else step.keep
        self._dispatch(
            recording, "relax", (step.keep, lag, step.gain),
            x_in=x, before_in=x if before is None else before, b_in=b, x_out=out,
        )  # fmt: skip

    def residual(self, recording: Recording, x: Texels, b: Texels, out: Texels) -> None:
        """Record out = b - A x, zero on fixed unknowns."""
        self._dispatch(recording, "residual", (0.0, 0.0, 0.0), x_in=x, b_in=b, x_out=out)

    def _dispatch(
        self,
        recording: Recording,
        entry: str,
        factors: tuple[float, float, float],
        **vectors: Texels,
    ) -> None:
        entry = self._entry(entry)
        kernel = self.device.kernel("fem/device/relaxation", entry=entry)
        key = (entry, factors, *(id(one) for one in vectors.values()))
        if key not in self._bound:
            steps = dict(zip(("keep", "lag", "gain"), factors, strict=True))
            given: dict[str, object] = {**vectors, "inverse": self._inverse}
            self._bound[key] = [
                (kernel.bind_used(**given, **part, params={"nodes": self.nodes, **sizes, **steps}),
                 row_threads(sizes["count"], sizes["cases"]))
                for part, sizes in self._parts()
            ]  # fmt: skip
        for number, (bindings, threads) in enumerate(self._bound[key]):
            if "x_in" in vectors:
                self._multiply(recording, vectors["x_in"], number)
            recording.dispatch(kernel, bindings, threads=(threads,))

    def _entry(self, step: str) -> str:
        """The kernel's entry for a step."""
        return step

    def _parts(self) -> list[tuple[dict[str, Texels], dict[str, int]]]:
        """The matrix and the sizes of each dispatch."""
        assert isinstance(self._texels, BlockTexels)
        return [
            (
                {"info": part.info, "neighbour": part.neighbour, "blocks": part.blocks},
                {"count": part.count, "cases": self.cases, "base": 0, "stride": part.stride},
            )
            for part in self._texels.parts
        ]

    def _multiply(self, recording: Recording, x: Texels, number: int) -> None:
        """Record what a dispatch takes of A x."""


class TetRelaxation(DeviceRelaxation):
    """The same for elements on the device: A x are sums of their forces, a load case at a time."""

    def __init__(
        self, device: Allocator, texels: TetTexels, inverse: Float, cases: int, label: str
    ) -> None:
        super().__init__(device, texels, inverse, cases, label)
        self._forces = SingleForces(device, texels)

    def _entry(self, step: str) -> str:
        return step if step == "begin" else f"{step}_forces"

    def _parts(self) -> list[tuple[dict[str, Texels], dict[str, int]]]:
        texels = self._forces.texels
        matrix = {"info": texels.info, "lists": texels.lists, "forces": texels.forces}
        sizes = {"count": self.nodes, "cases": 1, "stride": 1}
        bases = [case * (self.nodes + 1) for case in range(self.cases)]
        return [(matrix, {**sizes, "base": base}) for base in bases]

    def _multiply(self, recording: Recording, x: Texels, number: int) -> None:
        self._forces.record(recording, x, number)


class ColumnRelaxation:
    """Steps with an ``inverse`` whose blocks lie anywhere, in 3x3 (``columns``), in place of D^-1;
    ``relaxation`` is that of the matrix, ``own`` (N,3,3) zero on fixed unknowns.

    A product with the inverse is what the residual's kernel subtracts from zero.
    """

    def __init__(
        self,
        device: Allocator,
        relaxation: DeviceRelaxation,
        inverse: bsr_matrix,
        node_inverse: Float,
        cases: int,
        label: str,
    ) -> None:
        label = f"{label}.columns"
        free = np.einsum("nii->ni", node_inverse) != 0.0
        texels = BlockTexels(device, rows_of_matrix(inverse), 1.0, label, exact=False)
        self._matrix = relaxation
        self._inverse = DeviceRelaxation(device, texels, free[:, :, None] * np.eye(3), cases, label)
        self._sum = DeviceSum(device, len(node_inverse), cases)
        self._left, self._scaled, self._zero, self._spare = (self.vector(label) for _ in range(4))

    def vector(self, label: str) -> Texels:
        """A vector of zeros, one texel per node."""
        return self._matrix.vector(label)

    def begin(self, recording: Recording, b: Texels, out: Texels, gain: float) -> None:
        """Record out = gain D^-1 b."""
        self._inverse.residual(recording, b, self._zero, self._scaled)
        self._add(recording, out, product=(-gain, self._scaled))

    def relax(
        self,
        recording: Recording,
        x: Texels,
        before: Texels | None,
        b: Texels,
        step: Relaxation,
        out: Texels,
    ) -> None:
        """Record out = x + keep (x - before) + gain D^-1 (b - A x); ``before`` None is zero."""
        self.residual(recording, x, b, self._left)
        self._inverse.residual(recording, self._left, self._zero, self._scaled)
        terms = {"x": (1.0 + step.keep, x), "product": (-step.gain, self._scaled)}
        if before is not None:
            terms["before"] = (-step.keep, before)
        self._add(recording, out, **terms)

    def residual(self, recording: Recording, x: Texels, b: Texels, out: Texels) -> None:
        """Record out = b - A x, zero on fixed unknowns."""
        self._matrix.residual(recording, x, b, out)

    def _add(self, recording: Recording, out: Texels, **terms: tuple[float, Texels]) -> None:
        pairs = {name: (factor, Pair(one, self._zero)) for name, (factor, one) in terms.items()}
        self._sum.record(recording, Pair(out, self._spare), **pairs)


def column_bytes(inverse: bsr_matrix) -> int:
    """Bytes that ``ColumnRelaxation`` takes beside four vectors; never less."""
    degree = np.diff(inverse.indptr).astype(np.int64)
    return block_texels_bytes(degree, degree, exact=False) + Texels.footprint(3 * len(degree))


def relaxation(
    device: Allocator, texels: BlockTexels | TetTexels, inverse: Float, cases: int, label: str
) -> DeviceRelaxation:
    """The smoother of a matrix as it is held on the device."""
    if isinstance(texels, TetTexels):
        return TetRelaxation(device, texels, inverse, cases, label)
    return DeviceRelaxation(device, texels, inverse, cases, label)
