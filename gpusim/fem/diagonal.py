"""Inverses of small diagonal blocks, with fixed or empty unknowns left out."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["invert_blocks"]

Float = npt.NDArray[np.float64]


def invert_blocks(blocks: Float, free: npt.NDArray[np.bool_]) -> Float:
    """Inverse of the free sub-block of each symmetric (B,s,s) block, zeros elsewhere.

    ``free`` (B,s). Blocks that are singular on their free unknowns get a pseudo-inverse.
    """
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
