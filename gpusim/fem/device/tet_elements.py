"""Quadratic tetrahedra by their geometry alone: what products need that never form K.

With R_q the gradients of the reference coordinates at quadrature point q, times the root of shear
modulus and volume there, and H = (du/dxi) R_q, the element's energy is

    sum_q (H + H^T) : H + r (tr H)^2,    r = Lame's first modulus over the shear modulus:

nine numbers a point and one ratio. Straight elements have the same R at all points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.fem.assembly.element_batches import DistinctGroup, Elements, Integrated
from gpusim.fem.elements.element import ELEMENTS
from gpusim.fem.elements.isoparametric_map import determinant, inverse, reference_gradient
from gpusim.fem.elements.straight_tetrahedra import StraightTets

__all__ = ["TetElements", "tet_elements"]

Float = npt.NDArray[np.float64]
Int = npt.NDArray[np.int32]

_RULE = ELEMENTS["tet10"].rule("full")


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
