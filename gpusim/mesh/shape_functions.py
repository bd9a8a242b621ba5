"""Shape functions of cells and faces, as polynomials that are 1 at one node and 0 at the others.

Reference cells: hexahedron [-1,1]^3; tetrahedron and triangle the unit simplex; wedge the unit
triangle times [-1,1]; pyramid with base [-1,1]^2 at z = 0 and its apex at (0,0,1); square
[-1,1]^2. A type is its list of monomials x^a y^b z^c (1-z)^-d; the last factor occurs in pyramids
only, which need rational functions to fit hexahedra and tetrahedra (Bedrosian, IJNME 35 (1992)
95). Solving for the nodes gives the coefficients, all of them multiples of 1/8.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.mesh.cell_types import CELL_TYPES

Powers = tuple[tuple[int, int, int, int], ...]

FACE_TYPES: dict[str, tuple[int, ...]] = {
    "tri3": (0, 1, 2),
    "tri6": (0, 1, 2, 4, 5, 6),
    "quad4": (0, 1, 2, 3),
    "quad8": (0, 1, 2, 3, 4, 5, 6, 7),
    "quad9": (0, 1, 2, 3, 4, 5, 6, 7, 8),
}
"""Face type -> the columns of `Faces.nodes` that hold its nodes."""

_SQUARE = [[-1, -1], [1, -1], [1, 1], [-1, 1]]
_TRIANGLE = [[0, 0], [1, 0], [0, 1]]
_CORNERS: dict[str, list[list[int]]] = {
    "hex8": [[*p, -1] for p in _SQUARE] + [[*p, 1] for p in _SQUARE],
    "tet4": [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "wedge6": [[*p, -1] for p in _TRIANGLE] + [[*p, 1] for p in _TRIANGLE],
    "pyramid5": [[*p, 0] for p in _SQUARE] + [[0, 0, 1]],
    "tri3": _TRIANGLE,
    "quad4": _SQUARE,
}
_FACE_PARENTS: dict[str, tuple[str, list[list[int]]]] = {
    "tri3": ("tri3", []),
    "tri6": ("tri3", [[0, 1], [1, 2], [2, 0]]),
    "quad4": ("quad4", []),
    "quad8": ("quad4", [[0, 1], [1, 2], [2, 3], [3, 0]]),
    "quad9": ("quad4", [[0, 1], [1, 2], [2, 3], [3, 0], [0, 1, 2, 3]]),
}


def _grid(limit: int, axes: int) -> Powers:
    """Every monomial with exponents up to ``limit`` in the first ``axes`` coordinates."""
    span = [range(limit + 1) if axis < axes else range(1) for axis in range(3)]
    return tuple((a, b, c, 0) for a in span[0] for b in span[1] for c in span[2])


def _total(limit: int, axes: int) -> Powers:
    """Monomials up to a total degree."""
    return tuple(power for power in _grid(limit, axes) if sum(power) <= limit)


def _serendipity(axes: int) -> Powers:
    """Quadratic in at most one coordinate at a time."""
    return tuple(power for power in _grid(2, axes) if power.count(2) <= 1)


_POWERS: dict[str, Powers] = {
    "hex8": _grid(1, 3),
    "hex20": _serendipity(3),
    "hex27": _grid(2, 3),
    "tet4": _total(1, 3),
    "tet10": _total(2, 3),
    "wedge6": tuple((a, b, c, 0) for a, b, _, _ in _total(1, 2) for c in range(2)),
    "wedge15": tuple((a, b, c, 0) for a, b, _, _ in _total(2, 2) for c in range(2))
    + tuple((a, b, 2, 0) for a, b, _, _ in _total(1, 2)),
    "pyramid5": (*_total(1, 3), (1, 1, 0, 1)),
    "pyramid13": (*_total(2, 3), (1, 1, 1, 1), (2, 1, 0, 1), (1, 2, 0, 1)),
    "tri3": _total(1, 2),
    "tri6": _total(2, 2),
    "quad4": _grid(1, 2),
    "quad8": _serendipity(2),
    "quad9": _grid(2, 2),
}


@cache
def reference_nodes(kind: str) -> Float:
    """(k,3) coordinates of a cell's nodes on the reference cell; (k,2) for a face type."""
    if kind in CELL_TYPES:
        base, groups = CELL_TYPES[kind].linear, [list(p) for p in CELL_TYPES[kind].parents]
    else:
        base, groups = _FACE_PARENTS[kind]
    corners = np.array(_CORNERS[base], dtype=np.float64)
    nodes = np.concatenate([corners, *(corners[group].mean(axis=0)[None] for group in groups)])
    nodes.setflags(write=False)
    return nodes


def shape_functions(kind: str, xi: Float) -> Float:
    """(Q,k) values at the points ``xi`` (Q,3), or (Q,2) for a face type."""
    return np.asarray(_monomials(kind, xi) @ _coefficients(kind))


def shape_gradients(kind: str, xi: Float) -> Float:
    """(Q,k,d) derivatives by the d reference coordinates at ``xi`` (Q,d).

    At a pyramid's apex they depend on the direction: don't ask for them there.
    """
    columns = [_monomials(kind, xi, axis) @ _coefficients(kind) for axis in range(xi.shape[1])]
    return np.stack(columns, axis=2)


@cache
def _coefficients(kind: str) -> Float:
    exact = np.linalg.inv(_monomials(kind, reference_nodes(kind)))
    eighths = np.asarray(np.round(8.0 * exact) / 8.0)
    assert np.abs(eighths - exact).max() < 1e-12, f"{kind}: coefficients that are no eighths"
    return eighths


def _monomials(kind: str, xi: Float, axis: int | None = None) -> Float:
    """(Q,k) values of the monomials, or their derivative by one coordinate."""
    powers = np.array(_POWERS[kind])
    point = np.zeros((len(xi), 3))
    point[:, : xi.shape[1]] = xi
    rest = 1.0 - point[:, 2]
    # at the apex x y vanishes faster than its denominator
    rest = np.where(rest == 0.0, 1.0, rest)[:, None]
    factors = [point[:, k, None] ** powers[:, k] for k in range(3)]
    factors.append(rest ** -powers[:, 3].astype(np.float64))
    if axis is None:
        return np.asarray(np.prod(factors, axis=0))
    lower = powers[:, axis]
    slope = lower * point[:, axis, None] ** np.maximum(lower - 1, 0)
    if axis == 2:
        steeper = powers[:, 3] * rest ** (-powers[:, 3] - 1.0)
        rational = factors[0] * factors[1] * factors[2] * steeper
        return np.asarray(factors[0] * factors[1] * slope * factors[3] + rational)
    factors[axis] = slope
    return np.asarray(np.prod(factors, axis=0))
