"""The levels of multigrid: geometry first, then smoothed aggregation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh
from scipy.sparse import bsr_matrix

from gpusim.arrays.array_types import Bool, Float, Long, Real
from gpusim.arrays.unique import noise
from gpusim.errors import NotConverged
from gpusim.fem.assembly.assembly import Assembled, group_matrix, lattice_stencil
from gpusim.fem.assembly.element_batches import Elements, Group, only_group
from gpusim.fem.assembly.system import System, finest_product
from gpusim.fem.lattice.lattice import Lattice, find_lattice
from gpusim.fem.lattice.stencil import StencilProduct
from gpusim.fem.model.supports import rigid_modes
from gpusim.fem.multigrid.coarse_solver import CoarseSolver, narrow_order
from gpusim.fem.multigrid.column_blocks import Columns, columns_across
from gpusim.fem.multigrid.geometric_coarsening import (
    Coarser,
    coarse_lattice,
    drop_midsides,
    drop_planes,
)
from gpusim.fem.multigrid.mapped_coarsening import mapped_lattice
from gpusim.fem.multigrid.smoothed_aggregation import (
    galerkin,
    largest_eigenvalue,
    prolongator,
)
from gpusim.fem.multigrid.smoothers import Relaxation, chebyshev
from gpusim.fem.multigrid.transfer import MatrixTransfer, NodeTransfer, PlaneWeights, Transfer
from gpusim.fem.sparse.block_rows import invert_repeated
from gpusim.fem.sparse.matrix_product import Product
from gpusim.mesh.cell_types import CELL_TYPES

_COARSEST = 800
# of long bodies, whose band is solved with, or, on a device, whose matrix is inverted
_COARSEST_BAND, _COARSEST_INVERTED = 20_000, 2500
# of a body that can't be aggregated any further: 1.4 GB, as an inverse is made by way of five more
_MOST_INVERTED = 6000
# distinct elements up to which the greatest eigenvalue is bounded by theirs
_FEW = 400
# Quadratic tetrahedra take a few iterations more with one step of smoothing in place of two, each
# with three products in place of five; bricks take half as many again, and gain nothing.
# Flat tetrahedra need both, too: the diagonal cubed over six volumes is about 5 for a good one.
# Some of them are looked at.
_COMPACT, _LOOK = 20.0, 10_000
# strain by which a rotation of the ends may mislead sheets, over that of bending: with 2.3 a bar
# takes twice as many iterations as with aggregates, with 7 six times as many
_TURNED = 1.5
# of Lanczos; what one step takes needn't be as sharp
_STEPS, _FEW_STEPS = 10, 6
# ratio of nodes' stiffnesses; a corner has an eighth of what others have, cells may differ
_EVEN = 100.0
_DEGREE = 2
# eigenvalues of D^-1 A from 1/12 of the greatest on are the smoother's: half and twice as many
# cost an iteration
_RANGE = 12.0
# the same of a single step, which mustn't come near twice the inverse of the greatest
_LIGHT_RANGE = 8.0


@dataclass(frozen=True, eq=False)
class Level:
    """One level: its matrix (3x3 or 6x6 blocks) as host product, inverted diagonal blocks
    (B,s,s), greatest eigenvalue of D^-1 A, and the transfer to the next coarser level. Where a
    ``smoother`` of columns serves instead, the eigenvalue is its own. ``single_step``: one
    step of smoothing is enough, because the coarser level has the same elements. ``twice``: a cycle
    goes through this level and what is below twice, as aggregated levels are cheap, and poor where
    bodies are flat or long (see ``Multigrid``)."""

    product: Product | StencilProduct
    inverse: Float
    largest: float
    transfer: Transfer
    smoother: Columns | None = None
    single_step: bool = False
    twice: bool = False

    def smoothing_steps(self) -> tuple[Relaxation, ...]:
        """Chebyshev steps before and after the coarser levels."""
        if self.smoother is not None:
            return self.smoother.steps(self.largest)
        if self.single_step:
            return chebyshev(self.largest / _LIGHT_RANGE, self.largest, 1)
        return chebyshev(self.largest / _RANGE, self.largest, _DEGREE)


@dataclass(frozen=True, eq=False)
class Hierarchy:
    """Levels from fine to coarse, what solves on the coarsest one, and ``lowest``: an estimate of
    the smallest eigenvalue of K (by the coarsest level's matrix)."""

    levels: tuple[Level, ...]
    coarsest: CoarseSolver
    lowest: float


def build_hierarchy(
    assembled: Assembled,
    system: System,
    points: Float,
    *,
    stiff_in_bulk: bool = False,
    inverted: bool = False,
    uneven_stiffness: bool = False,
) -> Hierarchy:
    """Coarsen until at most a few hundred unknowns remain, from nodes at ``points`` (N,3) on.

    Aggregation by sheets or columns is of no use to bodies that are ``stiff_in_bulk``; ``inverted``
    asks for a coarsest matrix that can be inverted, as devices do. With ``uneven_stiffness``
    interpolation from aggregates stays in float64, and its levels aren't gone through twice, as
    rounding brings eigenvalues of a cycle above 1.
    """
    groups: Sequence[Elements] = assembled.groups
    rows, lattice, free, scale = assembled.rows, assembled.lattice, system.free, system.scale
    product = finest_product(rows, system)
    levels: list[Level] = []
    inverse = invert_repeated(rows.diagonal / scale, rows.row_class, free)
    while True:
        coarser = _geometric(groups, lattice, free, points)
        if coarser is None or not free[coarser.kept].any():
            break
        if levels:
            inverse = product.block_inverse(free)
        transfer = NodeTransfer(coarser.interpolation, free, coarser.kept)
        single_step = all(_compact_tets(group, points) for group in groups)
        if sum(group.distinct for group in groups) <= _FEW:
            largest = max(_element_bound(_distinct_matrices(group)) for group in groups)
        else:
            largest = largest_eigenvalue(product, inverse, _FEW_STEPS if single_step else _STEPS)
        levels.append(Level(product, inverse, largest, transfer, single_step=single_step))
        groups, lattice, free = coarser.groups, coarser.lattice, transfer.coarse_free
        points = points[coarser.kept]
        if lattice is not None:
            product = lattice_stencil(only_group(groups), lattice, scale).operator
        elif not groups:
            assert isinstance(product, Product)
            product = Product(galerkin(product, transfer.matrix))
        else:
            matrix = group_matrix(groups, len(points))
            matrix.data /= scale
            product = Product(matrix)
    whole = len(points)
    if not stiff_in_bulk and lattice is None and [group.name for group in groups] == ["hex8"]:
        assert isinstance(product, Product)
        product, free, points = _by_sheets(levels, product, groups[0], free, points)
    longest = _COARSEST_INVERTED if inverted else _COARSEST_BAND
    column = None
    if groups and not stiff_in_bulk and len(points) == whole:
        column = columns_across(groups, points)
    return _aggregate(levels, product, free, points, longest, column, uneven_stiffness)


def _by_sheets(
    levels: list[Level], product: Product, group: Elements, free: Bool, points: Float
) -> tuple[Product, Bool, Float]:
    """Levels of bricks that are numbered as on a lattice, as far as sheets of nodes can be left
    out. Their elements aren't formed anew: coarse matrices are products of sparse ones."""
    lattice = mapped_lattice(points, group.cells) if _even(product) else None
    while lattice is not None and free.size > _COARSEST:
        weights = coarse_lattice(lattice)
        if weights is None or not free[weights.kept].any() or _bent(weights, points):
            break
        transfer = NodeTransfer(weights, free, weights.kept)
        inverse = product.block_inverse(free)
        largest = largest_eigenvalue(product, inverse, _STEPS)
        levels.append(Level(product, inverse, largest, transfer))
        product = Product(galerkin(product, transfer.matrix))
        lattice, free, points = weights.coarse, transfer.coarse_free, points[weights.kept]
    return product, free, points


def _bent(weights: PlaneWeights, points: Float) -> bool:
    """Whether a long body turns more than its coarser nodes can follow: where nodes lie beside the
    places that interpolation gives them, a rotation strains the cells by this share of a cell, and
    the ends of a body turn by as much as it is longer than thick times its strain."""
    beside = weights.interpolate(points[weights.kept]) - points
    planes = weights.fine.planes
    spacing = min(float(np.diff(one).mean()) for one in planes)
    sizes = [float(one[-1] - one[0]) for one in planes]
    off = np.sqrt(np.mean(np.einsum("ni,ni->n", beside, beside))) / spacing
    return bool(off * max(sizes) > _TURNED * min(sizes))


def _even(product: Product) -> bool:
    """Whether stiffnesses are about the same everywhere: sheets cut through stiff parts between
    soft ones, which aggregates keep together (71 iterations in place of 10 on a ball, at 1e6)."""
    trace = np.einsum("nii->n", product.diagonal)
    return bool(trace.max(initial=0.0) <= _EVEN * trace[trace > 0.0].min(initial=np.inf))


def _compact_tets(group: Elements, points: Float) -> bool:
    """Whether these are quadratic tetrahedra of good proportions."""
    if group.name != "tet10":
        return False
    nodes = points[group.cells[:: 1 + len(group.cells) // _LOOK, :4]]
    edges = nodes[:, 1:] - nodes[:, :1]
    diagonal = np.linalg.norm(np.ptp(nodes, axis=1), axis=1)
    return bool(np.mean(diagonal**3 / np.abs(np.linalg.det(edges))) <= _COMPACT)


def _distinct_matrices(group: Elements) -> Float:
    return group.matrices if isinstance(group, Group) else group.at(np.arange(group.distinct))


def _element_bound(matrices: Float) -> float:
    """Bound of the eigenvalues of D^-1 K: the greatest of any element's own.

    x.K x = sum x_e.K_e x_e <= max(lambda_e) sum x_e.D_e x_e, and the D_e add up to D (Wathen, IMA
    J. Numer. Anal. 7 (1987) 449). Some percent above the truth; no product with K is needed.
    """
    greatest = 0.0
    for matrix in matrices:
        width = len(matrix)
        of_node = np.kron(np.eye(width // 3, dtype=bool), np.ones((3, 3), dtype=bool))
        used = np.flatnonzero(matrix.diagonal() > 0.0)
        if not used.size:
            continue  # held altogether
        inside = np.ix_(used, used)
        block = np.where(of_node, matrix, 0.0)[inside]
        greatest = max(greatest, float(eigh(matrix[inside], block, eigvals_only=True)[-1]))
    return greatest


def _geometric(
    groups: Sequence[Elements], lattice: Lattice | None, free: Bool, points: Float
) -> Coarser | None:
    if any(CELL_TYPES[group.name].has_midsides for group in groups):
        coarser = drop_midsides(groups, free)
        return _on_lattice(coarser, points[coarser.kept])
    if lattice is not None and 3 * len(free) > _COARSEST:
        return drop_planes(only_group(groups), lattice, free)
    return None


def _on_lattice(coarser: Coarser, points: Float) -> Coarser:
    """The same, with the lattice of the coarse hex8 elements where there is one."""
    group = coarser.groups[0] if len(coarser.groups) == 1 else None
    if not isinstance(group, Group) or group.name != "hex8":
        return coarser
    lattice = find_lattice(points, group.cells)
    if lattice is None:
        return coarser
    at, nodes = lattice.corner_nodes()
    order = lattice.cell.ravel()[at]
    if not (group.cells[order] == nodes).all():
        return coarser  # corners in another order than the lattice's
    group = Group("hex8", nodes, group.matrix_of[order], group.matrices)
    return Coarser(coarser.interpolation, coarser.kept, [group], lattice)


def _aggregate(
    levels: list[Level],
    product: Product | StencilProduct,
    free: Bool,
    points: Float,
    longest: int,
    column: Long | None,
    uneven_stiffness: bool,
) -> Hierarchy:
    """Aggregate until a few hundred unknowns remain, or ``longest`` in a narrow band; at first by
    ``column``, where nodes stand in columns."""
    origin = points.mean(axis=0)
    length = float(np.abs(points - origin).max()) or 1.0
    near_null, mask = rigid_modes(points, origin, length) * free[:, :, None], free
    stalled = False
    unknowns = free.size
    narrow = None
    while not levels or (unknowns > _COARSEST and not stalled):
        matrix_product = product if isinstance(product, Product) else Product(product.matrix)
        if levels and unknowns <= longest:
            narrow = narrow_order(matrix_product.matrix, levels[0].product.unknowns)
            if narrow is not None:
                break
        inverse = product.block_inverse(mask)
        smoother = None if column is None else Columns(matrix_product, mask, column)
        largest = largest_eigenvalue(product, smoother or inverse, _STEPS)
        single = not uneven_stiffness
        prolongation, near_null, mask = prolongator(
            matrix_product, smoother or inverse, largest, near_null, mask, single
        )
        coarser, transfer = galerkin(matrix_product, prolongation), MatrixTransfer(prolongation)
        twice = inverse.shape[1] == 6 and single
        levels.append(Level(product, inverse, largest, transfer, smoother, twice=twice))
        column = None
        unknowns = coarser.shape[0]
        stalled = unknowns > 0.9 * product.unknowns
        product = Product(coarser)
    coarsest_matrix = product.matrix
    if narrow is None and unknowns > _COARSEST and longest > _COARSEST_INVERTED:
        # loose bodies can't be aggregated any further, however many there are
        narrow = narrow_order(coarsest_matrix, levels[0].product.unknowns)
    if narrow is None and unknowns > _MOST_INVERTED:
        raise NotConverged(
            f"multigrid: aggregation ended at {unknowns} unknowns; expected at most "
            f"{_MOST_INVERTED} (are most elements loose from each other?); or method 'direct'"
        )
    solver = CoarseSolver(coarsest_matrix, mask, narrow)
    return Hierarchy(tuple(levels), solver, _lowest_eigenvalue(solver, levels, coarsest_matrix))


def _lowest_eigenvalue(solver: CoarseSolver, levels: list[Level], matrix: bsr_matrix) -> float:
    """Of K in the coarsest space, by inverse iteration.

    Interpolated values weigh on coarse nodes by their shares, P^T w for P^T diag(w) P: that is
    never less where shares aren't negative and add up to one, so the estimate errs to the low,
    safe side, by little for smooth motions. Aggregates have no such shares and are gone through.
    """
    weight: Real | None = None
    by_nodes = [level.transfer for level in levels if isinstance(level.transfer, NodeTransfer)]
    for transfer in by_nodes:
        weight = transfer.restrict(np.ones((1, transfer.shape[0])) if weight is None else weight)
    rest = levels[len(by_nodes) :]

    def overlap(x: Real) -> Real:
        for level in reversed(rest):
            x = level.transfer.interpolate(x)
        x = x if weight is None else weight * x
        for level in rest:
            x = level.transfer.restrict(x)
        return x

    x = noise(solver.unknowns, 5)
    image: Real = x[None]
    for _ in range(8):
        x = solver.solve(image)[0]
        x /= np.linalg.norm(x)
        image = overlap(x[None])
    return float((x @ (matrix @ x)) / (x @ image[0]))
