"""Linear statics with linear equations between degrees of freedom, by sparse factorisation."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import qr, solve
from scipy.sparse import coo_matrix, csc_matrix, csr_matrix
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import SuperLU, splu

from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.errors import InputError, NotConverged
from gpusim.fem import Model, Solution
from gpusim.fem.assembly.assembly import group_matrix
from gpusim.fem.assembly.element_batches import model_groups
from gpusim.fem.assembly.stiffness_rounding import Deformation, signed
from gpusim.fem.model.model import resolve_formulation
from gpusim.fem.model.supports import rigid_modes
from gpusim.validation import require

_MOST_COUPLED = 3000
# an unknown is given up for an equation that holds it with at least this share of its largest
_LEAST_SHARE = 0.1


@dataclass(frozen=True, eq=False)
class Equations:
    """``matrix`` (m,3N) sparse times u, flattened, equals ``right`` (m,)."""

    matrix: csr_matrix
    right: Float

    @classmethod
    def build(
        cls, rows: Sequence[tuple[Sequence[int], Sequence[float], float]], unknowns: int
    ) -> Equations:
        """From (columns, factors, right side) of each equation."""
        number = np.repeat(np.arange(len(rows)), [len(columns) for columns, _, _ in rows])
        column = np.concatenate([columns for columns, _, _ in rows])
        factor = np.concatenate([factors for _, factors, _ in rows])
        matrix = coo_matrix((factor, (number, column)), shape=(len(rows), unknowns)).tocsr()
        return cls(matrix, np.array([right for _, _, right in rows], dtype=np.float64))


@dataclass(frozen=True, eq=False)
class Reduced:
    """u = ``matrix`` (n,k) sparse times the k unknowns that are left, plus ``shift`` (n,)."""

    matrix: csr_matrix
    shift: Float


def eliminate(held: csr_matrix, right: Float, where: str) -> Reduced:
    """Unknowns given up so that ``held`` (m,n) u = ``right`` (m,) holds for all that are left.

    An unknown that stands in one equation only is given up for it (a node tied to a surface has
    such); what remains is decided by a rank-revealing QR of the other equations. Equations that
    follow from others are left out. Raises InputError: contradictions, or more than 3000 equations
    that share all their unknowns.
    """
    held.sum_duplicates()
    held.eliminate_zeros()
    alone, column = _own_unknowns(held)
    rest = np.flatnonzero(~alone)
    got = f"{len(rest)} that share all their unknowns"
    require(len(rest) <= _MOST_COUPLED, f"{where}: equations", got, f"at most {_MOST_COUPLED}")
    inner, keep = _pivots(held[rest], right[rest], where)
    left = np.ones(held.shape[1], dtype=bool)
    left[column[alone]] = left[inner] = False
    stay = np.flatnonzero(left)
    size = (held.shape[1], len(stay))
    matrix = csr_matrix((np.ones(len(stay)), (stay, np.arange(len(stay)))), shape=size)
    shift = np.zeros(held.shape[1])
    # first the coupled ones, in terms of what stays; then the others, in terms of both
    if len(inner):
        kept = held[rest[keep]]
        block = kept[:, inner].toarray()
        used = np.unique(kept[:, stay].indices)
        table = -solve(block, kept[:, stay[used]].toarray())
        rows, columns = np.repeat(inner, len(used)), np.tile(used, len(inner))
        matrix = matrix + csr_matrix((table.ravel(), (rows, columns)), shape=size)
        shift[inner] = solve(block, right[rest[keep]])
    if alone.any():
        own, given_up = held[alone], column[alone]
        number = np.arange(len(given_up))
        factor = np.asarray(own[number, given_up]).ravel()
        shape = (held.shape[1], len(given_up))
        spread = csr_matrix((-1.0 / factor, (given_up, number)), shape=shape)
        shift += np.asarray(spread @ (own @ shift - right[alone]))
        matrix = matrix + spread @ (own @ matrix)
    return Reduced(csr_matrix(matrix), shift)


def _own_unknowns(held: csr_matrix) -> tuple[Bool, Long]:
    """Mask of equations with an unknown of their own, and its column (-1 where there is none)."""
    count = np.bincount(held.indices, minlength=held.shape[1])
    row = np.repeat(np.arange(held.shape[0]), np.diff(held.indptr))
    size = np.abs(held.data)
    largest = np.zeros(held.shape[0])
    np.maximum.at(largest, row, size)
    good = np.flatnonzero((count[held.indices] == 1) & (size >= _LEAST_SHARE * largest[row]))
    column = np.full(held.shape[0], -1, dtype=np.int64)
    # the largest one of a row is written last
    good = good[np.argsort(size[good], kind="stable")]
    column[row[good]] = held.indices[good]
    return column >= 0, column


def _pivots(held: csr_matrix, right: Float, where: str) -> tuple[Long, Bool]:
    """Columns to give up and the mask of equations that say something new."""
    keep = np.zeros(held.shape[0], dtype=bool)
    used = np.unique(held.indices)
    dense = held[:, used].toarray()
    size = np.linalg.norm(dense, axis=1)
    length = np.where(size > 0.0, size, 1.0)
    dense, target = dense / length[:, None], right / length
    columns = np.zeros(0, dtype=np.int64)
    if len(used):
        triangle, order = qr(dense.T, mode="r", pivoting=True)
        diagonal = np.abs(np.diag(triangle))
        keep[order[: int((diagonal > 1e-10 * diagonal[0]).sum())]] = True
        pivot = qr(dense[keep], mode="r", pivoting=True)[1]
        columns = used[pivot[: int(keep.sum())]].astype(np.int64)
    # the others must follow from those kept
    mix, *_ = np.linalg.lstsq(dense[keep].T, dense[~keep].T, rcond=None)
    bound = 1e-9 * max(float(np.abs(target).max(initial=0.0)), 1e-300)
    if not (np.abs(mix.T @ target[keep] - target[~keep]) <= bound).all():
        raise InputError(
            f"{where}: *EQUATION: equations contradict each other or the supports; expected "
            "constraints that can hold together"
        )
    return columns, keep


_MOST_UNKNOWNS = 100_000


@dataclass(frozen=True, eq=False)
class _ReducedSystem:
    """T'KT of the unknowns that ``reduced`` leaves of u's ``free`` (n,) ones, divided by ``scale``
    and factorised."""

    free: Long
    reduced: Reduced
    scale: float
    factor: SuperLU

    @classmethod
    def of(cls, stiffness: csr_matrix, free: Long, reduced: Reduced, where: str) -> _ReducedSystem:
        matrix = csc_matrix(reduced.matrix.T @ stiffness[free][:, free] @ reduced.matrix)
        scale = float(np.abs(matrix.diagonal()).max())
        return cls(free, reduced, scale, _factorised(csc_matrix(matrix / scale), where))

    def solved(self, loads: Float) -> Float:
        """What is left of the unknowns, under ``loads`` (3N,)."""
        return np.asarray(self.factor.solve(self.reduced.matrix.T @ loads[self.free] / self.scale))

    def refined(self, elements: Deformation, forces: Float, given: Float) -> tuple[Float, float]:
        """Displacements (3N,), which are ``given`` at the supports, and the share of them that is
        open."""
        matrix, shift = self.reduced.matrix, self.reduced.shift
        answer, u = np.zeros(matrix.shape[1]), given.copy()
        u[self.free] = shift

        def share(step: Float) -> float:
            size = float(np.abs(u).max())
            return float(np.abs(matrix @ step).max()) / (size if size > 0.0 else 1.0)

        for _ in range(6):
            correction = self.solved(forces - elements.product(u.reshape(1, -1, 3)).ravel())
            answer += correction
            u[self.free] = matrix @ answer + shift
            change = share(correction)
            if change <= 1e-12:
                break
        return u, change + share(
            self.solved(signed(elements.rounding(u.reshape(1, -1, 3))).ravel())
        )


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
    system = _ReducedSystem.of(stiffness, open_, reduced, where)
    forces = model.load_cases[0].ravel()
    elements = Deformation(groups, model.mesh.points)
    u, change = system.refined(elements, forces, given)
    if not change <= 1e-6:
        raise NotConverged(
            f"{where}: the refinement doesn't settle; got a change of {change:.3g} of the "
            "displacement; expected less than 1e-6 (a motion left free, or units far apart?)"
        )
    internal = elements.product(u.reshape(1, -1, 3)).ravel()
    reactions = internal - forces
    reactions[open_[~_touched(held)]] = 0.0
    unknowns = reduced.matrix.shape[1]
    return Solution(
        u=u.reshape(-1, 3),
        converged=True,
        error_estimate=change,
        iterations=0,
        residuals=np.zeros((0, 1)),
        reactions=reactions.reshape(-1, 3),
        strain_energy=np.array([0.5 * float(u @ internal)]),
        external_work=np.array([0.5 * float(u @ (forces + reactions))]),
        unknowns=unknowns,
        message=f"{len(open_) - unknowns} equations: factorised",
        warnings=(),
        timings={"assembly": assembled - start, "factorisation": time.perf_counter() - assembled},
        backend="numpy",
        real="f64",
        method="direct",
        element_classes=model.mesh.cell_count,
        row_classes=model.mesh.node_count,
        model=model,
    )


def _unknowns(model: Model, equations: Equations, where: str) -> Long:
    """Numbers of the degrees of freedom that no support holds, and that something moves."""
    assert model.fixed is not None
    coupled = _touched(equations.matrix).reshape(model.fixed.shape)
    free = ~model.fixed
    free[model.mesh.dangling_nodes] &= coupled[model.mesh.dangling_nodes]
    result = np.flatnonzero(free.ravel())
    fits = len(result) <= _MOST_UNKNOWNS
    why = "a deck with equations, ties or turned supports is factorised"
    got, expected = f"{len(result)} unknowns", f"at most {_MOST_UNKNOWNS} ({why})"
    require(fits, f"{where}: equations", got, expected)
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


def _touched(matrix: csr_matrix) -> Bool:
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
    free = modes.shape[1] - rank
    what = f"{where}: supports and equations leave {free} rigid-body motions free"
    require(free == 0, what, f"{len(parts)} parts", "supports that hold every part")
