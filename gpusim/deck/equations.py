"""Linear equations between degrees of freedom, and unknowns given up to them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.linalg import qr, solve
from scipy.sparse import coo_matrix, csr_matrix

from gpusim.errors import InputError

__all__ = ["Equations", "Reduced", "eliminate"]

Float = npt.NDArray[np.float64]
Int = npt.NDArray[np.int64]
Bool = npt.NDArray[np.bool_]

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
    if len(rest) > _MOST_COUPLED:
        raise InputError(
            f"{where}: equations: got {len(rest)} that share all their unknowns; expected at most "
            f"{_MOST_COUPLED}"
        )
    inner, keep = _pivots(held[rest], right[rest], where)
    left = np.ones(held.shape[1], dtype=bool)
    left[column[alone]] = left[inner] = False
    stay = np.flatnonzero(left)
    # first the coupled ones, in terms of what stays; then the others, in terms of both
    kept = held[rest[keep]]
    block = kept[:, inner].toarray()
    used = np.unique(kept[:, stay].indices)
    table = -solve(block, kept[:, stay[used]].toarray()) if len(inner) else np.zeros((0, 0))
    shift = np.zeros(held.shape[1])
    shift[inner] = solve(block, right[rest[keep]]) if len(inner) else 0.0
    size = (held.shape[1], len(stay))
    matrix = csr_matrix(coo_matrix((np.ones(len(stay)), (stay, np.arange(len(stay)))), shape=size))
    if len(inner):
        rows, columns = np.repeat(inner, len(used)), np.tile(used, len(inner))
        matrix = matrix + csr_matrix(coo_matrix((table.ravel(), (rows, columns)), shape=size))
    own = np.flatnonzero(alone)
    if len(own):
        factor = np.asarray(held[own, column[own]]).ravel()
        others = held[own]
        value = coo_matrix(others @ matrix)
        row = value.row
        placed = coo_matrix((-value.data / factor[row], (column[own][row], value.col)), shape=size)
        shift[column[own]] = (right[own] - others @ shift) / factor
        matrix = matrix + csr_matrix(placed)
    return Reduced(csr_matrix(matrix), shift)


def _own_unknowns(held: csr_matrix) -> tuple[Bool, Int]:
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


def _pivots(held: csr_matrix, right: Float, where: str) -> tuple[Int, Bool]:
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
