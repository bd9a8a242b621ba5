"""Smoothing on the device in float32: twin and driver of ``shaders/fem/relax.wgsl``.

Where ``smooth`` works on float64 numbers in buffers and blocks of any size, this takes nodes with
3x3 blocks as texels, and does product, scaling and update in one dispatch.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.fem.arena import Allocator
from gpusim.fem.block_rows import BlockRows
from gpusim.fem.block_texels import BlockTexels
from gpusim.fem.node_texels import node_texels, read_nodes, vector_texels
from gpusim.fem.smooth import Relaxation
from gpusim.fem.stiffness import apply_stiffness
from gpusim.gpu import Bindings, Device, Kernel, Recording, compare, twin_check
from gpusim.gpu.texels import Texels

__all__ = ["DeviceRelaxation", "relax_nodes"]

Float = npt.NDArray[np.float64]


def relax_nodes(
    rows: BlockRows | None, inverse: Float, v: Float, r: Float, x: Float, step: Relaxation
) -> tuple[Float, Float, Float]:
    """r - A v, d = keep v + gain D^-1 (r - A v), x + d for (L,N,3) vectors, in float64.

    ``rows`` None stands for no product; ``inverse`` (N,3,3).
    """
    left = r if rows is None else r - apply_stiffness(rows, v)
    d = step.keep * v + step.gain * np.matmul(inverse, left[..., None])[..., 0]
    return left, d, x + d


class DeviceRelaxation:
    """A matrix and its inverted diagonal blocks (N,3,3), zero on fixed unknowns, on the device."""

    def __init__(
        self, device: Allocator, texels: BlockTexels | None, inverse: Float, cases: int, label: str
    ) -> None:
        self.device, self.cases, self.nodes = device, cases, len(inverse)
        self._parts = texels.parts if texels is not None else ()
        self._suffix = "4" if texels is not None and texels.packed else ""
        self._inverse = device.texels(3 * self.nodes, "rgba32float", f"{label}.inverse")
        columns = np.zeros((self.nodes, 3, 4), dtype=np.float32)
        columns[:, :, :3] = inverse.transpose(0, 2, 1)
        # whether the unknown is free
        columns[:, :, 3] = np.einsum("nii->ni", inverse) != 0.0
        self._inverse.write(columns.reshape(-1, 4))
        self._bound: dict[object, Bindings] = {}

    def vector(self, label: str) -> Texels:
        """A vector of zeros, one texel per node."""
        return vector_texels(self.device, self.cases, self.nodes, label)

    def begin(self, recording: Recording, r: Texels, d: Texels, gain: float) -> None:
        """Record d = gain D^-1 r."""
        step = Relaxation(0.0, gain, 0.0)
        self._dispatch(recording, "begin", 0, self.nodes, step, r_in=r, d_out=d)

    def relax(
        self,
        recording: Recording,
        v: Texels,
        r: Texels,
        x: Texels,
        step: Relaxation,
        out: tuple[Texels, Texels, Texels],
    ) -> None:
        """Record what ``relax_nodes`` does; ``out`` (r, d, x) must be none of v, r, x."""
        for number, part in enumerate(self._parts):
            self._dispatch(
                recording, f"relax{self._suffix}", part.first, part.count, step, number,
                v_in=v, r_in=r, x_in=x, r_out=out[0], d_out=out[1], x_out=out[2],
            )  # fmt: skip

    def finish(
        self, recording: Recording, v: Texels, r: Texels, x: Texels, step: Relaxation, out: Texels
    ) -> None:
        """Record the x of ``relax_nodes`` alone."""
        for number, part in enumerate(self._parts):
            self._dispatch(
                recording, f"finish{self._suffix}", part.first, part.count, step, number,
                v_in=v, r_in=r, x_in=x, x_out=out,
            )  # fmt: skip

    def residual(self, recording: Recording, v: Texels, r: Texels, out: Texels) -> None:
        """Record out = r - A v, zero on fixed unknowns."""
        none = Relaxation(0.0, 0.0, 0.0)
        for number, part in enumerate(self._parts):
            self._dispatch(
                recording, f"residual{self._suffix}", part.first, part.count, none, number,
                v_in=v, r_in=r, r_out=out,
            )  # fmt: skip

    def _dispatch(
        self,
        recording: Recording,
        entry: str,
        first: int,
        count: int,
        step: Relaxation,
        number: int = 0,
        **vectors: Texels,
    ) -> None:
        kernel: Kernel = self.device.kernel("fem/relax", entry=entry)
        key = (entry, number, step, *(id(one) for one in vectors.values()))
        if key not in self._bound:
            values: dict[str, object] = {
                **vectors,
                "params": {
                    "first": first,
                    "count": count,
                    "nodes": self.nodes,
                    "cases": self.cases,
                    "keep": step.keep,
                    "gain": step.gain,
                },
            }
            if self._parts:
                part = self._parts[number]
                values |= {"info": part.info, "neighbour": part.neighbour, "blocks": part.high}
            values["inverse"] = self._inverse
            needed = kernel.layout.bindings
            self._bound[key] = kernel.bind(**{k: v for k, v in values.items() if k in needed})
        recording.dispatch(kernel, self._bound[key], threads=(count * self.cases,))


@twin_check("fem/relax")
def _check(device: Device) -> None:
    from gpusim.fem.assembly import assemble
    from gpusim.fem.diagonal import invert_blocks
    from gpusim.fem.formulation import resolve_formulation
    from gpusim.fem.material import Isotropic
    from gpusim.fem.model import Model
    from gpusim.mesh import box

    rng = np.random.default_rng(9)
    mesh = box((1.0, 0.4, 0.7), (4, 3, 5))
    model = Model(mesh, [Isotropic(1.0, 0.3)], fixed=np.zeros(mesh.points.shape, dtype=bool))
    rows = assemble(model, resolve_formulation(model, None)).rows
    free = rng.random(mesh.points.shape) < 0.8
    inverse = invert_blocks(rows.diagonal[rows.row_class], free)
    v, r, x = (rng.normal(size=(2, *free.shape)) for _ in range(3))
    step = Relaxation(0.3, 0.7, 1.0)
    texels = BlockTexels(device, rows, 1.0, "fem.check", exact=False)
    smoother = DeviceRelaxation(device, texels, inverse, 2, "fem.check")
    v_in, r_in, x_in, *out = (smoother.vector("fem.check.vector") for _ in range(9))
    for texture, values in ((v_in, v), (r_in, r), (x_in, x)):
        texture.write(node_texels(values))
    with device.recording("fem.check") as recording:
        smoother.relax(recording, v_in, r_in, x_in, step, (out[0], out[1], out[2]))
        smoother.finish(recording, v_in, r_in, x_in, step, out[3])
        smoother.residual(recording, v_in, r_in, out[4])
        smoother.begin(recording, r_in, out[5], 0.7)
    wanted = relax_nodes(rows, inverse, v, r, x, step)
    first = relax_nodes(None, inverse, 0.0 * v, r, x, step)[1]
    pairs = zip(out, (*wanted, wanted[2], np.where(free, wanted[0], 0.0), first), strict=True)
    for texture, value in pairs:
        # float32 sums of about eighty products of numbers of order one
        compare("fem/relax", read_nodes(texture, 2), value, atol=1e-5, rtol=1e-5)
