"""Equal things found: values, rows of integers, congruent elements.

Values are sorted: NumPy 2.3's `unique` goes through a table of hashes, ten times slower. Rows are
compared by 64-bit hashes.
"""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float, Int, Long

Number = TypeVar("Number", bound=np.generic)
Hash = npt.NDArray[np.uint64]

# coordinates are compared on a grid of this fraction of the element's smallest extent
_GRID = 2.0**-38
_CHUNK = 1 << 14  # rows whose hashes stay in the cache


def distinct(values: npt.NDArray[Number]) -> npt.NDArray[Number]:
    """The values (n,) of an array of any shape in ascending order, each once."""
    ordered: npt.NDArray[Any] = np.sort(values, axis=None)
    new = np.ones(len(ordered), bool)
    np.not_equal(ordered[1:], ordered[:-1], out=new[1:])
    return ordered[new]


def mix(value: npt.NDArray[np.integer], seed: int) -> Hash:
    """splitmix64 finaliser (Steele, Lea & Flood 2014) of ``value`` with a stream number."""
    x = value.astype(np.uint64) + np.uint64((0x9E3779B97F4A7C15 * (seed + 1)) % 2**64)
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return np.asarray(x ^ (x >> np.uint64(31)))


def noise(count: int, seed: int) -> Float:
    """(count,) numbers in [-0.5, 0.5) that hold every mode: the same ones on every run."""
    bits = mix(np.arange(count), seed) >> np.uint64(11)
    return np.asarray(bits.astype(np.float64) * 2.0**-53 - 0.5)


def unique_rows(rows: Long) -> tuple[Long, Long]:
    """First occurrences and class number of each row of an (M,k) integer array.

    Hashing with two independent streams; if they disagree anywhere (a collision), every row
    counts as its own class, which is slow and still right.
    """
    column = mix(np.arange(rows.shape[1]), 0)
    hashes = np.empty((2, len(rows)), np.uint64)
    for start in range(0, len(rows), _CHUNK):
        part = slice(start, start + _CHUNK)
        keyed = rows[part].astype(np.uint64) ^ column
        for stream in (0, 1):
            mix(keyed, stream).sum(axis=1, out=hashes[stream, part])
    return unique_hashes(hashes[0], hashes[1])


def unique_hashes(first_hash: Hash, second_hash: Hash) -> tuple[Long, Long]:
    """Classes of equal ``first_hash``, numbered by first occurrence; see ``unique_rows``."""
    _, first, inverse = np.unique(first_hash, return_index=True, return_inverse=True)
    if not np.array_equal(second_hash[first][inverse], second_hash):
        everyone = np.arange(len(first_hash), dtype=np.int64)
        return everyone, everyone
    order = np.argsort(first, kind="stable")
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return first[order].astype(np.int64), rank[inverse].astype(np.int64)


def congruence_classes(nodes: Float, material: Int) -> tuple[Long, Long]:
    """Elements with the same shape (up to translation) and material.

    ``nodes`` (M,k,3). Returns (representatives (C,), class of element (M,)). Coordinates are
    relative to the first node and compared to 3.6e-12 of the element's smallest extent; the
    representative's own coordinates are used for the matrix, so geometry moves by no more than
    that. Equal elements that straddle a grid border become two classes: slower, not wrong.
    """
    local = nodes - nodes[:, :1]
    extent = (local.max(axis=1) - local.min(axis=1)).min(axis=1)
    exponent = np.ceil(np.log2(extent))
    scaled = local / (np.exp2(exponent) * _GRID)[:, None, None]
    # a shift by an odd fraction keeps exact multiples (0, h, 2h) off the grid borders
    grid = np.floor(np.clip(scaled + 0.37, -(2.0**62), 2.0**62)).astype(np.int64)
    rows = np.concatenate(
        [grid.reshape(len(nodes), -1), exponent[:, None].astype(np.int64), material[:, None]],
        axis=1,
    )
    return unique_rows(rows)
