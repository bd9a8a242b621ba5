"""The levels of multigrid: geometry first, then smoothed aggregation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import bsr_matrix

from gpusim.errors import NotConverged
from gpusim.fem.aggregation import aggregate_level, largest_eigenvalue
from gpusim.fem.assembly import group_matrix, lattice_matrix
from gpusim.fem.coarsen import Coarser, drop_midsides, drop_planes, has_midsides
from gpusim.fem.congruence import mix
from gpusim.fem.diagonal import diagonal_blocks, invert_blocks
from gpusim.fem.groups import Group
from gpusim.fem.lattice import Lattice, find_lattice
from gpusim.fem.patches import Patches, make_patches
from gpusim.fem.product import Product
from gpusim.fem.supports import rigid_modes
from gpusim.fem.transfer import MatrixTransfer, NodeTransfer, Transfer

__all__ = ["Hierarchy", "Level", "build_hierarchy"]

Float = npt.NDArray[np.float64]
Bool = npt.NDArray[np.bool_]

_COARSEST = 800
# aggregation is of no use to nearly incompressible bodies: a larger dense inverse in its place
_COARSEST_PATCHED = 2500


@dataclass(frozen=True, eq=False)
class Level:
    """One level: its matrix (3x3 or 6x6 blocks) as host product, inverted diagonal blocks
    (B,s,s), greatest eigenvalue of D^-1 A, and the transfer to the next coarser level. Where
    ``patches`` smooth instead, the eigenvalue is theirs."""

    product: Product
    inverse: Float
    largest: float
    transfer: Transfer
    patches: Patches | None = None


@dataclass(frozen=True, eq=False)
class Hierarchy:
    """Levels from fine to coarse, the inverse on the coarsest one (dense), and ``lowest``: an
    estimate of the smallest eigenvalue of K (Rayleigh-Ritz in the coarsest space, so never below
    it)."""

    levels: tuple[Level, ...]
    coarse_inverse: Float
    lowest: float


def build_hierarchy(
    matrix: bsr_matrix,
    groups: list[Group],
    lattice: Lattice | None,
    free: Bool,
    points: Float,
    scale: float,
    patched: bool = False,
) -> Hierarchy:
    """Coarsen until at most a few hundred unknowns remain.

    ``patched`` asks for patches as smoothers on lattices.
    ``matrix`` K / scale with 3x3 blocks, ``groups`` the elements of K, ``lattice`` of their nodes
    or None, ``free`` (N,3), ``points`` (N,3).
    """
    levels: list[Level] = []
    while True:
        coarser = _geometric(groups, lattice, free, points)
        if coarser is None:
            break
        inverse = invert_blocks(diagonal_blocks(matrix), free)
        coarse_free = free[coarser.kept]
        transfer = NodeTransfer(coarser.weights, free, coarse_free)
        product, patches = Product(matrix), None
        if patched and lattice is not None:
            patches = make_patches(matrix, groups[0], lattice, free)
        largest = largest_eigenvalue(product, inverse if patches is None else patches)
        levels.append(Level(product, inverse, largest, transfer, patches))
        groups, lattice, free = coarser.groups, coarser.lattice, coarse_free
        points = points[coarser.kept]
        if lattice is not None:
            matrix = lattice_matrix(groups[0], lattice)
        else:
            matrix = group_matrix(groups, len(points))
        matrix.data /= scale
    smoothed_by_patches = bool(levels) and levels[-1].patches is not None
    return _aggregate(
        levels, matrix, free, points, _COARSEST_PATCHED if smoothed_by_patches else _COARSEST
    )


def _geometric(
    groups: list[Group], lattice: Lattice | None, free: Bool, points: Float
) -> Coarser | None:
    if has_midsides(groups):
        coarser = drop_midsides(groups, free)
        return _on_lattice(coarser, points[coarser.kept])
    if lattice is not None and 3 * len(free) > _COARSEST:
        return drop_planes(groups[0], lattice, free)
    return None


def _on_lattice(coarser: Coarser, points: Float) -> Coarser:
    """The same, with the lattice of the coarse hex8 elements where there is one."""
    if len(coarser.groups) != 1 or coarser.groups[0].name != "hex8":
        return coarser
    group = coarser.groups[0]
    lattice = find_lattice(points, group.cells)
    if lattice is None:
        return coarser
    at, nodes = lattice.corner_nodes()
    order = lattice.cell.ravel()[at]
    if not (group.cells[order] == nodes).all():
        return coarser  # corners in another order than the lattice's
    group = Group("hex8", nodes, group.kind[order], group.matrices)
    return Coarser(coarser.weights, coarser.kept, [group], lattice)


def _aggregate(
    levels: list[Level], matrix: bsr_matrix, free: Bool, points: Float, coarsest: int
) -> Hierarchy:
    origin = points.mean(axis=0)
    length = float(np.abs(points - origin).max()) or 1.0
    near_null, mask = rigid_modes(points, origin, length) * free[:, :, None], free
    stalled = False
    while not levels or (matrix.shape[0] > coarsest and not stalled):
        inverse = invert_blocks(diagonal_blocks(matrix), mask)
        product = Product(matrix)
        largest = largest_eigenvalue(product, inverse)
        coarser = aggregate_level(matrix, inverse, largest, near_null, mask)
        levels.append(Level(product, inverse, largest, MatrixTransfer(coarser.prolongation)))
        stalled = coarser.matrix.shape[0] > 0.9 * matrix.shape[0]
        matrix, near_null, mask = coarser.matrix, coarser.near_null, coarser.mask
    keep = mask.ravel()
    inside = np.ix_(keep, keep)
    inverse_dense = np.zeros(matrix.shape)
    inverse_dense[inside] = _inverse(matrix.toarray()[inside])
    lowest = _lowest_eigenvalue(inverse_dense, levels, matrix)
    return Hierarchy(tuple(levels), inverse_dense, lowest)


def _inverse(matrix: Float) -> Float:
    """Of a symmetric positive definite matrix, scaled to a unit diagonal first."""
    scale = 1.0 / np.sqrt(matrix.diagonal())
    scaled = 0.5 * (matrix + matrix.T) * scale[:, None] * scale
    try:
        factor = cho_factor(scaled, lower=True)
    except np.linalg.LinAlgError:
        raise NotConverged(
            "multigrid: the coarsest matrix is not positive definite in float64; got a body whose "
            "softest motions vanish beside its stiffest (is it extremely slender, nearly free, or "
            "of extremely unequal elements?); expected better proportions, or the direct solver"
        ) from None
    inverse = cho_solve(factor, np.eye(len(matrix)))
    return np.asarray(0.5 * (inverse + inverse.T) * scale[:, None] * scale)


def _lowest_eigenvalue(inverse: Float, levels: list[Level], matrix: bsr_matrix) -> float:
    """Of K in the coarsest space by inverse iteration; every iterate bounds it from above."""

    def overlap(x: Float) -> Float:
        for level in reversed(levels):
            x = level.transfer.interpolate(x)
        for level in levels:
            x = level.transfer.restrict(x)
        return x

    x = (mix(np.arange(len(inverse)), 5) >> np.uint64(11)).astype(np.float64) * 2.0**-53 - 0.5
    image = x[None]
    for _ in range(8):
        x = inverse @ image[0]
        x /= np.linalg.norm(x)
        image = overlap(x[None])
    return float((x @ (matrix @ x)) / (x @ image[0]))
