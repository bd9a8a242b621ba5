"""Small diagonal blocks and their inverses, with fixed or empty unknowns left out."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.sparse import bsr_matrix

__all__ = ["diagonal_blocks", "invert_blocks", "invert_repeated"]

Float = npt.NDArray[np.float64]


def diagonal_blocks(matrix: bsr_matrix) -> Float:
    """(B,s,s) diagonal blocks, zero where none is stored."""
    size = matrix.blocksize[0]
    count = matrix.shape[0] // size
    row = np.repeat(np.arange(count, dtype=matrix.indices.dtype), np.diff(matrix.indptr))
    blocks = np.zeros((count, size, size))
    here = np.flatnonzero(matrix.indices == row)
    blocks[row[here]] = matrix.data[here]
    return blocks


def invert_blocks(blocks: Float, free: npt.NDArray[np.bool_]) -> Float:
    """Inverse of the free sub-block of each symmetric (B,s,s) block, zeros elsewhere.

    ``free`` (B,s). Blocks that are singular on their free unknowns get a pseudo-inverse.
    """
    every = free.all(axis=1)
    result = np.zeros_like(blocks)
    result[every] = _regular(blocks[every])
    # what rounding has spoilt, or what is partly fixed, goes the careful way
    careful = np.flatnonzero(~every | ~np.isfinite(result).all(axis=(1, 2)))
    result[careful] = _careful(blocks[careful], free[careful])
    return result


def invert_repeated(
    blocks: Float, kind: npt.NDArray[np.int32], free: npt.NDArray[np.bool_]
) -> Float:
    """The same for blocks ``blocks[kind]``: each distinct one is inverted once for all nodes where
    the same unknowns are free. ``blocks`` (C,s,s), ``kind`` (B,), ``free`` (B,s)."""
    size = free.shape[1]
    key = kind.astype(np.int64) << size
    for column in range(size):
        key |= free[:, column].astype(np.int64) << column
    used = np.flatnonzero(np.bincount(key, minlength=len(blocks) << size))
    number = np.zeros(len(blocks) << size, dtype=np.int64)
    number[used] = np.arange(len(used))
    own = (used[:, None] >> np.arange(size) & 1).astype(bool)
    return np.asarray(np.take(invert_blocks(blocks[used >> size], own), number[key], axis=0))


def _regular(blocks: Float) -> Float:
    """Inverses of positive definite blocks, scaled to a unit diagonal; NaN where they aren't."""
    diagonal = np.einsum("bii->bi", blocks)
    good = (diagonal > 0.0).all(axis=1)
    scale = 1.0 / np.sqrt(np.where(good[:, None], diagonal, 1.0))
    scaled = blocks * scale[:, :, None] * scale[:, None, :]
    scaled[~good] = np.eye(blocks.shape[1])
    good &= np.linalg.det(scaled) > 1e-6
    scaled[~good] = np.eye(blocks.shape[1])
    inverse = np.linalg.inv(scaled)
    inverse = 0.5 * (inverse + inverse.transpose(0, 2, 1)) * scale[:, :, None] * scale[:, None, :]
    return np.where(good[:, None, None], inverse, np.nan)


def _careful(blocks: Float, free: npt.NDArray[np.bool_]) -> Float:
    size = blocks.shape[1]
    both = free[:, :, None] & free[:, None, :]
    diagonal = np.where(free, np.einsum("bii->bi", blocks), 1.0)
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    scaled = np.where(both, blocks * scale[:, :, None] * scale[:, None, :], 0.0)
    scaled += np.where(free, 0.0, 1.0)[:, :, None] * np.eye(size)
    values, vectors = np.linalg.eigh(scaled)
    good = values > 1e-12
    inverse_values = np.where(good, 1.0 / np.where(good, values, 1.0), 0.0)
    inverse = np.matmul(vectors * inverse_values[:, None, :], vectors.transpose(0, 2, 1))
    return np.where(both, inverse * scale[:, :, None] * scale[:, None, :], 0.0)
