"""Stiffness of straight-sided quadratic tetrahedra in closed form.

A gradient of a quadratic shape function is a sum of the four constant gradients g_v of the
corners' linear ones, with factors c_av linear in place. So, with the blocks k_vw of the linear
tetrahedron,

    K_ab = sum_vw T_ab,vw k_vw,    T_ab,vw = mean of c_av c_bw,    k_vw,ij = V C_ikjl g_vk g_wl:

one product with a constant table. The means are of products of linear functions, as the four
points of the full rule integrate them exactly (Zienkiewicz & Taylor, The Finite Element Method,
vol. 1, 2000, section 8.8).
"""

from __future__ import annotations

from functools import cache

import numpy as np

from gpusim.arrays.array_types import Bool, Float, Int, Long
from gpusim.fem.elements.element_matrix import modulus_tensor
from gpusim.fem.elements.isoparametric_map import determinant, inverse, require_positive
from gpusim.mesh.cell_types import CELL_TYPES

# midsides this far from the middle, relative to the cell's extent, bend nothing that float64 shows
_STRAIGHT = 1e-13
_MIDSIDES = np.array(CELL_TYPES["tet10"].parents)


def is_straight(nodes: Float) -> Bool:
    """(M,) whether the midsides of tet10 with ``nodes`` (M,10,3) lie in the middle."""
    # relative to the first node, so that a shift of all of them isn't felt
    local = nodes - nodes[:, :1]
    off = local[:, 4:] - 0.5 * (local[:, _MIDSIDES[:, 0]] + local[:, _MIDSIDES[:, 1]])
    extent = np.ptp(local, axis=1).max(axis=1)
    # coordinates far from the origin are rounded there
    rounding = np.finfo(np.float64).eps * np.abs(nodes).max(axis=(1, 2))
    return np.asarray(np.abs(off).max(axis=(1, 2)) <= _STRAIGHT * extent + rounding)


class StraightTets:
    """Elements with ``corners`` (M,4) among ``points`` (N,3), quadratic ones unless ``linear``."""

    def __init__(
        self, points: Float, corners: Int, elasticity: Float, material: Int, linear: bool = False
    ) -> None:
        self.points, self.corners = points, corners
        self.elasticity, self.material, self._is_linear = elasticity, material, linear
        self.name = "tet4" if linear else "tet10"

    def __len__(self) -> int:
        return len(self.corners)

    def linear(self) -> StraightTets:
        """The linear elements on the corners: Q^T K Q where Q interpolates linearly."""
        data = self.points, self.corners, self.elasticity, self.material
        return StraightTets(*data, linear=True)

    def chosen(self, which: Long | Bool) -> StraightTets:
        """Some of the elements."""
        return StraightTets(
            self.points, self.corners[which], self.elasticity, self.material[which],
            self._is_linear,
        )  # fmt: skip

    def at(self, which: Long) -> Float:
        """(m,3k,3k) matrices of some elements."""
        nodes = 4 if self._is_linear else 10
        blocks = (_shares(self._is_linear) @ self._corner_blocks(which)).reshape(
            nodes, nodes, -1, 3, 3
        )
        matrices = blocks.transpose(2, 0, 3, 1, 4).reshape(-1, 3 * nodes, 3 * nodes)
        return np.asarray(0.5 * (matrices + matrices.transpose(0, 2, 1)))

    def blocks(self, which: Long, diagonal: bool) -> tuple[Float, Float | None]:
        """Blocks (P,m,9) of the pairs a < b of nodes, and the diagonal ones (k,m,9) if wanted."""
        nodes = 4 if self._is_linear else 10
        table = _shares(self._is_linear).reshape(nodes, nodes, 16)
        corner = self._corner_blocks(which)
        pairs = (table[np.triu_indices(nodes, 1)] @ corner).reshape(-1, len(which), 9)
        if not diagonal:
            return pairs, None
        diagonal_blocks = (table[np.arange(nodes), np.arange(nodes)] @ corner).reshape(
            -1, len(which), 9
        )
        return pairs, diagonal_blocks

    def gradients(self, which: Long) -> tuple[Float, Float]:
        """Gradients (4,m,3) of the linear shape functions, and volumes (m,)."""
        nodes = self.points[self.corners[which]]
        # columns are edges from the first corner: d x_i / d xi_j
        jacobian = (nodes[:, 1:] - nodes[:, :1]).transpose(2, 1, 0)
        det = determinant(jacobian)
        require_positive(self.name, det)
        gradient = np.empty((4, len(which), 3))
        gradient[1:] = inverse(jacobian, det).transpose(0, 2, 1)
        gradient[0] = -gradient[1:].sum(axis=0)
        return gradient, det / 6.0

    def _corner_blocks(self, which: Long) -> Float:
        """(16,9m) blocks k_vw of the linear tetrahedra."""
        gradient, volume = self.gradients(which)
        weighted = gradient * volume[:, None]
        products = weighted[:, None, :, :, None] * gradient[None, :, :, None, :]
        products = products.reshape(16, len(which), 9)
        result = np.empty_like(products)
        material = self.material[which]
        for number in np.unique(material).tolist():
            tensor = modulus_tensor(self.elasticity[number])
            of_material = material == number
            if of_material.all():
                np.matmul(products, tensor, out=result)
            else:
                result[:, of_material] = products[:, of_material] @ tensor
        return result.reshape(16, -1)


@cache
def _shares(linear: bool) -> Float:
    """(k*k,16) T_ab,vw."""
    if linear:
        return np.eye(16)
    # c_av = constant + coefficients of the four linear shape functions L
    factor = np.zeros((10, 4, 5))
    for corner in range(4):
        factor[corner, corner, [0, 1 + corner]] = -1.0, 4.0
    for edge, (one, two) in enumerate(_MIDSIDES, start=4):
        # 4 L_one L_two
        factor[edge, one, 1 + two] = factor[edge, two, 1 + one] = 4.0
    # means of 1, L_i and L_i L_j over a tetrahedron
    mean = np.full((5, 5), 0.05)
    mean[1:, 1:] += 0.05 * np.eye(4)
    mean[0, 0], mean[0, 1:], mean[1:, 0] = 1.0, 0.25, 0.25
    shares = np.einsum("avm,mn,bwn->abvw", factor, mean, factor).reshape(100, 16)
    shares.setflags(write=False)
    return np.asarray(shares)
