"""The system of K + s M: stiffness and a share of the mass.

Eigenvalues near a shift and implicit time steps ask for it. K is still applied by differences, so
that the rounding of a slender body's stiffness isn't felt any more than without. Mass goes into the
matrices of the elements: factors of congruent sections and coarse levels are made of these.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.sparse import csr_matrix

from gpusim.arrays.array_types import Float, Long
from gpusim.fem.assembly.assembly import Assembled, assemble_groups, assemble_lattice
from gpusim.fem.assembly.element_batches import DistinctGroup, Elements, Group, only_group
from gpusim.fem.assembly.equation import FormedElements
from gpusim.fem.assembly.geometric_stiffness import GeometricStiffness
from gpusim.fem.assembly.system import ElementForces, System, contrast, row_sum
from gpusim.fem.lattice.stencil import stencil_of
from gpusim.fem.model.mass import ElementMass
from gpusim.fem.sparse.block_rows import BlockRows


@dataclass(frozen=True, eq=False)
class Shift:
    """``factor`` times the mass, or another scalar matrix, of the ``elements``, whose sum is
    ``mass`` (N,N), the same for the three directions; in the model's units."""

    elements: ElementMass | GeometricStiffness
    mass: csr_matrix
    factor: float

    def forces(self, u: Float) -> Float:
        """(L,N,3) of displacements (L,N,3)."""
        side = np.moveaxis(u, 1, 0).reshape(u.shape[1], -1)
        moved = (self.factor * (self.mass @ side)).reshape(u.shape[1], len(u), 3)
        return np.asarray(np.moveaxis(moved, 1, 0))

    def matrices(self, group: Elements, numbers: Long, which: Long) -> Float:
        """(m,3k,3k) of ``which`` elements, which are the ``numbers`` (M,) of the mesh."""
        mass = self.elements.at(group.name, group.cells[which], numbers[which])
        return np.asarray(group.at(which) + self.factor * np.kron(mass, np.eye(3)))


def shifted_system(assembled: Assembled, system: System, shift: Shift) -> tuple[Assembled, System]:
    """What solvers take in place of K's ``system``; loads and supports are its own."""
    groups = [shifted_elements(group, shift) for group in assembled.groups]
    lattice, scale = assembled.lattice, system.scale
    if lattice is None:
        rows = with_row_sums(assemble_groups(groups, assembled.rows.node_count), shift)
    else:
        rows = with_row_sums(assemble_lattice(only_group(groups), lattice), shift)
    pull = None if system.pull is None else system.pull + shift.forces(system.prescribed)
    right = np.where(system.free, system.loads - (0.0 if pull is None else pull), 0.0)
    stencil = None
    if lattice is not None and system.stencil is not None:
        stencil = stencil_of(rows, lattice, scale)
    shifted = replace(
        system,
        apply=lambda u: system.apply(u) + shift.forces(u) / scale,
        row_sum=row_sum(rows) / scale,
        contrast=contrast(rows),
        elements=ElementForces(
            lambda u: system.elements.product(u) + shift.forces(u), system.elements.rounding
        ),
        right=right / system.load_scale[:, None, None],
        pull=pull,
        stencil=stencil,
    )
    return Assembled(rows, groups, lattice), shifted


def shifted_elements(group: Elements, shift: Shift) -> Elements:
    """Elements with their mass; what is none of the mesh's has none."""
    if isinstance(group, Group):
        assert group.numbers is not None
        _, first = np.unique(group.matrix_of, return_index=True)
        matrices = shift.matrices(group, group.numbers, first)
        return Group(group.name, group.cells, group.matrix_of, matrices, numbers=group.numbers)
    assert isinstance(group, DistinctGroup | FormedElements)
    if group.numbers is None:
        return group
    at = partial(shift.matrices, group, group.numbers)
    return FormedElements(group.name, group.cells, at, group.numbers)


def with_row_sums(rows: BlockRows, shift: Shift) -> BlockRows:
    """Rows that were assembled as those of K, which add up to zero: those of M don't."""
    _, first = np.unique(rows.row_class, return_index=True)
    sums = shift.factor * np.asarray(shift.mass.sum(axis=1)).ravel()[first]
    return replace(rows, diagonal=rows.diagonal + sums[:, None, None] * np.eye(3))
