"""The scaled system of a model."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.sparse import bsr_matrix

from gpusim.fem.assembly import Assembled
from gpusim.fem.block_rows import BlockRows, block_matrix
from gpusim.fem.iterate import System
from gpusim.fem.model import Model
from gpusim.fem.product import RowsProduct
from gpusim.fem.rounding import rounding_forces
from gpusim.fem.stencil import Stencil, stencil_of
from gpusim.fem.stiffness import apply_stiffness

__all__ = ["finest_matrix", "make_system"]

Float = npt.NDArray[np.float64]

# nodes per distinct row from which on a stencil isn't larger than the matrix
_REPEATS = 8


def make_system(model: Model, assembled: Assembled) -> System:
    """Free unknowns, right-hand sides with what prescribed displacements pull, and the scales."""
    rows, lattice = assembled.rows, assembled.lattice
    assert model.fixed is not None
    free = ~model.fixed
    free[model.mesh.dangling_nodes] = False
    # a power of two: the scaled problem has the same digits, and fits the range of float32
    largest = float(np.abs(rows.diagonal).max())
    scale = float(2.0 ** np.round(np.log2(largest)))
    prescribed = model.prescribed_cases
    pull = apply_stiffness(rows, prescribed) if prescribed.any() else None
    right = np.where(free, model.load_cases - (0.0 if pull is None else pull), 0.0)
    size = np.abs(right).max(axis=(1, 2))
    load_scale: Float = np.exp2(np.round(np.log2(np.where(size > 0.0, size, 1.0))))
    stencil = None
    if lattice is not None and rows.class_count <= rows.node_count // _REPEATS:
        stencil = stencil_of(rows, lattice, scale)
    product = None if stencil is None else stencil.product
    by_runs = None if product is None else product.in_differences
    return System(
        apply=(lambda u: apply_stiffness(rows, u) / scale) if by_runs is None else by_runs,
        stencil=stencil,
        rounding=lambda u: rounding_forces(rows, u) / scale,
        row_sum=_row_sum(rows) / scale,
        contrast=_contrast(rows),
        right=right / load_scale[:, None, None],
        free=free,
        scale=scale,
        load_scale=load_scale,
        prescribed=prescribed,
        pull=pull,
    )


def finest_matrix(rows: BlockRows, system: System) -> bsr_matrix | Stencil | RowsProduct:
    """K / scale in the form that takes the least: by place, as its own table, or assembled."""
    if system.stencil is not None:
        return system.stencil
    if RowsProduct.fits(rows):
        return RowsProduct(rows, system.scale)
    return block_matrix(rows, system.scale)


def _contrast(rows: BlockRows) -> float:
    """Greatest over least trace of the diagonal blocks, nodes of no cell left out."""
    trace = np.einsum("cii->c", rows.diagonal)
    trace = trace[trace > 0.0]
    return float(trace.max() / trace.min()) if trace.size else 1.0


def _row_sum(rows: BlockRows) -> float:
    """At least the sum of absolute values in any row of K without its diagonal block.

    K is positive semidefinite, so no entry exceeds the greatest one on its diagonal.
    """
    return 3.0 * float(rows.degree.max(initial=0)) * float(np.abs(rows.diagonal).max())
