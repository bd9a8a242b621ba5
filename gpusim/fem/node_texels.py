"""Nodal vectors as texels: (x, y, z, 0) per node, each load case followed by one texel of zeros.

The zero texel is a node that doesn't move: a neighbour that carries what a row of blocks lacks to
a sum of zero (see ``block_texels``).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.fem.arena import Allocator
from gpusim.gpu.texels import Texels

__all__ = ["Pair", "node_texels", "pair", "read_nodes", "vector_texels"]

Float = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Pair:
    """A vector as the sum of two float32 ones: ``high`` the nearest, ``low`` what that leaves."""

    high: Texels
    low: Texels

    def write(self, values: Float) -> None:
        """Copy float64 values (L,N,3) in, to 48 bits."""
        high = values.astype(np.float32)
        self.high.write(node_texels(high))
        self.low.write(node_texels(values - high))

    def read(self, cases: int) -> Float:
        """The (L,N,3) values."""
        high, low = (read_nodes(one, cases).astype(np.float64) for one in (self.high, self.low))
        return np.asarray(high + low)


def vector_texels(device: Allocator, cases: int, nodes: int, label: str) -> Texels:
    """A vector of zeros."""
    return device.texels(cases * (nodes + 1), "rgba32float", label)


def node_texels(values: npt.NDArray[np.floating]) -> npt.NDArray[np.float32]:
    """(L,N,3) as (L (N+1), 4) float32."""
    cases, nodes = values.shape[:2]
    result = np.zeros((cases, nodes + 1, 4), dtype=np.float32)
    result[:, :nodes, :3] = values
    return result.reshape(-1, 4)


def pair(device: Allocator, cases: int, nodes: int, label: str) -> Pair:
    """A vector of zeros."""
    return Pair(
        vector_texels(device, cases, nodes, f"{label}.high"),
        vector_texels(device, cases, nodes, f"{label}.low"),
    )


def read_nodes(texels: Texels, cases: int) -> npt.NDArray[np.float32]:
    """The (L,N,3) values of a vector."""
    return texels.read().reshape(cases, -1, 4)[:, :-1, :3]
