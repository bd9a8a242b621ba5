"""The system of K + s M + D: stiffness, a share of the mass, and blocks on the diagonal.

Eigenvalues near a shift, implicit time steps and elastic supports ask for it. K is still applied by
differences, so that the rounding of a slender body's stiffness isn't felt any more than without.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import bsr_matrix, csr_matrix, identity, kron

from gpusim.arrays.array_types import Float
from gpusim.fem.assembly.assembly import Assembled
from gpusim.fem.assembly.system import ElementForces, System, contrast, row_sum
from gpusim.fem.sparse.block_rows import block_diagonal, block_matrix, block_rows


@dataclass(frozen=True, eq=False)
class Shift:
    """``factor`` times the scalar ``mass`` (N,N), the same for the three directions, and blocks
    ``diagonal`` (N,3,3), both in the model's units."""

    mass: csr_matrix
    factor: float
    diagonal: Float

    def forces(self, u: Float) -> Float:
        """(L,N,3) of displacements (L,N,3)."""
        moved = [self.factor * (self.mass @ one) for one in u]
        return np.asarray(np.stack(moved) + np.einsum("nij,lnj->lni", self.diagonal, u))

    @property
    def matrix(self) -> bsr_matrix:
        """(3N,3N)."""
        mass = kron(self.factor * self.mass, identity(3), format="bsr")
        return bsr_matrix(mass.tobsr((3, 3)) + block_diagonal(self.diagonal))


def shifted_system(assembled: Assembled, system: System, shift: Shift) -> tuple[Assembled, System]:
    """What solvers take in place of K's ``system``; loads and supports are its own."""
    whole = bsr_matrix(block_matrix(assembled.rows) + shift.matrix)
    whole.sort_indices()
    rows, scale = block_rows(whole, assembled.rows.element_classes), system.scale
    pull = None if system.pull is None else system.pull + shift.forces(system.prescribed)
    right = np.where(system.free, system.loads - (0.0 if pull is None else pull), 0.0)
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
        stencil=None,
    )
    return Assembled(rows, [], None), shifted
