"""Reference displacements that share no code with the solver, in 64 or in more digits.

Element matrices, assembly and elimination are written here a second time and run in any arithmetic
that NumPy can carry: ``numpy.longdouble`` (80 bits on x86, about 19 digits) or Python's `Decimal`
with 50 digits, for bodies whose condition number leaves nothing of 19. The matrix is ordered by
the levels of a breadth-first search from the supports, which makes it block tridiagonal; blocks are
eliminated one after the other. Small problems only: a level of some hundred unknowns.
"""

from __future__ import annotations

import decimal
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from benchmarks.solver.element_matrices import element_matrices
from gpusim.errors import InputError
from gpusim.fem import Model

__all__ = ["DIGITS", "Reference", "reference_solution"]

Float = npt.NDArray[np.float64]
Array = npt.NDArray[Any]
Long = npt.NDArray[np.int64]

DIGITS = 50


@dataclass(frozen=True)
class Reference:
    """``u`` (L,N,3) float64; ``error`` how far a second elimination of the residual moved it."""

    u: Float
    error: float
    arithmetic: str


def reference_solution(model: Model, rules: dict[str, str], wanted: float = 1e-9) -> Reference:
    """Displacements of ``model`` to a relative error of ``wanted`` (max norm, own estimate).

    ``rules`` names the integration rule of each cell type. Raises InputError if 50 digits don't
    give ``wanted`` either (a singular matrix).
    """
    error = np.inf
    if np.finfo(np.longdouble).eps < 1e-18:
        found = _solve(model, rules, np.dtype(np.longdouble))
        if found.error <= wanted:
            return found
        error = found.error
    with decimal.localcontext(prec=DIGITS):
        found = _solve(model, rules, np.dtype(object))
    if not found.error <= wanted:
        raise InputError(
            f"reference: singular; got an error of {found.error:.1g} with {DIGITS} digits and "
            f"{error:.1g} with 19; expected at most {wanted:.1g}"
        )
    return found


def _solve(model: Model, rules: dict[str, str], dtype: np.dtype[Any]) -> Reference:
    assert model.fixed is not None and model.prescribed is not None
    fixed = model.fixed.copy()
    fixed[model.mesh.dangling_nodes] = True
    matrix = _Blocks(model, rules, dtype)
    given = as_arithmetic(np.where(model.fixed, model.prescribed, 0.0), dtype)
    loads = as_arithmetic(model.load_cases, dtype)
    cases, count = len(loads), len(fixed)
    right = np.moveaxis(loads, 0, -1) - matrix.product(given.reshape(count, 3, 1))
    levels = _levels(matrix.row, matrix.column, fixed)
    factor = _eliminate(matrix, levels, fixed)
    u = _substitute(factor, levels, fixed, right)
    left_over = right - matrix.product(u)
    # a residual is formed in the same arithmetic: the second answer says how much it can be off
    change = _substitute(factor, levels, fixed, left_over)
    size = np.abs(u).max(axis=(0, 1))
    moved = np.abs(change).max(axis=(0, 1))
    error = max(float(m / s) if s else 0.0 for m, s in zip(moved, size, strict=True))
    u = u + change + given[..., None]
    return Reference(
        np.moveaxis(u, -1, 0).astype(np.float64).reshape(cases, count, 3),
        error,
        "80 bits" if dtype.kind != "O" else f"{DIGITS} digits",
    )


def as_arithmetic(values: npt.ArrayLike, dtype: np.dtype[Any]) -> Array:
    """Float64 numbers, exactly, as ``dtype`` (object: Decimal)."""
    array = np.asarray(values, dtype=np.float64)
    if dtype.kind != "O":
        return array.astype(dtype)
    exact = [decimal.Decimal(value) for value in array.ravel().tolist()]
    result = np.empty(len(exact), dtype=object)
    result[:] = exact
    return result.reshape(array.shape)


class _Blocks:
    """K as 3x3 blocks (row, column, block), both triangles, each pair once."""

    def __init__(self, model: Model, rules: dict[str, str], dtype: np.dtype[Any]) -> None:
        mesh = model.mesh
        self.count, self.dtype = mesh.node_count, dtype
        assert model.material_of_cell is not None
        keys: list[Long] = []
        blocks: list[Array] = []
        moduli = [as_arithmetic(one.stiffness(), np.dtype(np.float64)) for one in model.materials]
        for kind, first, cells in mesh.blocks():
            of_cell = model.material_of_cell[first : first + len(cells)]
            width = cells.shape[1]
            for number, stiffness in enumerate(moduli):
                chosen = cells[of_cell == number].astype(np.int64)
                if len(chosen) == 0:
                    continue
                first_alike, alike = unique_shapes(mesh.points[chosen])
                points = as_arithmetic(mesh.points[chosen[first_alike]], dtype)
                values = element_matrices(
                    kind, points, as_arithmetic(stiffness, dtype), rules[kind], dtype
                )[alike]
                split = values.reshape(-1, width, 3, width, 3).transpose(0, 1, 3, 2, 4)
                blocks.append(split.reshape(-1, 3, 3))
                keys.append((chosen[:, :, None] * self.count + chosen[:, None, :]).ravel())
        key, place = np.unique(np.concatenate(keys), return_inverse=True)
        self.row, self.column = key // self.count, key % self.count
        self.block = zeros((len(key), 3, 3), dtype)
        np.add.at(self.block, place, np.concatenate(blocks))

    def product(self, u: Array) -> Array:
        """K u for ``u`` (N,3,L)."""
        result = zeros(u.shape, self.dtype)
        np.add.at(result, self.row, np.matmul(self.block, u[self.column]))
        return result


def unique_shapes(points: Float) -> tuple[Long, Long]:
    """Elements (M,k,3) that are a shift apart, to the last bit: the first of each, and of each
    element which it is. Differences are sums of two float64, which hold them exactly."""
    first = -points[:, :1]
    total = points + first
    part = total - points
    lost = (points - (total - part)) + (first - part)
    words = np.concatenate([total, lost], axis=2).reshape(len(points), -1) + 0.0
    _, one, of_each = np.unique(words, axis=0, return_index=True, return_inverse=True)
    return one, of_each.ravel()


def zeros(shape: tuple[int, ...], dtype: np.dtype[Any]) -> Array:
    """Zeros of the arithmetic: an object array holds Decimal(0)."""
    if dtype.kind != "O":
        return np.zeros(shape, dtype=dtype)
    return np.full(shape, decimal.Decimal(0), dtype=object)


def _levels(row: Long, column: Long, fixed: npt.NDArray[np.bool_]) -> list[Long]:
    """Nodes by their distance, in edges, from the fully fixed (or, if none, all held) nodes."""
    count = len(fixed)
    whole = np.asarray(fixed.all(axis=1))
    front = whole if whole.any() else np.asarray(fixed.any(axis=1))
    seen = np.zeros(count, dtype=bool)
    levels: list[Long] = []
    if not front.any():
        front = np.arange(count) == 0
    while front.any():
        levels.append(np.flatnonzero(front))
        seen |= front
        reached = np.zeros(count, dtype=bool)
        reached[column[front[row]]] = True
        front = reached & ~seen
    return levels


@dataclass(frozen=True)
class _Factor:
    """Per level: inverse of the eliminated diagonal block, and the block to the next level."""

    inverse: list[Array]
    after: list[Array]


def _eliminate(matrix: _Blocks, levels: list[Long], fixed: npt.NDArray[np.bool_]) -> _Factor:
    level_of = np.full(matrix.count, -1)
    place = np.zeros(matrix.count, dtype=np.int64)
    for number, nodes in enumerate(levels):
        level_of[nodes] = number
        place[nodes] = np.arange(len(nodes))
    row_level, column_level = level_of[matrix.row], level_of[matrix.column]
    order = np.argsort(row_level, kind="stable")
    bounds = np.searchsorted(row_level[order], np.arange(len(levels) + 1))
    inverse: list[Array] = []
    after: list[Array] = []
    for number, nodes in enumerate(levels):
        entries = order[bounds[number] : bounds[number + 1]]
        free = ~fixed[nodes].ravel()

        def dense(
            step: int, entries: Long = entries, number: int = number, nodes: Long = nodes
        ) -> Array:
            own = entries[column_level[entries] == number + step]
            other = levels[number + step]
            full = zeros((len(nodes), len(other), 3, 3), matrix.dtype)
            full[place[matrix.row[own]], place[matrix.column[own]]] = matrix.block[own]
            return full.transpose(0, 2, 1, 3).reshape(3 * len(nodes), 3 * len(other))

        diagonal = dense(0)[free][:, free]
        if number:
            before = after[-1]
            diagonal = diagonal - before.T @ (inverse[-1] @ before)
        inverse.append(inverted(diagonal))
        if number + 1 < len(levels):
            after.append(dense(1)[free][:, ~fixed[levels[number + 1]].ravel()])
    return _Factor(inverse, after)


def inverted(matrix: Array) -> Array:
    """Inverse of a positive definite matrix (m,m) by Gauss-Jordan, any arithmetic."""
    size = len(matrix)
    work = np.concatenate([matrix, zeros((size, size), matrix.dtype)], axis=1)
    one = decimal.Decimal(1) if matrix.dtype.kind == "O" else 1.0
    work[np.arange(size), size + np.arange(size)] = one
    for k in range(size):
        # columns left of k are done, those right of size + k still empty
        part = slice(k, size + k + 1)
        pivot = work[k, part] / work[k, k]
        column = work[:, k].copy()
        work[:, part] -= column[:, None] * pivot[None, :]
        work[k, part] = pivot
    return work[:, size:]


def _substitute(
    factor: _Factor, levels: list[Long], fixed: npt.NDArray[np.bool_], right: Array
) -> Array:
    """Solve for (N,3,L); zero where fixed."""
    cases = right.shape[2]
    parts = [right[nodes].reshape(-1, cases)[~fixed[nodes].ravel()] for nodes in levels]
    for k in range(1, len(levels)):
        parts[k] = parts[k] - factor.after[k - 1].T @ (factor.inverse[k - 1] @ parts[k - 1])
    result = zeros(right.shape, right.dtype)
    later: Array | None = None
    for k in range(len(levels) - 1, -1, -1):
        own = parts[k] if later is None else parts[k] - factor.after[k] @ later
        later = factor.inverse[k] @ own
        full = zeros((3 * len(levels[k]), cases), right.dtype)
        full[~fixed[levels[k]].ravel()] = later
        result[levels[k]] = full.reshape(len(levels[k]), 3, cases)
    return result
