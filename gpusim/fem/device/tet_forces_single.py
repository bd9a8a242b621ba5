"""The same in float32, for smoothing: twin and driver of
``shaders/fem/device/tet_forces_single.wgsl``."""

from __future__ import annotations

from gpusim.fem.device.node_texels import Allocator
from gpusim.fem.device.tet_elements import TetTexels
from gpusim.gpu import Bindings, Kernel, Recording
from gpusim.gpu.texture_array import Texels


class SingleForces:
    """Forces of the elements of ``texels`` in float32, which ``relaxation.wgsl`` sums up."""

    def __init__(self, device: Allocator, texels: TetTexels) -> None:
        self.device, self.texels = device, texels
        self._bound: dict[tuple[int, int], list[tuple[Kernel, Bindings, int]]] = {}

    def record(self, recording: Recording, x: Texels, case: int) -> None:
        """Record the forces of one load case of ``x``; those of another are overwritten."""
        key = (id(x), case)
        if key not in self._bound:
            self._bound[key] = [self._bind(*part, x, case) for part in self.texels.parts]
        for kernel, bindings, threads in self._bound[key]:
            recording.dispatch(kernel, bindings, threads=(threads,))

    def _bind(
        self, entry: str, first: int, count: int, x: Texels, case: int
    ) -> tuple[Kernel, Bindings, int]:
        texels = self.texels
        kernel = self.device.kernel("fem/device/tet_forces_single", entry=entry)
        bindings = kernel.bind(
            cells=texels.cells, roots=texels.roots, x_in=x, forces_out=texels.forces,
            params={"first": first, "count": count, "base": case * (texels.nodes + 1)},
        )  # fmt: skip
        return kernel, bindings, count
