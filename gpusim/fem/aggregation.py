"""Smoothed aggregation, host side: aggregates, prolongators and coarse matrices.

Vanek, Mandel & Brezina, Computing 56 (1996) 179, with the six rigid-body modes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import bsr_matrix, csr_matrix

from gpusim.errors import NotConverged
from gpusim.fem.block_rows import BlockRows
from gpusim.fem.congruence import mix
from gpusim.fem.diagonal import invert_blocks
from gpusim.fem.supports import rigid_modes

__all__ = ["Hierarchy", "Level", "block_matrix", "build_hierarchy"]

Float = npt.NDArray[np.float64]
Long = npt.NDArray[np.int64]

_STRENGTH = 0.08
# Coarse levels of slender bodies are chains. Aggregates several links long bend too stiffly there
# (iterations double or worse), so only strong links count; weaker ones do where that stalls.
_COARSE_STRENGTHS = (0.2, 0.08, 0.0)
_LEAST_SHRINKAGE = 0.55
_COARSEST = 800


@dataclass(frozen=True, eq=False)
class Level:
    """One level: inverted diagonal blocks, greatest eigenvalue of D^-1 A, prolongator from the
    next coarser level; ``matrix`` is None on the finest, where the stiffness operator acts."""

    matrix: csr_matrix | None
    inverse: Float
    largest: float
    prolongation: csr_matrix


@dataclass(frozen=True, eq=False)
class Hierarchy:
    """Levels from fine to coarse, the inverse on the coarsest one, and ``lowest``: an estimate of
    the smallest eigenvalue of K (Rayleigh-Ritz in the coarsest space, so never below it)."""

    levels: tuple[Level, ...]
    coarse_inverse: csr_matrix
    lowest: float


def block_matrix(rows: BlockRows) -> bsr_matrix:
    """K as a SciPy block matrix with 3x3 blocks, float64."""
    count = rows.node_count
    degree = rows.degree
    slot = np.arange(len(rows.neighbour)) - np.repeat(rows.start[:-1], degree)
    owner = np.repeat(np.arange(count), degree)
    data = np.concatenate([rows.table[rows.row_class[owner], slot], rows.diagonal[rows.row_class]])
    row = np.concatenate([owner, np.arange(count)])
    column = np.concatenate([rows.neighbour, np.arange(count)])
    order = np.lexsort((column, row))
    start = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=count))])
    return bsr_matrix((data[order], column[order], start), shape=(3 * count, 3 * count))


def build_hierarchy(matrix: bsr_matrix, free: npt.NDArray[np.bool_], points: Float) -> Hierarchy:
    """Coarsen until at most a few hundred unknowns remain.

    ``matrix`` K with 3x3 blocks, ``free`` (N,3), ``points`` (N,3).
    """
    origin = points.mean(axis=0)
    length = float(np.abs(points - origin).max()) or 1.0
    near_null = rigid_modes(points, origin, length) * free[:, :, None]
    levels: list[Level] = []
    current, mask = matrix, free
    total: csr_matrix | None = None
    while True:
        blocks = _diagonal_blocks(current)
        inverse = invert_blocks(blocks, mask)
        largest = _largest_eigenvalue(current, inverse)
        aggregate, count = _shrinking_aggregates(current, mask, first=not levels)
        tentative, near_null, coarse_mask = _tentative(near_null, aggregate, count)
        prolongation = _smoothed(current, inverse, largest, tentative)
        levels.append(
            Level(
                None if not levels else csr_matrix(current),
                inverse,
                largest,
                csr_matrix(prolongation),
            )
        )
        fine = csr_matrix(prolongation)
        total = fine if total is None else csr_matrix(total @ fine)
        coarse = (prolongation.T @ (current @ prolongation)).tobsr((6, 6))
        stalled = coarse.shape[0] > 0.9 * current.shape[0]
        current, mask = coarse, coarse_mask
        if current.shape[0] <= _COARSEST or stalled:
            break
    assert total is not None
    keep = mask.ravel()
    inside = np.ix_(keep, keep)
    small = current.toarray()[inside]
    inverse_dense = np.zeros(current.shape)
    inverse_dense[inside] = _inverse(small)
    overlap = (total.T @ total).tocsr()
    lowest = _lowest_eigenvalue(inverse_dense, overlap, current)
    return Hierarchy(tuple(levels), csr_matrix(inverse_dense), lowest)


def _inverse(matrix: Float) -> Float:
    """Of a symmetric positive definite matrix, scaled to a unit diagonal first."""
    scale = 1.0 / np.sqrt(matrix.diagonal())
    scaled = 0.5 * (matrix + matrix.T) * scale[:, None] * scale
    try:
        factor = cho_factor(scaled, lower=True)
    except np.linalg.LinAlgError:
        raise NotConverged(
            "multigrid: the coarsest matrix is not positive definite in float64; got a body whose "
            "softest motions vanish beside its stiffest (is it extremely slender, nearly free, or "
            "of extremely unequal elements?); expected better proportions, or block_jacobi"
        ) from None
    inverse = cho_solve(factor, np.eye(len(matrix)))
    return np.asarray(0.5 * (inverse + inverse.T) * scale[:, None] * scale)


def _lowest_eigenvalue(inverse: Float, overlap: csr_matrix, matrix: bsr_matrix) -> float:
    """Of the pencil (matrix, overlap) by inverse iteration; every iterate bounds it from above."""
    x = (mix(np.arange(len(inverse)), 5) >> np.uint64(11)).astype(np.float64) * 2.0**-53 - 0.5
    for _ in range(40):
        x = inverse @ (overlap @ x)
        x /= np.linalg.norm(x)
    return float((x @ (matrix @ x)) / (x @ (overlap @ x)))


def _diagonal_blocks(matrix: bsr_matrix) -> Float:
    size = matrix.blocksize[0]
    count = matrix.shape[0] // size
    row = np.repeat(np.arange(count), np.diff(matrix.indptr))
    blocks = np.zeros((count, size, size))
    here = matrix.indices == row
    blocks[row[here]] = matrix.data[here]
    return blocks


def _largest_eigenvalue(matrix: bsr_matrix, inverse: Float, steps: int = 12) -> float:
    """Of D^-1 A: power iteration from a fixed start, with a tenth on top."""
    size = inverse.shape[1]
    x = (mix(np.arange(matrix.shape[0]), 3) >> np.uint64(11)).astype(np.float64) * 2.0**-53 - 0.5
    value = 1.0
    for _ in range(steps):
        y = np.matmul(inverse, (matrix @ x).reshape(-1, size, 1)).reshape(-1)
        value = float(np.linalg.norm(y) / np.linalg.norm(x))
        x = y / np.linalg.norm(y)
    return 1.1 * value


def _shrinking_aggregates(
    matrix: bsr_matrix, mask: npt.NDArray[np.bool_], first: bool
) -> tuple[Long, int]:
    """Aggregates by strong links; by weaker ones where these don't coarsen enough."""
    rows = matrix.shape[0] // matrix.blocksize[0]
    for strength in (_STRENGTH, 0.0) if first else _COARSE_STRENGTHS:
        aggregate, count = _aggregate(matrix, mask, strength)
        if count <= _LEAST_SHRINKAGE * rows:
            break
    return aggregate, count


def _aggregate(
    matrix: bsr_matrix, mask: npt.NDArray[np.bool_], strength: float
) -> tuple[Long, int]:
    """Aggregate number of each block row, -1 where nothing is free."""
    size = matrix.blocksize[0]
    count = matrix.shape[0] // size
    row = np.repeat(np.arange(count), np.diff(matrix.indptr))
    column = matrix.indices.astype(np.int64)
    weight = np.einsum("bij,bij->b", matrix.data, matrix.data)
    diagonal = np.zeros(count)
    here = row == column
    diagonal[row[here]] = weight[here]
    alive: npt.NDArray[np.bool_] = np.asarray(mask.any(axis=1))
    bound = strength**4 * diagonal[row] * diagonal[column]
    strong = (weight * weight > bound) if strength else (weight > 0.0)
    keep = (strong | here) & alive[row] & alive[column]
    graph = csr_matrix((np.sqrt(weight[keep]), (row[keep], column[keep])), shape=(count, count))
    root = _independent_set(graph, alive)
    aggregate = np.full(count, -1, dtype=np.int64)
    roots = np.flatnonzero(root)
    aggregate[roots] = np.arange(len(roots))
    # neighbours of roots, then what is left over joins its strongest aggregated neighbour
    while True:
        waiting = np.flatnonzero(alive & (aggregate < 0))
        if waiting.size == 0:
            break
        part = graph[waiting]
        local = np.repeat(np.arange(len(waiting)), np.diff(part.indptr))
        known = aggregate[part.indices] >= 0
        if not known.any():
            aggregate[waiting] = len(roots) + np.arange(len(waiting))
            return aggregate, len(roots) + len(waiting)
        order = np.lexsort((part.indices[known], -part.data[known], local[known]))
        owner = local[known][order]
        first = np.concatenate([[True], owner[1:] != owner[:-1]])
        aggregate[waiting[owner[first]]] = aggregate[part.indices[known][order][first]]
    return aggregate, len(roots)


def _independent_set(graph: csr_matrix, alive: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Nodes no two of which are within distance 2, every other node within 2 of one.

    Rounds of local maxima of a fixed pseudo-random priority (Bell, Dalton & Olson, SISC 34
    (2012) C123). ``graph`` has a full diagonal on the living nodes.
    """
    count = len(alive)
    rows = np.flatnonzero(alive)
    start = graph.indptr[rows]
    priority = (mix(np.arange(count), 4) >> np.uint64(2)).astype(np.int64)
    top = np.int64(2**62)
    state = np.where(alive, priority, np.int64(-1))  # top: chosen, -1: out

    def spread(values: Long) -> Long:
        result = np.full(count, -1, dtype=np.int64)
        result[rows] = np.maximum.reduceat(values[graph.indices], start)
        return result

    while True:
        reach = spread(spread(state))
        undecided = (state >= 0) & (state < top)
        if not undecided.any():
            return np.asarray(state == top)
        chosen = undecided & (reach == state)
        state[undecided & (reach == top)] = -1
        state[chosen] = top


def _tentative(
    near_null: Float, aggregate: Long, count: int
) -> tuple[bsr_matrix, Float, npt.NDArray[np.bool_]]:
    """Orthonormal near-null space per aggregate (modified Gram-Schmidt, all at once).

    ``near_null`` (B,s,6). Returns the prolongator with (s,6) blocks, the coarse near-null space
    (count,6,6), and which of the six columns are non-zero (count,6).
    """
    size = near_null.shape[1]
    alive = aggregate >= 0
    owner = aggregate[alive]
    q = near_null[alive].copy()
    factor = np.zeros((count, 6, 6))
    mask = np.zeros((count, 6), dtype=bool)
    original = np.sqrt(_gather(np.einsum("bsk,bsk->bk", q, q), owner, count))
    for k in range(6):
        for _ in range(2):  # twice is enough (Giraud et al. 2005)
            for j in range(k):
                share = _gather(np.einsum("bs,bs->b", q[:, :, j], q[:, :, k]), owner, count)
                factor[:, j, k] += share
                q[:, :, k] -= q[:, :, j] * share[owner, None]
        norm = np.sqrt(_gather(np.einsum("bs,bs->b", q[:, :, k], q[:, :, k]), owner, count))
        mask[:, k] = norm > 1e-9 * np.maximum(original[:, k], 1e-300)
        factor[:, k, k] = np.where(mask[:, k], norm, 0.0)
        q[:, :, k] *= np.where(mask[:, k], 1.0 / np.where(norm > 0.0, norm, 1.0), 0.0)[owner, None]
    start = np.concatenate([[0], np.cumsum(alive)])
    shape = (size * len(aggregate), 6 * count)
    return bsr_matrix((q, owner, start), shape=shape), factor, mask


def _gather(values: Float, owner: Long, count: int) -> Float:
    if values.ndim == 1:
        return np.asarray(np.bincount(owner, weights=values, minlength=count), np.float64)
    return np.stack([_gather(column, owner, count) for column in values.T], axis=1)


def _smoothed(
    matrix: bsr_matrix, inverse: Float, largest: float, tentative: bsr_matrix
) -> bsr_matrix:
    """P = (I - 4/(3 lambda) D^-1 A) T."""
    size, count = inverse.shape[1], inverse.shape[0]
    scaling = bsr_matrix((inverse, np.arange(count), np.arange(count + 1)), shape=matrix.shape)
    image = (matrix @ tentative).tobsr((size, 6))
    smoothed = tentative - (4.0 / (3.0 * largest)) * (scaling @ image)
    return bsr_matrix(smoothed.tobsr((size, 6)))
