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
from scipy.linalg import qr, solve
from scipy.sparse import coo_matrix, csr_matrix, diags, vstack
from scipy.sparse.csgraph import connected_components

from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.arrays.unique import mix, unique_hashes
from gpusim.errors import InputError
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

    Given up unknowns are to v as fixed ones are, with ``offset`` prescribed. ``touched`` (N,3) are
    the unknowns that stand in equations.
    """

    matrix: csr_matrix
    given_up: Bool
    offset: Float
    touched: Bool

    def displacements(self, v: Float) -> Float:
        """u (L,N,3) of v."""
        return np.asarray((self.matrix @ v.reshape(len(v), -1).T).T.reshape(v.shape))

    def forces(self, forces: Float) -> Float:
        """What forces (L,N,3) on u do to v."""
        return np.asarray((self.matrix.T @ forces.reshape(len(forces), -1).T).T).reshape(
            forces.shape
        )

    def sizes(self, sizes: Float) -> Float:
        """The same of their sizes alone, as if none took off from another."""
        return np.asarray((abs(self.matrix).T @ sizes.reshape(len(sizes), -1).T).T).reshape(
            sizes.shape
        )


def eliminate(model: Model) -> Elimination | None:
    """The equations of a model resolved; None where it has none.

    Raises InputError: equations that contradict each other or the supports, and such as can't be
    resolved sparsely (more than 3000 that share all their unknowns; long ones that would fill the
    stiffness).
    """
    if not model.constraints:
        return None
    assert model.fixed is not None
    fixed, size = model.fixed.ravel(), model.fixed.size
    matrix, right = _each_once(*normalised_equations(model))
    known = np.where(fixed, model.prescribed_cases.reshape(-1, size), 0.0)
    # what is open, of how large numbers
    residual = right[:, None] - matrix @ known.T
    level = np.abs(right)[:, None] + abs(matrix) @ np.abs(known.T)
    unknown = csr_matrix(matrix @ diags((~fixed).astype(np.float64)))
    unknown.eliminate_zeros()
    rounds, rest = _triangularised(unknown)
    given_up = np.zeros(size, dtype=bool)
    for _, column in rounds:
        given_up[column] = True
    core = _Core.of(unknown, rest, residual, level)
    given_up[core.columns] = True
    kept = diags((~given_up).astype(np.float64))
    share, shift = csr_matrix(kept), np.zeros(size)
    # first the coupled ones, in terms of what stays; then those set aside, the last one first
    share, shift = core.resolved(matrix, right, share, shift)
    for rows, column in reversed(rounds):
        own = matrix[rows]
        factor = np.asarray(own[np.arange(len(rows)), column]).ravel()
        at = (column, np.arange(len(rows)))
        spread = csr_matrix((-1.0 / factor, at), shape=(size, len(rows)))
        shift += np.asarray(spread @ (own @ shift - right[rows]))
        share = share + spread @ (own @ share)
    stiff = np.ones(model.fixed.shape, dtype=bool)
    stiff[model.mesh.dangling_nodes] = False
    terms = np.diff(share.indptr)[given_up & stiff.ravel()].astype(np.float64)
    fill = float((terms**2).sum())
    expected = f"at most {_MOST_FILL:.0e} (do some hold thousands of displacements?)"
    require(fill <= _MOST_FILL, "constraints: terms in the stiffness", f"{fill:.0e}", expected)
    shape = model.fixed.shape
    touched = np.bincount(matrix.indices, minlength=size).reshape(shape) > 0
    whole = csr_matrix(share + diags(given_up.astype(np.float64)))
    return Elimination(whole, given_up.reshape(shape), shift.reshape(shape), touched)


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


def _each_once(matrix: csr_matrix, right: Float) -> tuple[csr_matrix, Float]:
    """Equations without those that are said again."""
    row = np.repeat(np.arange(len(right)), np.diff(matrix.indptr))
    streams = []
    for seed in (20, 30):
        term = mix(matrix.data.view(np.int64), seed) + mix(matrix.indices, seed + 1)
        total = mix(right.view(np.int64), seed + 2)
        # sums don't depend on the order of terms; overflow wraps around, as hashes may
        np.add.at(total, row, mix(term, seed + 3))
        streams.append(total)
    first, _ = unique_hashes(*streams)
    return matrix[first], right[first]


def _triangularised(unknown: csr_matrix) -> tuple[list[tuple[Long, Long]], Long]:
    """Equations and the unknowns that they give up, round by round: none of a round's unknowns
    stands in equations of later rounds; and those that are left."""
    rounds, rest = [], np.arange(unknown.shape[0])
    rows, shares = unknown, list(_SHARES)
    while rest.size and shares:
        column = _own_unknowns(rows, shares[0])
        own = column >= 0
        if own.any():
            rounds.append((rest[own], column[own]))
            rest, rows, shares = rest[~own], rows[~own], list(_SHARES)
        else:
            shares.pop(0)
    return rounds, rest


def _own_unknowns(rows: csr_matrix, share: float) -> Long:
    """(m,) the unknown that stands in that equation alone, with at least this ``share`` of its
    largest factor: of several the one with the largest; -1 where there is none."""
    count = np.bincount(rows.indices, minlength=rows.shape[1])
    row = np.repeat(np.arange(rows.shape[0]), np.diff(rows.indptr))
    size = np.abs(rows.data)
    largest = np.zeros(rows.shape[0])
    np.maximum.at(largest, row, size)
    good = np.flatnonzero((count[rows.indices] == 1) & (size >= share * largest[row]))
    column = np.full(rows.shape[0], -1, dtype=np.int64)
    # the largest one of a row is written last
    good = good[np.argsort(size[good], kind="stable")]
    column[row[good]] = rows.indices[good]
    return column


@dataclass(frozen=True, eq=False)
class _Core:
    """Equations that share all their unknowns: of each connected part the ``rows`` that say
    something new and as many ``pivots`` to give up."""

    rows: list[Long]
    pivots: list[Long]

    @property
    def columns(self) -> Long:
        return np.concatenate([np.zeros(0, dtype=np.int64), *self.pivots])

    @staticmethod
    def of(unknown: csr_matrix, rest: Long, residual: Float, level: Float) -> _Core:
        """Of the equations ``rest``, whose fixed unknowns leave ``residual`` (m,L) open, in numbers
        of size ``level``. Raises InputError for contradictions."""
        core = unknown[rest]
        used = core.getnnz(axis=1) > 0
        _refuse_contradictions(residual[rest[~used]], level[rest[~used]])
        rest, core = rest[used], core[used]
        count = len(rest)
        links = coo_matrix(core)
        graph = coo_matrix(
            (np.ones(len(links.row)), (links.row, count + links.col)),
            shape=(count + core.shape[1],) * 2,
        )
        part = connected_components(graph.tocsr(), directed=False)[1][:count]
        order = np.argsort(part, kind="stable")
        rows, pivots = [], []
        for members in np.split(order, np.flatnonzero(np.diff(part[order])) + 1):
            if not members.size:
                continue
            got, expected = f"{len(members)} that share all", f"at most {_MOST_COUPLED}"
            require(len(members) <= _MOST_COUPLED, "constraints: equations", got, expected)
            equations = rest[members]
            columns, keep = _pivots(core[members], residual[equations], level[equations])
            rows.append(equations[keep])
            pivots.append(columns)
        return _Core(rows, pivots)

    def resolved(
        self, matrix: csr_matrix, right: Float, share: csr_matrix, shift: Float
    ) -> tuple[csr_matrix, Float]:
        """``share`` and ``shift`` with the rows of the unknowns given up here."""
        entries = []
        for rows, pivots in zip(self.rows, self.pivots, strict=True):
            kept = matrix[rows]
            others = np.setdiff1d(kept.indices, pivots)
            block = kept[:, pivots].toarray()
            table = -solve(block, kept[:, others].toarray())
            shift[pivots] = solve(block, right[rows])
            entries.append(
                (table.ravel(), np.repeat(pivots, len(others)), np.tile(others, len(pivots)))
            )
        if entries:
            values, row, column = (np.concatenate(part) for part in zip(*entries, strict=True))
            share = share + coo_matrix((values, (row, column)), shape=share.shape).tocsr()
        return share, shift


def _pivots(rows: csr_matrix, residual: Float, level: Float) -> tuple[Long, Bool]:
    """Columns to give up and the mask of equations that say something new."""
    keep = np.zeros(rows.shape[0], dtype=bool)
    used = np.unique(rows.indices)
    dense = rows[:, used].toarray()
    length = np.linalg.norm(dense, axis=1)[:, None]
    dense, residual, level = dense / length, residual / length, level / length
    triangle, order = qr(dense.T, mode="r", pivoting=True)
    diagonal = np.abs(np.diag(triangle))
    keep[order[: int((diagonal > _DEPENDENT * diagonal[0]).sum())]] = True
    pivot = qr(dense[keep], mode="r", pivoting=True)[1]
    # the others must follow from those kept
    mixed, *_ = np.linalg.lstsq(dense[keep].T, dense[~keep].T, rcond=None)
    _refuse_contradictions(mixed.T @ residual[keep] - residual[~keep], level.max(initial=0.0))
    return used[pivot[: int(keep.sum())]].astype(np.int64), keep


def _refuse_contradictions(difference: Float, level: Float | float) -> None:
    if not (np.abs(difference) <= _CONSISTENT * np.maximum(level, 1e-300)).all():
        raise InputError(
            f"constraints: equations contradict each other or the supports; got a difference of "
            f"{np.abs(difference).max():.3g} between displacements that they ask for; expected "
            "constraints that can hold together"
        )
