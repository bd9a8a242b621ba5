"""Linear statics with linear equations between degrees of freedom, by sparse factorisation."""

from __future__ import annotations

import time
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
from scipy.sparse import csc_matrix, csr_matrix
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import SuperLU, splu

from gpusim.deck.equations import Equations, eliminate
from gpusim.errors import InputError, NotConverged
from gpusim.fem import Model, Solution
from gpusim.fem.assembly.assembly import group_matrix
from gpusim.fem.assembly.element_batches import model_groups
from gpusim.fem.assembly.stiffness_rounding import Deformation, signed
from gpusim.fem.model.model import resolve_formulation
from gpusim.fem.model.supports import rigid_modes

__all__ = ["solve_constrained"]

Float = npt.NDArray[np.float64]

_MOST_UNKNOWNS = 100_000


def solve_constrained(
    model: Model, equations: Equations, formulation: Mapping[str, str], where: str
) -> Solution:
    """The solution of a model with one load case, held by its supports and by ``equations``.

    Each equation gives up one unknown, u = T q + s, so that T'KT q = T'(f - K s) is symmetric and
    positive definite; it is factorised in float64 and refined with residuals by deformation (see
    `gpusim.fem.assembly.stiffness_rounding`) until a correction is below 1e-12 of u (five at
    most). The last correction over u, and what the rounding of element matrices leaves open, is the
    error estimate. ``reactions`` holds the forces of supports and equations.

    Raises InputError: equations that contradict each other, motions left free, a deck too large
    for this way (100 000 unknowns). NotConverged: the factorisation failed.
    """
    start = time.perf_counter()
    assert model.fixed is not None
    open_ = _unknowns(model, equations, where)
    groups = model_groups(model, resolve_formulation(model, formulation))
    stiffness = group_matrix(groups, model.mesh.node_count).tocsr()
    assembled = time.perf_counter()
    given = np.where(model.fixed, model.prescribed_cases[0], 0.0).ravel()
    held = csr_matrix(equations.matrix[:, open_])
    _refuse_free(model, stiffness, equations.matrix, where)
    reduced = eliminate(held, equations.right - equations.matrix @ given, where)
    own = stiffness[open_][:, open_]
    forces = model.load_cases[0].ravel()
    system = csc_matrix(reduced.matrix.T @ own @ reduced.matrix)
    scale = float(np.abs(system.diagonal()).max())
    factor = _factorised(csc_matrix(system / scale), where)
    shape = model.mesh.points.shape
    elements = Deformation(groups, model.mesh.points)
    answer, u = np.zeros(system.shape[0]), given.copy()
    u[open_] = reduced.shift

    def solved(loads: Float) -> Float:
        return np.asarray(factor.solve(reduced.matrix.T @ loads[open_] / scale))

    def share(step: Float) -> float:
        size = float(np.abs(u).max())
        return float(np.abs(reduced.matrix @ step).max()) / (size if size > 0.0 else 1.0)

    for _ in range(6):
        correction = solved(forces - elements.product(u.reshape(1, *shape)).ravel())
        answer += correction
        u[open_] = reduced.matrix @ answer + reduced.shift
        change = share(correction)
        if change <= 1e-12:
            break
    change += share(solved(signed(elements.rounding(u.reshape(1, *shape))).ravel()))
    if not change <= 1e-6:
        raise NotConverged(
            f"{where}: the refinement doesn't settle; got a change of {change:.3g} of the "
            "displacement; expected less than 1e-6 (a motion left free, or units far apart?)"
        )
    internal = elements.product(u.reshape(1, *shape)).ravel()
    reactions = internal - forces
    reactions[open_[~_touched(held)]] = 0.0
    return Solution(
        u=u.reshape(shape),
        converged=True,
        error_estimate=change,
        iterations=0,
        residuals=np.zeros((0, 1)),
        reactions=reactions.reshape(shape),
        strain_energy=np.array([0.5 * float(u @ internal)]),
        external_work=np.array([0.5 * float(u @ (forces + reactions))]),
        unknowns=len(answer),
        message=f"{len(open_) - len(answer)} equations: factorised",
        warnings=(),
        timings={
            "assembly": assembled - start,
            "factorisation": time.perf_counter() - assembled,
        },
        backend="numpy",
        real="f64",
        method="direct",
        element_classes=model.mesh.cell_count,
        row_classes=model.mesh.node_count,
    )


def _unknowns(model: Model, equations: Equations, where: str) -> npt.NDArray[np.int64]:
    """Numbers of the degrees of freedom that no support holds, and that something moves."""
    assert model.fixed is not None
    coupled = _touched(equations.matrix).reshape(model.fixed.shape)
    free = ~model.fixed
    free[model.mesh.dangling_nodes] &= coupled[model.mesh.dangling_nodes]
    result = np.flatnonzero(free.ravel())
    if len(result) > _MOST_UNKNOWNS:
        raise InputError(
            f"{where}: equations: got {len(result)} unknowns; expected at most {_MOST_UNKNOWNS} "
            "(a deck with equations, ties or turned supports is factorised)"
        )
    return result


def _factorised(matrix: csc_matrix, where: str) -> SuperLU:
    try:
        return splu(
            matrix,
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
    except RuntimeError as error:
        raise NotConverged(f"{where}: the factorisation failed ({error})") from None


def _touched(matrix: csr_matrix) -> npt.NDArray[np.bool_]:
    """Mask of the columns that hold a number other than zero."""
    return np.bincount(matrix.indices[matrix.data != 0.0], minlength=matrix.shape[1]) > 0


def _refuse_free(model: Model, stiffness: csr_matrix, matrix: csr_matrix, where: str) -> None:
    """Supports and equations must hold the rigid-body motions of every part."""
    nodes = model.mesh.node_count
    graph = csr_matrix(stiffness, copy=True).tobsr((3, 3))
    blocks = csr_matrix((np.ones(len(graph.indices)), graph.indices, graph.indptr), (nodes, nodes))
    part = connected_components(blocks, directed=False)[1]
    used = np.ones(nodes, dtype=bool)
    used[model.mesh.dangling_nodes] = False
    parts = np.unique(part[used])
    assert model.fixed is not None
    points = model.mesh.points
    origin = points[used].mean(axis=0)
    length = float(np.abs(points[used] - origin).max())
    modes = np.zeros((3 * nodes, 6 * len(parts)))
    for k, one in enumerate(parts):
        inside = np.flatnonzero(used & (part == one))
        motion = rigid_modes(points[inside], origin, length).reshape(-1, 6)
        rows = (3 * inside[:, None] + np.arange(3)).ravel()
        modes[rows, 6 * k : 6 * k + 6] = motion
    held = np.concatenate([modes[model.fixed.ravel()], matrix @ modes])
    rank = np.linalg.matrix_rank(held, tol=1e-9 * max(1.0, float(np.abs(held).max(initial=0.0))))
    if rank < modes.shape[1]:
        raise InputError(
            f"{where}: supports and equations leave {modes.shape[1] - rank} rigid-body motions "
            f"free; got {len(parts)} parts; expected supports that hold every part"
        )
