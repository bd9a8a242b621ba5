"""The system of a model with constraints, by congruence: with u = T v (see ``Elimination``)

    T'K T v = T'f,

symmetric and positive definite like K, where the unknowns given up are as fixed ones are. Its
residual T'(f - K u) is formed with the complete u, in differences or by deformation, so that it is
as sharp as without constraints. Its matrix keeps blocks of 3x3, but rows needn't add up to zero.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.sparse import bsr_matrix, identity

from gpusim.arrays.array_types import Float
from gpusim.fem.assembly.assembly import Assembled
from gpusim.fem.assembly.system import ElementForces, System, contrast, row_sum, size_of_loads
from gpusim.fem.model.elimination import Elimination
from gpusim.fem.sparse.block_rows import BlockRows, block_matrix, block_rows

Forces = Callable[[Float], Float]


def reduced_rows(rows: BlockRows, elimination: Elimination) -> BlockRows:
    """T'K T. With T = I + S, where S has few rows, it is K + M + M' + M S for M = S'K: what
    constraints don't touch isn't multiplied."""
    stiffness = block_matrix(rows)
    follow = elimination.matrix - identity(stiffness.shape[0], format="csr")
    follow.eliminate_zeros()
    shares = follow.tobsr((3, 3))
    moved = bsr_matrix(shares.T @ stiffness)
    change = bsr_matrix(moved + moved.T + moved @ shares)
    whole = bsr_matrix(stiffness + change)
    whole.sort_indices()
    return block_rows(whole, rows.element_classes)


def reduced_system(
    assembled: Assembled, system: System, elimination: Elimination
) -> tuple[Assembled, System]:
    """What solvers take in place of the whole ``system``: unknowns are v. Its elements aren't
    known, only their sum."""
    rows = reduced_rows(assembled.rows, elimination)
    given_up, scale = elimination.given_up, system.scale
    free = elimination.unknowns(system.free)
    prescribed = np.where(given_up, elimination.offset, system.prescribed)

    sizes = replace(elimination, matrix=abs(elimination.matrix))

    def on_v(product: Forces, back: Elimination = elimination) -> Forces:
        return lambda v: back.forces(product(elimination.displacements(v)))

    apply, elements = on_v(system.apply), system.elements
    loads = elimination.forces(system.loads)
    pull = scale * apply(prescribed) if prescribed.any() else None
    right = np.where(free, loads - (0.0 if pull is None else pull), 0.0)
    load_scale = size_of_loads(right, scale)
    reduced = replace(
        system,
        apply=apply,
        rounding=on_v(system.rounding),
        row_sum=row_sum(rows) / scale,
        contrast=max(system.contrast, contrast(rows)),
        right=right / load_scale[:, None, None],
        free=free,
        load_scale=load_scale,
        prescribed=prescribed,
        pull=pull,
        loads=loads,
        # sizes: as if none took off from another
        elements=ElementForces(on_v(elements.product), on_v(elements.rounding, sizes)),
        stencil=None,
    )
    return Assembled(rows, [], None), reduced
