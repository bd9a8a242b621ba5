"""The scaled system of a model, whatever solves it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from gpusim.arrays.array_types import Bool, Float
from gpusim.fem.assembly.assembly import Assembled
from gpusim.fem.assembly.stiffness_rounding import (
    Deformation,
    check_finite,
    rounding_forces,
    signed,
)
from gpusim.fem.lattice.stencil import Stencil, StencilProduct, stencil_of
from gpusim.fem.model.model import Model
from gpusim.fem.sparse.block_rows import BlockRows
from gpusim.fem.sparse.matrix_product import Product
from gpusim.fem.sparse.stiffness_product import apply_stiffness

# nodes per distinct row from which on a stencil isn't larger than the matrix
_REPEATS = 8


@dataclass(frozen=True, eq=False)
class ElementForces:
    """(L,N,3) -> (L,N,3): the ``product`` K u, element by element, and what its ``rounding`` can
    come to; see ``Deformation``."""

    product: Callable[[Float], Float]
    rounding: Callable[[Float], Float]


@dataclass(frozen=True, eq=False)
class System:
    """The scaled problem K' u' = f': K' = K/scale, f' = f/load_scale per load case.

    ``right`` (L,N,3) is zero on fixed unknowns and includes what prescribed displacements pull.
    ``apply`` (L,N,3) -> K' u'; ``rounding`` the forces of its own rounding (see ``rounding``),
    which take a complete u', prescribed values included; ``row_sum`` bounds the sum of
    absolute values in a row of K', diagonal block left out. ``contrast`` is the ratio of the
    stiffest to the softest node. ``pull`` is K times the prescribed displacements, unscaled, None
    where there are none; both (1,N,3) or (L,N,3). ``loads`` (L,N,3) are what acts, in the model's
    units. ``free`` (N,3). ``elements`` are those of the body, for `by_deformation`.
    ``stencil`` is K' by place on a lattice whose rows repeat. ``first_case`` is the number of the
    first load case, for messages.
    """

    apply: Callable[[Float], Float]
    rounding: Callable[[Float], Float]
    row_sum: float
    contrast: float
    right: Float
    free: Bool
    scale: float
    load_scale: Float
    prescribed: Float
    pull: Float | None
    loads: Float
    elements: ElementForces
    stencil: Stencil | None = None
    first_case: int = 0

    def case(self, number: int) -> System:
        """One load case by itself."""
        rows = slice(number, number + 1)
        pull = self.pull
        return replace(
            self,
            right=self.right[rows],
            load_scale=self.load_scale[rows],
            loads=self.loads[rows],
            prescribed=self.prescribed[rows] if len(self.prescribed) > 1 else self.prescribed,
            pull=pull[rows] if pull is not None and len(pull) > 1 else pull,
            first_case=self.first_case + number,
        )

    def by_deformation(self) -> System:
        """The same with products that the rounding of turned elements' matrices doesn't reach
        (see `gpusim.fem.assembly.stiffness_rounding`); they take several times as long. ``apply``
        adds what is prescribed itself then, and ``right`` is the loads alone."""
        elements, scale = self.elements, self.scale
        factor = self.load_scale[:, None, None]
        # with what is prescribed: taken apart, a far motion of supports would be rounded twice
        given = self.prescribed * (scale / factor)
        return replace(
            self,
            apply=lambda u: elements.product(u + given) / scale,
            rounding=lambda u: signed(elements.rounding(u)) / scale,
            right=np.where(self.free, self.loads, 0.0) / factor,
            pull=None,
        )

    def forces(self, image: Float) -> Float:
        """K u (L,N,3) in the model's units, of the free part's ``image`` K' u'."""
        scaled = image * self.load_scale[:, None, None]
        return scaled if self.pull is None else scaled + self.pull


def make_system(model: Model, assembled: Assembled) -> System:
    """The system of a model's load cases."""
    assert model.fixed is not None
    free = ~model.fixed
    free[model.mesh.dangling_nodes] = False
    return scaled_system(
        assembled, model.mesh.points, free, model.load_cases, model.prescribed_cases
    )


def scaled_system(
    assembled: Assembled, points: Float, free: Bool, loads: Float, prescribed: Float
) -> System:
    """Right-hand sides with what ``prescribed`` displacements pull, and the scales; see
    `System`."""
    rows, lattice = assembled.rows, assembled.lattice
    # a power of two: the scaled problem has the same digits, and fits the range of float32
    largest = float(np.abs(rows.diagonal).max())
    scale = float(2.0 ** np.round(np.log2(largest)))
    pull = apply_stiffness(rows, prescribed) if prescribed.any() else None
    right = np.where(free, loads - (0.0 if pull is None else pull), 0.0)
    load_scale = size_of_loads(right, scale)
    stencil = None
    if lattice is not None and rows.class_count <= rows.node_count // _REPEATS:
        stencil = stencil_of(rows, lattice, scale)
    product = None if stencil is None else stencil.product
    by_runs = None if product is None else product.in_differences

    elements = Deformation(assembled.groups, points)

    def rounding(u: Float) -> Float:
        size = rounding_forces(rows, u)
        if pull is not None:
            # what is prescribed and what is solved for are rounded each by itself
            for part in (free, ~free):
                size += rounding_forces(rows, np.where(part, u, 0.0))
        return size * (elements.condition[:, None] / scale)

    return System(
        apply=(lambda u: apply_stiffness(rows, u) / scale) if by_runs is None else by_runs,
        stencil=stencil,
        rounding=rounding,
        row_sum=row_sum(rows) / scale,
        contrast=contrast(rows),
        right=right / load_scale[:, None, None],
        free=free,
        scale=scale,
        load_scale=load_scale,
        prescribed=prescribed,
        pull=pull,
        loads=loads,
        elements=ElementForces(elements.product, elements.rounding),
    )


def size_of_loads(right: Float, scale: float) -> Float:
    """(L,) powers of two near the greatest force of each right-hand side (L,N,3)."""
    size = np.abs(right).max(axis=(1, 2))
    load_scale: Float = np.exp2(np.round(np.log2(np.where(size > 0.0, size, 1.0))))
    with np.errstate(over="ignore"):
        check_finite(np.append(scale / load_scale, 1.0 / scale), "stiffness over loads")
    return load_scale


def finest_product(rows: BlockRows, system: System) -> Product | StencilProduct:
    """K / scale in the form that takes the least: by place, as its own table, or assembled."""
    if system.stencil is not None:
        return system.stencil.operator
    return Product.of_rows(rows, system.scale)


def contrast(rows: BlockRows) -> float:
    """Greatest over least trace of the diagonal blocks, nodes of no cell left out."""
    trace = np.einsum("cii->c", rows.diagonal)
    trace = trace[trace > 0.0]
    return float(trace.max() / trace.min()) if trace.size else 1.0


def row_sum(rows: BlockRows) -> float:
    """At least the sum of absolute values in any row of K without its diagonal block.

    K is positive semidefinite, so no entry exceeds the greatest one on its diagonal.
    """
    return 3.0 * float(rows.degree.max(initial=0)) * float(np.abs(rows.diagonal).max())
