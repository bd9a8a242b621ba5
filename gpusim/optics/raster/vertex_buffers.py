"""A view's triangles on the device, as rasterisers and the edge pass read them."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.gpu import Buffer, Device
from gpusim.optics.geometry.view import View
from gpusim.optics.paint.checker_lines import BoardLines

__all__ = ["VertexBuffers"]


class VertexBuffers:
    """Vertices in fixed point with their depths, and which of them a triangle has.

    ``fixed`` (V, 2) int32: places in 1/65536 px; ``inverse`` (V,) float32: 1 / depth; ``near``:
    what that is scaled by for the depth buffer.
    """

    def __init__(
        self, device: Device, view: View, label: str, lines: BoardLines | None = None
    ) -> None:
        """Buffers are called ``label``.…; strips along ``lines`` follow the view's triangles."""
        fixed, corners = view.fixed(), _corners_of(view)
        self.near, depth = view.raster_depth()
        if lines is not None:
            strips = np.arange(3 * len(lines.parent), dtype=np.uint32) + np.uint32(len(fixed))
            corners = np.concatenate([corners, strips])
            fixed = np.concatenate([fixed, lines.fixed().reshape(-1, 2)])
            depth = np.concatenate([depth, lines.inverse_depth.astype(np.float32).reshape(-1)])
        self.device, self.label = device, label
        self.fixed, self.inverse = fixed, depth
        self.corners: Buffer = device.buffer(corners, f"{label}.corners")

    @cached_property
    def screen(self) -> Buffer:
        """``fixed``; rasterisers and the edge pass read it."""
        return self.device.buffer(self.fixed, f"{self.label}.screen")

    @cached_property
    def inverse_depth(self) -> Buffer:
        """1 / depth of every vertex; rasterisers alone read it."""
        return self.device.buffer(self.inverse, f"{self.label}.inverse_depth")

    def bindings(self) -> dict[str, Any]:
        """All that draws them binds, by WGSL names."""
        return {**self.outlines(), "inverse_depth": self.inverse_depth}

    def outlines(self) -> dict[str, Any]:
        """What tells where triangles lie on the image."""
        return {"screen": self.screen, "corners": self.corners}


def _corners_of(view: View) -> npt.NDArray[np.uint32]:
    """The triangles' vertices, three and three, (3 T,); one triangle at least."""
    result = np.zeros((max(view.count, 1), 3), np.uint32)
    for own, vertices in zip(result.T, view.corner.T, strict=True):
        own[: view.count] = vertices
    return result.reshape(-1)
