"""Element stiffness matrices a second time, in any arithmetic: the reference's own.

Shape functions come from the monomials of each element and the positions of its nodes, by solving
for the coefficients; nothing is taken from ``gpusim.fem``. Node order is VTK's.
"""

from __future__ import annotations

import decimal
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt

__all__ = ["ELEMENT_KINDS", "element_matrices"]

Array = npt.NDArray[Any]

_HEX_CORNERS = [
    (-1, -1, -1), (1, -1, -1), (1, 1, -1), (-1, 1, -1),
    (-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1),
]  # fmt: skip
_HEX_EDGES = [
    (0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7),
]  # fmt: skip
_TET_CORNERS = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
_TET_EDGES = [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)]


def _with_middles(
    corners: list[tuple[int, int, int]], edges: list[tuple[int, int]]
) -> list[tuple[float, ...]]:
    middles = [tuple((np.array(corners[a]) + corners[b]) / 2) for a, b in edges]
    return [*corners, *middles]


def _superlinear(powers: tuple[int, ...]) -> int:
    return sum(power for power in powers if power > 1)


@dataclass(frozen=True)
class _Kind:
    """Nodes in reference coordinates and the powers of x, y, z of each monomial."""

    nodes: list[tuple[float, ...]]
    powers: list[tuple[int, ...]]
    rules: tuple[str, ...]


_CUBE = [p for p in product(range(3), repeat=3)]
ELEMENT_KINDS = {
    "hex8": _Kind(
        [*_HEX_CORNERS], [p for p in _CUBE if max(p) <= 1], ("incompatible", "full", "bbar")
    ),
    "hex20": _Kind(
        _with_middles(_HEX_CORNERS, _HEX_EDGES),
        [p for p in _CUBE if _superlinear(p) <= 2],
        ("full", "reduced"),
    ),
    "tet4": _Kind([*_TET_CORNERS], [p for p in _CUBE if sum(p) <= 1], ("full",)),
    "tet10": _Kind(
        _with_middles(_TET_CORNERS, _TET_EDGES), [p for p in _CUBE if sum(p) <= 2], ("full",)
    ),
}


def element_matrices(
    kind: str, nodes: Array, elasticity: Array, rule: str, dtype: np.dtype[Any]
) -> Array:
    """(M,3k,3k) of elements with ``nodes`` (M,k,3) and one ``elasticity`` (6,6).

    hex8 "incompatible": nine internal modes 1 - xi^2, gradients with the Jacobian at the centre
    scaled by detJ0/detJ (Taylor, Beresford & Wilson 1976); "bbar": mean dilatation (Hughes 1980).
    """
    table = ELEMENT_KINDS[kind]
    points, weights = _quadrature(kind, rule, dtype)
    gradients = _gradients(table, points, dtype)
    steps = [_step(nodes, gradients[q], weights[q]) for q in range(len(points))]
    strains = [_strain(gradient) for gradient, _ in steps]
    if rule == "bbar":
        volume = np.sum([v for _, v in steps], axis=0)
        weighted = np.sum([g * v[:, None, None] for g, v in steps], axis=0)
        mean = weighted / volume[:, None, None]
        for (gradient, _), strain in zip(steps, strains, strict=True):
            shift = ((mean - gradient) / 3).reshape(len(nodes), 1, -1)
            strain[:, :3, :] += shift
    matrix = _sum_of_products(strains, strains, steps, elasticity)
    if rule == "incompatible":
        centre = _gradients(table, points[:1] * 0, dtype)[0]
        jacobian = np.matmul(nodes.transpose(0, 2, 1), centre)
        at_centre, back = _determinant(jacobian), _inverse3(jacobian)
        inner = []
        for q, (_, volume) in enumerate(steps):
            scale = at_centre * weights[q] / volume
            # d(1 - xi_a^2)/d xi_b = -2 xi_a delta_ab
            local = np.zeros((3, 3), dtype=dtype) + points[q][:, None] * 0
            local[np.arange(3), np.arange(3)] = -2 * points[q]
            inner.append(_strain(np.matmul(local[None], back) * scale[:, None, None]))
        coupling = _sum_of_products(inner, strains, steps, elasticity)
        own = _sum_of_products(inner, inner, steps, elasticity)
        matrix = matrix - np.matmul(coupling.transpose(0, 2, 1), _solved(own, coupling))
    return matrix


def _step(nodes: Array, gradient: Array, weight: Any) -> tuple[Array, Array]:
    """Gradients in space (M,k,3) and volume (M,) of one quadrature point."""
    jacobian = np.matmul((nodes - nodes[:, :1]).transpose(0, 2, 1), gradient)
    return np.matmul(gradient[None], _inverse3(jacobian)), _determinant(jacobian) * weight


def _sum_of_products(
    left: list[Array], right: list[Array], steps: list[tuple[Array, Array]], elasticity: Array
) -> Array:
    parts = [
        np.matmul(a.transpose(0, 2, 1), np.matmul(elasticity[None], b)) * volume[:, None, None]
        for a, b, (_, volume) in zip(left, right, steps, strict=True)
    ]
    return np.asarray(sum(parts[1:], parts[0]))


def _strain(gradient: Array) -> Array:
    """(M,k,3) -> (M,6,3k), order xx yy zz xy yz zx, engineering shear."""
    zero = gradient[..., 0] * 0
    x, y, z = (gradient[..., axis] for axis in range(3))
    rows = [(x, zero, zero), (zero, y, zero), (zero, zero, z),
            (y, x, zero), (zero, z, y), (z, zero, x)]  # fmt: skip
    stacked = np.stack([np.stack(row, axis=-1) for row in rows], axis=1)
    return stacked.reshape(len(gradient), 6, -1)


def _determinant(m: Array) -> Array:
    return np.asarray(
        m[:, 0, 0] * (m[:, 1, 1] * m[:, 2, 2] - m[:, 1, 2] * m[:, 2, 1])
        - m[:, 0, 1] * (m[:, 1, 0] * m[:, 2, 2] - m[:, 1, 2] * m[:, 2, 0])
        + m[:, 0, 2] * (m[:, 1, 0] * m[:, 2, 1] - m[:, 1, 1] * m[:, 2, 0])
    )


def _inverse3(m: Array) -> Array:
    result = np.empty_like(m)
    for i, j in product(range(3), repeat=2):
        a, b, c, d = (j + 1) % 3, (j + 2) % 3, (i + 1) % 3, (i + 2) % 3
        result[:, i, j] = m[:, a, c] * m[:, b, d] - m[:, a, d] * m[:, b, c]
    return np.asarray(result / _determinant(m)[:, None, None])


def _solved(matrix: Array, right: Array) -> Array:
    """Gauss-Jordan with (M,n,n) positive definite matrices and (M,n,c) right-hand sides."""
    work = np.concatenate([matrix, right], axis=2)
    size = matrix.shape[1]
    for k in range(size):
        pivot = work[:, k, :] / work[:, k, k, None]
        column = work[:, :, k].copy()
        work -= column[:, :, None] * pivot[:, None, :]
        work[:, k, :] = pivot
    return work[:, :, size:]


def _gradients(table: _Kind, points: Array, dtype: np.dtype[Any]) -> list[Array]:
    """Per point, (k,3) derivatives of the shape functions in reference coordinates."""
    one = number(1, dtype)
    nodes = [[number(c, dtype) for c in node] for node in table.nodes]
    values = np.array(
        [[_monomial(node, powers, one) for powers in table.powers] for node in nodes], dtype=dtype
    )
    identity = np.array([[one * (i == j) for j in range(len(nodes))] for i in range(len(nodes))])
    coefficients = _pivoted(values, identity.astype(dtype))
    result = []
    for point in points:
        slopes = np.array(
            [[_slope(point, powers, axis, one) for axis in range(3)] for powers in table.powers],
            dtype=dtype,
        )
        result.append(coefficients.T @ slopes)
    return result


def _monomial(point: Any, powers: tuple[int, ...], one: Any) -> Any:
    value = one
    for coordinate, power in zip(point, powers, strict=True):
        for _ in range(power):
            value = value * coordinate
    return value


def _slope(point: Any, powers: tuple[int, ...], axis: int, one: Any) -> Any:
    if powers[axis] == 0:
        return one * 0
    lowered = tuple(power - (k == axis) for k, power in enumerate(powers))
    return powers[axis] * _monomial(point, lowered, one)


def _pivoted(matrix: Array, right: Array) -> Array:
    """Gauss-Jordan with row exchange, for the small matrix of monomials."""
    work = np.concatenate([matrix, right], axis=1)
    size = len(matrix)
    for k in range(size):
        best = k + int(np.argmax(np.abs(work[k:, k])))
        work[[k, best]] = work[[best, k]]
        work[k] = work[k] / work[k, k]
        column = work[:, k].copy()
        column[k] = column[k] * 0
        work = work - column[:, None] * work[k][None, :]
    return work[:, size:]


def number(value: float, dtype: np.dtype[Any]) -> Any:
    """A float64 as a number of the arithmetic, exactly."""
    return decimal.Decimal(float(value)) if dtype.kind == "O" else dtype.type(value)


def _quadrature(kind: str, rule: str, dtype: np.dtype[Any]) -> tuple[Array, list[Any]]:
    def root(value: float) -> Any:
        found = number(value, dtype)
        return found.sqrt() if dtype.kind == "O" else np.sqrt(found)

    one = number(1, dtype)
    if kind == "tet4":
        return np.array([[one / 4] * 3], dtype=dtype), [one / 6]
    if kind == "tet10":
        near, far = (5 - root(5)) / 20, (5 + 3 * root(5)) / 20
        points = [[far if axis == k else near for axis in range(3)] for k in range(4)]
        return np.array(points, dtype=dtype), [one / 24] * 4
    if kind == "hex20" and rule == "full":
        edge = root(15) / 5
        line = [(-edge, one * 5 / 9), (one * 0, one * 8 / 9), (edge, one * 5 / 9)]
    else:
        edge = root(3) / 3
        line = [(-edge, one), (edge, one)]
    grid = list(product(line, repeat=3))
    points = [[place for place, _ in three] for three in grid]
    weights = [three[0][1] * three[1][1] * three[2][1] for three in grid]
    return np.array(points, dtype=dtype), weights
