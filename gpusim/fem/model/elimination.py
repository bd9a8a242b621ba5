"""Linear equations resolved: displacements given up and those they follow, u = T v + g.

Equations are triangularised without filling in: one that holds an unknown which no other equation
has is set aside with it; without that equation other unknowns may stand in one alone, and so on
(the singletons of Markowitz' pivoting). Ties are resolved in one round, chains of ties in as many
as they are long. What is left, equations that share all their unknowns, is taken apart into those
that are connected, and each part is decided by a rank-revealing QR.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import inv, qr
from scipy.sparse import block_diag, bmat, csr_matrix, diags, vstack
from scipy.sparse.csgraph import connected_components

from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.errors import InputError
from gpusim.fem.model.constraints import touched
from gpusim.fem.model.model import Model
from gpusim.validation import require

# equations that share all their unknowns with one another, at most
_MOST_COUPLED = 3000
# an unknown is given up for an equation that holds it with this share of its largest; where there
# is none, with that one
_SHARES = (0.9, 0.1)
# of the largest factor of an equation: below it is rounding
_ROUNDING = 1e-12
# of the numbers of an equation: what they may leave where it follows from others
_CONSISTENT = 1e-9
# of the greatest pivot: below it an equation follows from others
_DEPENDENT = 1e-10
# terms that equations add to the stiffness, at most: 7 GB
_MOST_FILL = 1e8


@dataclass(frozen=True, eq=False)
class Elimination:
    """u = ``matrix`` (3N,3N) v, where v is u but for the unknowns ``given_up`` (N,3): there it is
    what u differs by from the unknowns that it follows, ``offset`` (N,3).

    Given up unknowns are to v as fixed ones are, with ``offset`` prescribed. ``loose`` (N,3) are
    those of nodes of no cell that equations move and no support holds.
    """

    matrix: csr_matrix
    given_up: Bool
    offset: Float
    loose: Bool

    def unknowns(self, free: Bool) -> Bool:
        """(N,3) what is solved for, where ``free`` (N,3) are the unknowns that no support holds."""
        return (free | self.loose) & ~self.given_up

    def displacements(self, v: Float) -> Float:
        """u (L,N,3) of v."""
        return np.asarray((self.matrix @ v.reshape(len(v), -1).T).T.reshape(v.shape))

    def forces(self, f: Float) -> Float:
        """What forces (L,N,3) on u do to v."""
        return np.asarray((self.matrix.T @ f.reshape(len(f), -1).T).T.reshape(f.shape))


@dataclass(frozen=True, eq=False)
class _Pivots:
    """Equations ``rows`` (k,) resolved for the unknowns ``columns`` (k,); ``inverse`` (k,k) sparse
    of the factors that they have there."""

    rows: Long
    columns: Long
    inverse: csr_matrix


def solved_for(model: Model) -> Bool:
    """(N,3) what of a model's displacements is unknown: neither held, nor given up, nor of a node
    without cells. Raises InputError for equations that can't be resolved."""
    assert model.fixed is not None
    free, elimination = ~model.fixed, eliminate(model)
    free[model.mesh.dangling_nodes] = False
    return free if elimination is None else elimination.unknowns(free)


def eliminate(model: Model) -> Elimination | None:
    """The equations of a model resolved; None where it has none.

    Raises InputError: equations that contradict each other or the supports, and such as can't be
    resolved sparsely (more than 3000 that share all their unknowns; long ones that would fill the
    stiffness).
    """
    if not model.constraints:
        return None
    assert model.fixed is not None
    shape, size = model.fixed.shape, model.fixed.size
    matrix, right = normalised_equations(model)
    held = model.fixed.ravel()
    known = np.where(held, model.prescribed_cases.reshape(-1, size), 0.0)
    # what is open, of numbers of what size
    residual = right[:, None] - matrix @ known.T
    level = np.abs(right)[:, None] + abs(matrix) @ np.abs(known.T)
    unknown = csr_matrix(matrix @ diags((~held).astype(np.float64)))
    unknown.eliminate_zeros()
    rounds, rest = _triangularised(unknown)
    # first the coupled ones, in terms of what stays; then those set aside, the last one first
    steps = [_coupled(unknown, rest, residual, level), *reversed(rounds)]
    given_up = np.zeros(size, dtype=bool)
    given_up[np.concatenate([one.columns for one in steps])] = True
    share, offset = csr_matrix(diags((~given_up).astype(np.float64))), np.zeros(size)
    for one in steps:
        equations = matrix[one.rows]
        place = np.ones(len(one.rows)), (one.columns, np.arange(len(one.rows)))
        spread = csr_matrix(place, shape=(size, len(one.rows))) @ one.inverse
        offset -= spread @ (equations @ offset - right[one.rows])
        share = share - spread @ (equations @ share)
    dangling = model.mesh.dangling_nodes
    loose, stiff = np.zeros(shape, dtype=bool), given_up.reshape(shape).copy()
    stiff[dangling] = False
    loose[dangling] = (touched(model.constraints, shape) & ~model.fixed)[dangling]
    fill = float((np.diff(share.indptr)[stiff.ravel()].astype(np.float64) ** 2).sum())
    expected = f"at most {_MOST_FILL:.0e} (do some hold thousands of displacements?)"
    require(fill <= _MOST_FILL, "constraints: terms in the stiffness", f"{fill:.0e}", expected)
    whole = csr_matrix(share + diags(given_up.astype(np.float64)))
    return Elimination(whole, given_up.reshape(shape), offset.reshape(shape), loose)


def normalised_equations(model: Model) -> tuple[csr_matrix, Float]:
    """(m,3N) sparse and (m,): the equations of a model over their largest factors, without terms
    that are rounding beside these."""
    if not model.constraints:
        return csr_matrix((0, model.mesh.points.size)), np.zeros(0)
    matrix = csr_matrix(vstack([one.matrix for one in model.constraints]))
    right = np.concatenate([one.right for one in model.constraints])
    matrix.sum_duplicates()
    largest = abs(matrix).max(axis=1).toarray().ravel()
    factor = 1.0 / np.where(largest > 0.0, largest, 1.0)
    matrix = csr_matrix(diags(factor) @ matrix)
    matrix.data[np.abs(matrix.data) <= _ROUNDING] = 0.0
    matrix.eliminate_zeros()
    return matrix, factor * right


def _triangularised(unknown: csr_matrix) -> tuple[list[_Pivots], Long]:
    """Equations and the unknowns that they give up, round by round: none of a round's unknowns
    stands in equations of later rounds; and those that are left."""
    rounds, rest = [], np.arange(unknown.shape[0])
    rows, shares = unknown, list(_SHARES)
    while rest.size and shares:
        column = _own_unknowns(rows, shares[0])
        own = column >= 0
        if own.any():
            factor = np.asarray(rows[np.flatnonzero(own), column[own]]).ravel()
            rounds.append(_Pivots(rest[own], column[own], csr_matrix(diags(1.0 / factor))))
            rest, rows, shares = rest[~own], rows[~own], list(_SHARES)
        else:
            shares.pop(0)
    return rounds, rest


def _own_unknowns(rows: csr_matrix, share: float) -> Long:
    """(m,) the unknown that stands in that equation alone, with at least this ``share`` of its
    largest factor: of several the one with the largest; -1 where there is none."""
    count = np.bincount(rows.indices, minlength=rows.shape[1])
    row = np.repeat(np.arange(rows.shape[0]), np.diff(rows.indptr))
    size, largest = np.abs(rows.data), abs(rows).max(axis=1).toarray().ravel()
    good = np.flatnonzero((count[rows.indices] == 1) & (size >= share * largest[row]))
    column = np.full(rows.shape[0], -1, dtype=np.int64)
    # the largest one of a row is written last
    good = good[np.argsort(size[good], kind="stable")]
    column[row[good]] = rows.indices[good]
    return column


def _coupled(unknown: csr_matrix, rest: Long, residual: Float, level: Float) -> _Pivots:
    """The equations ``rest``, which share all their unknowns, connected part by connected part:
    those that say something new, and as many unknowns. The fixed ones leave ``residual`` (m,L)
    open, in numbers of size ``level``. Raises InputError for contradictions."""
    core = unknown[rest]
    used = core.getnnz(axis=1) > 0
    _refuse_contradictions(residual[rest[~used]], level[rest[~used]])
    rest, core = rest[used], core[used]
    count = len(rest)
    if not count:
        return _Pivots(rest, rest, csr_matrix((0, 0)))
    # equations and unknowns as the nodes of a graph
    graph = bmat([[None, core], [csr_matrix(core.T), None]])
    part = connected_components(graph, directed=False)[1][:count]
    order = np.argsort(part, kind="stable")
    rows, columns, inverses = [], [], []
    for members in np.split(order, np.flatnonzero(np.diff(part[order])) + 1):
        got, expected = f"{len(members)} that share all", f"at most {_MOST_COUPLED}"
        require(len(members) <= _MOST_COUPLED, "constraints: equations", got, expected)
        equations = rest[members]
        keep, pivots, inverse = _pivots(core[members], residual[equations], level[equations])
        rows.append(equations[keep])
        columns.append(pivots)
        inverses.append(inverse)
    whole: csr_matrix = csr_matrix(block_diag(inverses, format="csr"))
    return _Pivots(np.concatenate(rows), np.concatenate(columns), whole)


def _pivots(rows: csr_matrix, residual: Float, level: Float) -> tuple[Bool, Long, Float]:
    """Mask of the equations that say something new, the unknowns to give up for them, and the
    inverse of the factors that they have there."""
    keep = np.zeros(rows.shape[0], dtype=bool)
    used, place = np.unique(rows.indices, return_inverse=True)
    dense = csr_matrix((rows.data, place, rows.indptr), (len(keep), len(used))).toarray()
    length = np.linalg.norm(dense, axis=1)[:, None]
    dense, residual, level = dense / length, residual / length, level / length
    triangle, order = qr(dense.T, mode="r", pivoting=True)
    diagonal = np.abs(np.diag(triangle))
    keep[order[: int((diagonal > _DEPENDENT * diagonal[0]).sum())]] = True
    pivot = qr(dense[keep], mode="r", pivoting=True)[1][: int(keep.sum())]
    # the others must follow from those kept
    mixed, *_ = np.linalg.lstsq(dense[keep].T, dense[~keep].T, rcond=None)
    _refuse_contradictions(mixed.T @ residual[keep] - residual[~keep], level.max(initial=0.0))
    return keep, used[pivot].astype(np.int64), inv(dense[keep][:, pivot]) / length[keep].T


def _refuse_contradictions(difference: Float, level: Float | float) -> None:
    if not (np.abs(difference) <= _CONSISTENT * np.maximum(level, 1e-300)).all():
        raise InputError(
            f"constraints: equations contradict each other or the supports; got a difference of "
            f"{np.abs(difference).max():.3g} between displacements that they ask for; expected "
            "constraints that can hold together"
        )
