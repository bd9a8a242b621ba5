"""Quadratic tetrahedra as texels, for kernels that take one element per thread.

Per element three texels of ``cells``: its ten nodes and its first texel of ``roots``. A set of
``roots`` is five texels, one set for a straight element, four for a curved one: nine numbers R
(see ``tet_elements``) and the ratio, then what float32 leaves of them. R is divided by the root of
the scale, and by sqrt(5) (see ``shaders/lib/fem/tet10.wgsl``).

Forces are three texels per two nodes of an element. Per node one texel of ``info``: the first
texel of its list, how many, nothing, the node; ``lists`` has twice the texel of a force, plus one
for the second of two nodes. They are padded to whole fours by a force of zero.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.fem.assembly.block_rows import ranges
from gpusim.fem.device.arena import Allocator
from gpusim.fem.device.row_slices import WINDOW
from gpusim.fem.device.tet_elements import TetElements
from gpusim.fem.elements.element import ELEMENTS
from gpusim.gpu.texture_array import Texels, most_texels

__all__ = ["TetTexels", "tet_texels_bytes"]

Float = npt.NDArray[np.float64]
Long = npt.NDArray[np.int64]

_CELL, _ROOTS, _FORCES = 3, 5, 15
_POINTS = 4


class TetTexels:
    """The elements on the device, their matrices divided by ``scale``; the first ``straight`` of
    ``count`` are straight. ``forces`` are those of one vector, overwritten by each product.

    """

    def __init__(
        self, device: Allocator, elements: TetElements, nodes: int, scale: float, label: str
    ) -> None:
        self.nodes, self.count = nodes, len(elements.cells)
        self.straight = len(elements.straight)
        sizes = _sizes(elements, nodes)
        self.cells = device.texels(sizes["cells"], "rgba32uint", f"{label}.cells")
        self.cells.write(_cell_texels(elements))
        self.roots = device.texels(sizes["roots"], "rgba32float", f"{label}.roots")
        self.roots.write(_root_texels(elements, scale))
        info, lists = _lists(elements, nodes)
        self.info = device.texels(sizes["info"], "rgba32uint", f"{label}.info")
        self.info.write(info)
        self.lists = device.texels(sizes["lists"], "rgba32uint", f"{label}.lists")
        self.lists.write(lists)
        self.forces = device.texels(sizes["forces"], "rgba32float", f"{label}.forces")

    @property
    def parts(self) -> tuple[tuple[str, int, int], ...]:
        """(kind, first, how many) of the elements that there are of each kind."""
        both = ("straight", 0, self.straight), ("curved", self.straight, self.count - self.straight)
        return tuple(part for part in both if part[2])

    @staticmethod
    def fits(device: Allocator, elements: TetElements, nodes: int) -> bool:
        """Whether each part fits a texture."""
        return max(_sizes(elements, nodes).values()) <= most_texels(device)


def tet_texels_bytes(elements: TetElements, nodes: int) -> int:
    """Bytes that they take."""
    return sum(Texels.footprint(size) for size in _sizes(elements, nodes).values())


def _sizes(elements: TetElements, nodes: int) -> dict[str, int]:
    count = len(elements.cells)
    degree = np.bincount(elements.cells.ravel(), minlength=nodes)
    return {
        "cells": _CELL * count,
        "roots": _ROOTS * (len(elements.straight) + _POINTS * len(elements.curved)),
        "info": nodes,
        "lists": int((-(-degree // 4)).sum()),
        # the force of zero behind them
        "forces": _FORCES * count + 2,
    }


def _cell_texels(elements: TetElements) -> npt.NDArray[np.uint32]:
    count, straight = len(elements.cells), len(elements.straight)
    result = np.zeros((count, 4 * _CELL), dtype=np.uint32)
    result[:, :10] = elements.cells
    place = np.arange(count)
    place[straight:] = straight + _POINTS * (place[straight:] - straight)
    result[:, 10] = _ROOTS * place
    return result.reshape(-1, 4)


def _root_texels(elements: TetElements, scale: float) -> npt.NDArray[np.float32]:
    # the kernels' k-th point is the one next to corner k
    points = ELEMENTS["tet10"].rule("full").points
    near = np.argmax(np.column_stack([1.0 - points.sum(axis=1), points]), axis=1)
    curved = elements.curved[:, np.argsort(near)]
    roots = np.concatenate([elements.straight.reshape(-1, 9), curved.reshape(-1, 9)])
    roots *= np.sqrt(0.2 / scale)
    straight = len(elements.straight)
    ratio = elements.ratio[:straight], np.repeat(elements.ratio[straight:], _POINTS)
    numbers = np.column_stack([roots, np.concatenate(ratio)])
    high = numbers.astype(np.float32)
    low = (numbers - high).astype(np.float32)
    return np.concatenate([high, low], axis=1).reshape(-1, 4)


def _lists(
    elements: TetElements, nodes: int
) -> tuple[npt.NDArray[np.uint32], npt.NDArray[np.uint32]]:
    """``info`` and ``lists``."""
    own = elements.cells.ravel()
    order = np.argsort(own, kind="stable")
    element, k = np.divmod(order, 10)
    force = 2 * (_FORCES * element + 3 * (k // 2)) + 3 * (k % 2)
    degree = np.bincount(own, minlength=nodes)
    start = np.cumsum(degree) - degree
    # lists of equal length side by side, close together in memory
    fours = -(-degree // 4)
    turn = np.lexsort((-fours, np.arange(nodes) // WINDOW))
    degree, start, fours = degree[turn], start[turn], fours[turn]
    first = np.cumsum(fours) - fours
    lists = np.full(4 * int(fours.sum()), 2 * _FORCES * len(elements.cells), dtype=np.uint32)
    lists[ranges(4 * first, degree)] = force[ranges(start, degree)]
    info = np.stack([first, fours, np.zeros_like(first), turn], axis=1).astype(np.uint32)
    return info, lists.reshape(-1, 4)
