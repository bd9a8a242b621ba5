"""Smoothed aggregation, host side: aggregates, prolongators and coarse matrices.

Vanek, Mandel & Brezina, Computing 56 (1996) 179, with the six rigid-body modes.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import eigh_tridiagonal
from scipy.sparse import bsr_matrix, coo_matrix, csr_matrix, vstack

from gpusim.arrays.array_types import Bool, Float, Int, Long
from gpusim.arrays.unique import noise
from gpusim.fem.lattice.stencil import StencilProduct
from gpusim.fem.multigrid.column_blocks import Columns
from gpusim.fem.multigrid.transfer import in_single
from gpusim.fem.sparse.block_rows import block_diagonal, pattern, ranges
from gpusim.fem.sparse.matrix_product import Product, add_rows, row_shares
from gpusim.parallel.threads import ahead, shared

_STRENGTH = 0.08
# Coarse levels of slender bodies are chains. Aggregates several links long bend too stiffly there
# (iterations double or worse), so only strong links count; weaker ones do where that stalls.
_COARSE_STRENGTHS = (0.2, 0.08, 0.0)
_LEAST_SHRINKAGE = 0.45
# products of matrices are shared out in so many parts, of no fewer blocks than this
_MOST_PARTS, _LEAST_PART = 64, 25_000
# factor on the greatest eigenvalue that Lanczos and its residual tell
_ON_TOP = 1.03


def prolongator(
    matrix: Product,
    inverse: Float | Columns,
    largest: float,
    near_null: Float,
    mask: Bool,
    single: bool,
) -> tuple[bsr_matrix, Float, Bool]:
    """(P, the coarser level's near-null space (C,6,6), which of its unknowns exist (C,6)); P with
    blocks of s x 6, in float32 if it is to be ``single``.

    ``matrix`` has s x s blocks, ``inverse`` (B,s,s) its inverted diagonal blocks, or columns that
    stay together, ``largest`` bounds the eigenvalues of D^-1 A, ``near_null`` (B,s,6), ``mask``
    (B,s) free.

    Of block rows the diagonal is stored apart, and is taken into account apart: the matrix is the
    largest thing there is, and a copy of it with the diagonal in place isn't needed.
    """
    off, diagonal, scale = matrix.others, matrix.diagonal, matrix.scale
    if isinstance(inverse, Columns):
        links, weight, alive = _between(off, diagonal, mask, inverse.column)
        aggregate, count = _shrinking_aggregates(links, weight, alive)
        aggregate = np.where(mask.any(axis=1), aggregate[inverse.column], -1)
    else:
        aggregate, count = _shrinking_aggregates(off, diagonal, mask)
    tentative, coarse_null, coarse_mask = _tentative(near_null, aggregate, count)
    # P = (I - 4/(3 lambda) D^-1 A) T, with D^-1 D T = T
    step = 4.0 / (3.0 * largest)
    if isinstance(inverse, Columns):
        by_columns = _smoothed_by_columns(matrix, tentative, inverse.product, step, single)
        return by_columns, coarse_null, coarse_mask

    def smoothed(rows: slice) -> bsr_matrix:
        image = _rows(off, rows) @ tentative
        tentative_rows = _rows(tentative, rows) * (1.0 - step if matrix.apart else 1.0)
        result = bsr_matrix(
            tentative_rows - (step / scale) * (block_diagonal(inverse[rows]) @ image)
        )
        return in_single(result) if single else result

    return _stacked(shared(smoothed, _parts(off))), coarse_null, coarse_mask


def _smoothed_by_columns(
    matrix: Product,
    tentative: bsr_matrix,
    inverse: Product,
    step: float,
    single: bool,
) -> bsr_matrix:
    """P as above, by an inverse whose blocks lie anywhere."""
    parts = _parts(matrix.others)

    def image(rows: slice) -> bsr_matrix:
        # rounded as P is: the largest thing here
        result = _image(matrix, rows, tentative)
        return in_single(result) if single else result

    whole = _stacked(shared(image, parts))

    def smoothed(rows: slice) -> bsr_matrix:
        result = _rows(tentative, rows) - (step / matrix.scale) * _image(inverse, rows, whole)
        return in_single(result) if single else bsr_matrix(result)

    return _stacked(shared(smoothed, parts))


def _between(
    off: bsr_matrix, diagonal: Float, mask: Bool, column: Long
) -> tuple[bsr_matrix, Float, Bool]:
    """Links between columns as a matrix of single numbers, the norms of all their blocks; the same
    of each column's own (C,1,1), and whether any unknown of it is free (C,1)."""
    count = int(column.max()) + 1
    number = column.astype(np.int32)
    row = np.repeat(number, np.diff(off.indptr))
    links = coo_matrix(
        (np.einsum("bij,bij->b", off.data, off.data), (row, number[off.indices])),
        shape=(count, count),
    ).tocsr()
    # a column's own is that of its nodes' blocks: what links them is less
    within = np.bincount(column, np.einsum("bij,bij->b", diagonal, diagonal), minlength=count)
    data = np.sqrt(links.data)[:, None, None]
    alive = np.bincount(column, mask.any(axis=1), minlength=count)[:, None] > 0
    between = bsr_matrix((data, links.indices, links.indptr), shape=(count, count))
    return between, np.sqrt(within)[:, None, None], alive


def galerkin(matrix: Product, prolongation: bsr_matrix) -> bsr_matrix:
    """P^T A P in float64, in blocks as wide as those of the ``prolongation``."""
    width = prolongation.blocksize[1]
    start, column = _pattern(matrix, prolongation)
    count = len(start) - 1
    # blocks of the result by row and column, ascending
    place = np.repeat(np.arange(count), np.diff(start)) * count + column
    blocks = np.zeros((len(column), width, width))

    def coarsened(rows: slice) -> tuple[Int, Float]:
        interpolation = _double(_rows(prolongation, rows))
        part = bsr_matrix(interpolation.T @ _image(matrix, rows, prolongation))
        row = np.repeat(np.arange(count), np.diff(part.indptr))
        at = np.searchsorted(place, row * count + part.indices)
        return at.astype(np.int32), part.data

    # one part after the other: all of them together take several times as much as their sum
    for at, part in ahead(coarsened, _parts(matrix.others)):
        add_rows(blocks.reshape(-1, width * width), at, part)
    blocks /= matrix.scale
    return bsr_matrix((blocks, column, start), shape=(width * count,) * 2)


def _pattern(matrix: Product, prolongation: bsr_matrix) -> tuple[Int, Int]:
    """Where P^T A P has blocks: first of each row, and columns, ascending."""
    off, across = matrix.others, pattern(prolongation)

    def image(rows: slice) -> csr_matrix:
        on_diagonal = across[rows] if matrix.apart else 0
        return csr_matrix(pattern(_rows(off, rows)) @ across + on_diagonal)

    result = csr_matrix(across.T @ vstack(shared(image, _parts(off)), format="csr"))
    result.sort_indices()
    return result.indptr, result.indices


def _image(matrix: Product, rows: slice, other: bsr_matrix) -> bsr_matrix:
    """Some rows of A, without its scale, times another matrix, in float64."""
    matrix_rows, factor = _rows(matrix.others, rows), other
    if other.dtype != np.float64:
        # only those rows that are asked for
        wanted = np.zeros(len(other.indptr) - 1, dtype=bool)
        wanted[matrix_rows.indices] = True
        number = np.cumsum(wanted, dtype=np.int32) - 1
        factor = _double(other, np.flatnonzero(wanted))
        shape = matrix_rows.shape[0], factor.shape[0]
        matrix_rows = bsr_matrix(
            (matrix_rows.data, number[matrix_rows.indices], matrix_rows.indptr), shape=shape
        )
    result = matrix_rows @ factor
    if matrix.apart:
        result = result + block_diagonal(matrix.diagonal[rows]) @ _double(_rows(other, rows))
    return bsr_matrix(result)


def _double(matrix: bsr_matrix, rows: Long | None = None) -> bsr_matrix:
    """All of its block rows, or some, in float64."""
    data, indices, start = matrix.data, matrix.indices, matrix.indptr
    if rows is not None:
        first = start.astype(np.int64)
        length = first[rows + 1] - first[rows]
        at = ranges(first[rows], length)
        data, indices = data[at], indices[at]
        start = np.concatenate([[0], np.cumsum(length)])
    shape = (len(start) - 1) * matrix.blocksize[0], matrix.shape[1]
    return bsr_matrix((data.astype(np.float64, copy=False), indices, start), shape=shape)


def _parts(matrix: bsr_matrix) -> list[slice]:
    """As many whatever the number of processors: sums depend on them."""
    return row_shares(matrix, 1 + min(_MOST_PARTS - 1, len(matrix.indices) // _LEAST_PART))


def _rows(matrix: bsr_matrix, rows: slice) -> bsr_matrix:
    """Some block rows, without a copy of their blocks."""
    start = matrix.indptr[rows.start : rows.stop + 1]
    blocks = slice(start[0], start[-1])
    shape = ((rows.stop - rows.start) * matrix.blocksize[0], matrix.shape[1])
    return bsr_matrix((matrix.data[blocks], matrix.indices[blocks], start - start[0]), shape=shape)


def _stacked(parts: Sequence[bsr_matrix]) -> bsr_matrix:
    """Block rows below one another."""
    lengths = np.concatenate([np.diff(part.indptr) for part in parts])
    start = np.concatenate([[0], np.cumsum(lengths)])
    columns = np.concatenate([part.indices for part in parts])
    blocks = np.concatenate([part.data for part in parts])
    shape = (sum(part.shape[0] for part in parts), parts[0].shape[1])
    return bsr_matrix((blocks, columns, start), shape=shape)


def largest_eigenvalue(
    product: Product | StencilProduct, inverse: Float | Columns, steps: int
) -> float:
    """Of M A for the smoother's M, D^-1 or columns: Lanczos in the norm of M^-1 from a
    fixed start, with the residual and a little more on top (Zhou & Li, Linear Algebra Appl. 435
    (2011) 480). A value 4 % too small already makes the smoother, and the cycle, indefinite.
    """

    def scaled(r: Float) -> Float:
        if isinstance(inverse, Columns):
            return np.asarray(inverse.apply(r[None])[0])
        size = inverse.shape[1]
        blocks = np.matmul(inverse, r.reshape(-1, size, 1))
        return np.asarray(blocks, dtype=np.float64).reshape(-1)

    r = noise(product.unknowns, 3)
    z, before = scaled(r), np.zeros_like(r)
    beta = np.sqrt(max(float(r @ z), 0.0))
    diagonal: list[float] = []
    off: list[float] = []
    for _ in range(steps):
        if not beta > 0.0:
            break
        r, z = r / beta, z / beta
        image = product(z[None])[0]
        alpha = float(image @ z)
        diagonal.append(alpha)
        off.append(beta)
        following = image - alpha * r - beta * before if len(diagonal) > 1 else image - alpha * r
        before, r = r, following
        z = scaled(r)
        beta = np.sqrt(max(float(r @ z), 0.0))
    if not diagonal:
        return 1.0
    last = len(diagonal) - 1
    values, vectors = eigh_tridiagonal(
        np.array(diagonal), np.array(off[1:]), select="i", select_range=(last, last)
    )
    return _ON_TOP * float(values[0] + beta * abs(vectors[-1, 0]))


def _shrinking_aggregates(matrix: bsr_matrix, blocks: Float, mask: Bool) -> tuple[Long, int]:
    """Aggregates by strong links; by weaker ones where these don't coarsen enough. ``blocks``
    (B,s,s) are the diagonal ones, whether ``matrix`` has them or not."""
    rows = len(blocks)
    for strength in _COARSE_STRENGTHS if blocks.shape[1] == 6 else (_STRENGTH, 0.0):
        aggregate, count = _aggregate(matrix, blocks, mask, strength)
        if count <= _LEAST_SHRINKAGE * rows:
            break
    return aggregate, count


def _aggregate(matrix: bsr_matrix, blocks: Float, mask: Bool, strength: float) -> tuple[Long, int]:
    """Aggregate number of each block row, -1 where nothing is free."""
    count = len(blocks)
    row = np.repeat(np.arange(count, dtype=np.int32), np.diff(matrix.indptr))
    column = matrix.indices
    weight = np.einsum("bij,bij->b", matrix.data, matrix.data)
    diagonal = np.einsum("bij,bij->b", blocks, blocks)
    alive: Bool = np.asarray(mask.any(axis=1))
    bound = strength**4 * diagonal[row] * diagonal[column]
    strong = (weight * weight > bound) if strength else (weight > 0.0)
    keep = strong & (row != column) & alive[row] & alive[column]
    alive_rows = np.flatnonzero(alive)
    ends = [np.concatenate([one[keep], alive_rows]) for one in (row, column)]
    size = np.sqrt(np.concatenate([weight[keep], diagonal[alive_rows]]))
    graph = csr_matrix((size, (ends[0], ends[1])), shape=(count, count))
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


def _independent_set(graph: csr_matrix, alive: Bool) -> Bool:
    """Nodes no two of which have a neighbour in common, every other node within 2 of one; of the
    ``graph``, which has a full diagonal on the living nodes.

    One after the other, as they are numbered (Vanek, Mandel & Brezina, algorithm 5.1): neighbours
    in number are neighbours in space, so the aggregates lie close to each other. Chosen at random,
    they leave gaps, which the aggregates around fill up: half again as many nodes to each.
    """
    # who has no neighbours needn't be asked for them
    root: Bool = np.asarray(alive & (np.diff(graph.indptr) == 1))
    taken = root.copy()
    start, neighbours = graph.indptr.tolist(), graph.indices
    for node in np.flatnonzero(alive & ~root).tolist():
        if taken[node]:
            continue
        near = neighbours[start[node] : start[node + 1]]
        if not taken[near].any():
            root[node] = True
            taken[near] = True
    return root


def _tentative(near_null: Float, aggregate: Long, count: int) -> tuple[bsr_matrix, Float, Bool]:
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
