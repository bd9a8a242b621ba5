"""Quadratic tetrahedra by their geometry alone, for products that never form K, and as texels.

With R_q the gradients of the reference coordinates at quadrature point q, times the root of shear
modulus and volume there, and H = (du/dxi) R_q, the element's energy is

    sum_q (H + H^T) : H + r (tr H)^2,    r = Lame's first modulus over the shear modulus:

nine numbers a point and one ratio. Straight elements have the same R at all points.

As texels, for kernels that take one element per thread: per element three texels of ``cells``, its
ten nodes and its first texel of ``roots``. A set of ``roots`` is five texels, one set for a
straight element, four for a curved one: nine numbers R and the ratio, then what float32 leaves of
them. R is divided by the root of the scale, and by sqrt(5) (see ``shaders/lib/fem/tet10.wgsl``).

Forces are three texels per two nodes of an element. Per node one texel of ``info``: the first
texel of its list, how many, nothing, the node; ``lists`` has twice the texel of a force, plus one
for the second of two nodes. They are padded to whole fours by a force of zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float, Int, Single
from gpusim.fem.assembly.element_batches import DistinctGroup, Elements, Integrated
from gpusim.fem.device.block_texels import WINDOW
from gpusim.fem.device.node_texels import Allocator
from gpusim.fem.elements.element import ELEMENTS
from gpusim.fem.elements.isoparametric_map import determinant, inverse, reference_gradient
from gpusim.fem.elements.straight_tetrahedra import StraightTets
from gpusim.fem.sparse.block_rows import ranges
from gpusim.gpu.texture_array import Texels, most_texels

_RULE = ELEMENTS["tet10"].rule("full")
_CELL, _ROOTS, _FORCES = 3, 5, 15
_POINTS = 4


@dataclass(frozen=True, eq=False)
class TetElements:
    """``cells`` (M,10): the straight ones, then the curved ones.

    ``straight`` (S,3,3) and ``curved`` (M-S,4,3,3) R of the full rule's points, reference
    coordinate first; ``ratio`` (M,). All float64.
    """

    cells: Int
    straight: Float
    curved: Float
    ratio: Float


def tet_elements(groups: Sequence[Elements]) -> TetElements | None:
    """All elements of a model; None if some aren't isotropic tet10 by the full rule, or repeat."""
    cells, ratios = [], []
    straight, curved = np.zeros((0, 3, 3)), np.zeros((0, 4, 3, 3))
    for group in groups:
        if group.name != "tet10" or not isinstance(group, DistinctGroup):
            return None
        source = group.source
        assert isinstance(source, StraightTets | Integrated)
        moduli = _moduli(source.elasticity)
        if moduli is None or (isinstance(source, Integrated) and source.rule != "full"):
            return None
        shear, ratio = (one[source.material] for one in moduli)
        if isinstance(source, StraightTets):
            straight = _straight_roots(source, shear)
        else:
            curved = _curved_roots(source, shear)
        cells.append(group.cells)
        ratios.append(ratio)
    if not cells:
        return None
    return TetElements(np.concatenate(cells), straight, curved, np.concatenate(ratios))


def _moduli(elasticity: Float) -> tuple[Float, Float] | None:
    """Shear moduli and ratios of materials (K,6,6); None if they aren't all isotropic."""
    shear, lame = elasticity[:, 3, 3], elasticity[:, 0, 1]
    wanted = np.zeros_like(elasticity)
    wanted[:, :3, :3] = lame[:, None, None]
    wanted[:, np.arange(3), np.arange(3)] += 2.0 * shear[:, None]
    wanted[:, np.arange(3, 6), np.arange(3, 6)] = shear[:, None]
    return (shear, lame / shear) if np.array_equal(wanted, elasticity) else None


def _straight_roots(source: StraightTets, shear: Float) -> Float:
    gradient, volume = source.gradients(np.arange(len(source)))
    # a point's share of the volume
    share = np.sqrt(shear * volume / len(_RULE.weight))
    return np.asarray(gradient[1:].transpose(1, 0, 2) * share[:, None, None])


def _curved_roots(source: Integrated, shear: Float) -> Float:
    nodes = source.points[source.cells]
    jacobian = reference_gradient(nodes - nodes[:, :1], _RULE)
    det = determinant(jacobian)
    share = np.sqrt(shear[:, None] * det * _RULE.weight)
    return np.asarray((inverse(jacobian, det) * share).transpose(2, 3, 0, 1))


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


def _root_texels(elements: TetElements, scale: float) -> Single:
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
    nodes_of_corners = elements.cells.ravel()
    order = np.argsort(nodes_of_corners, kind="stable")
    element, k = np.divmod(order, 10)
    force = 2 * (_FORCES * element + 3 * (k // 2)) + 3 * (k % 2)
    degree = np.bincount(nodes_of_corners, minlength=nodes)
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
