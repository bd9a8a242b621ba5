"""Renumbering and trilinear transfer between nested boxes, in NumPy alone."""

import numpy as np


def renumbered(problem):
    """Nodes (new -> old) with the longest direction slowest; boxes only, else as they are."""
    if not problem.meta.get("divisions"):
        return np.arange(len(problem.points))
    axes = np.argsort(problem.meta["divisions"], kind="stable")
    keys = tuple(
        np.round(problem.points[:, axis] / problem.points[:, axis].max(), 9) for axis in axes
    )
    return np.lexsort(keys)


def interpolation_levels(problem, order, ranks, least=6000):
    """Per level, finest first: (node bounds per rank fine, coarse, row start, column, weight).

    The clamped face is x = 0, so a box of n cells has n planes of free nodes in x.
    """
    counts = np.array(problem.meta["divisions"])
    fine = grid_numbers(problem, order, counts)
    nodes = len(order)
    fine_bounds = [nodes * k // ranks for k in range(ranks + 1)]
    axes = np.argsort(problem.meta["divisions"], kind="stable")
    levels = []
    while 3 * len(fine) > least:
        even = (counts % 2 == 0) & (counts > 1)
        # halve the directions with small cells first, so that cells stay nearly cubes
        size = np.array(problem.meta["size"]) / counts
        even &= size <= 1.5 * size[even].min() if even.any() else even
        if not even.any():
            break
        step = np.where(even, 2, 1)
        coarse_counts = counts // step
        coarse = all_numbers(coarse_counts, axes)
        lookup = np.full(np.prod(coarse_counts + 1), -1)
        lookup[flat(coarse, coarse_counts)] = np.arange(len(coarse))
        entries = []
        for corner in np.ndindex(2, 2, 2):
            low = fine // step
            rest = fine - low * step
            weight = np.where(corner, rest / step, 1 - rest / step).prod(axis=1)
            at = low + np.array(corner)
            keep = (weight > 0) & (at <= coarse_counts).all(axis=1) & (at[:, 0] > 0)
            row = np.flatnonzero(keep)
            entries.append((row, lookup[flat(at[keep], coarse_counts)], weight[keep]))
        row, column, weight = (np.concatenate([e[k] for e in entries]) for k in range(3))
        sort = np.lexsort((column, row))
        row_start = np.searchsorted(row[sort], np.arange(len(fine) + 1))
        coarse_bounds = [len(coarse) * k // ranks for k in range(ranks + 1)]
        levels.append((fine_bounds, coarse_bounds, row_start, column[sort], weight[sort]))
        fine, counts, fine_bounds = coarse, coarse_counts, coarse_bounds
    return levels


def grid_numbers(problem, order, counts):
    """(n,3) whole numbers of each free node, x from 1."""
    size = np.array(problem.meta["size"])
    return np.rint(problem.points[order] / size * counts).astype(np.int64)


def all_numbers(counts, axes):
    """(n,3) of every free node of a box, the direction axes[2] slowest."""
    grids = np.meshgrid(*[np.arange(1 if k == 0 else 0, n + 1) for k, n in enumerate(counts)],
                        indexing="ij")  # fmt: skip
    numbers = np.stack([grid.ravel() for grid in grids], axis=1)
    return numbers[np.lexsort(tuple(numbers[:, axis] for axis in axes))]


def flat(numbers, counts):
    """One number per grid node."""
    n = counts + 1
    return (numbers[:, 0] * n[1] + numbers[:, 1]) * n[2] + numbers[:, 2]
