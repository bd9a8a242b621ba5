"""Quadrature on the reference cells and faces of ``gpusim.mesh.shape_functions``. Pure data.

A rule is known by its cell shape and its number of points. Every weight is positive, so that a
sum of positive terms (a volume, an energy) can't become negative by rounding.
"""

from __future__ import annotations

from functools import cache
from itertools import permutations

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.mesh.cell_types import CELL_TYPES

FULL_POINTS: dict[str, int] = {
    "hex8": 8, "hex20": 27, "hex27": 27, "tet4": 1, "tet10": 4, "wedge6": 2, "wedge15": 9,
    "pyramid5": 8, "pyramid13": 27,
}  # fmt: skip
"""Points of the stiffness rule called "full", the one of Abaqus and CalculiX where they have it."""

# Orbits: barycentric coordinates up to permutation, and the weight of each point; the sum is 1.
_Orbits = list[tuple[tuple[float, ...], float]]
_TRIANGLE: dict[int, _Orbits] = {
    1: [((1 / 3, 1 / 3, 1 / 3), 1.0)],
    3: [((1 / 6, 1 / 6, 2 / 3), 1 / 3)],
    # degree 4: Strang & Fix, An Analysis of the Finite Element Method (1973)
    6: [
        (
            (0.44594849091596488632, 0.44594849091596488632, 0.10810301816807022736),
            0.22338158967801146570,
        ),
        (
            (0.09157621350977074346, 0.09157621350977074346, 0.81684757298045851308),
            0.10995174365532186764,
        ),
    ],
}
_ROOT5 = 5.0**0.5
_A, _B, _C = 0.31088591926330060980, 0.092735250310891226402, 0.045503704125649649492
_TETRAHEDRON: dict[int, _Orbits] = {
    1: [((0.25, 0.25, 0.25, 0.25), 1.0)],
    4: [((*(3 * [(5.0 - _ROOT5) / 20.0]), (5.0 + 3.0 * _ROOT5) / 20.0), 0.25)],
    # degree 5: Walkington, Quadrature on simplices of arbitrary dimension (2000)
    14: [
        ((_A, _A, _A, 1.0 - 3.0 * _A), 0.11268792571801585080),
        ((_B, _B, _B, 1.0 - 3.0 * _B), 0.073493043116361949544),
        ((_C, _C, 0.5 - _C, 0.5 - _C), 0.042546020777081466438),
    ],
}
# Heights and weights on [0,1] for the weight function (1-z)^2, which sums to 1/3.
_JACOBI: dict[int, tuple[tuple[float, ...], tuple[float, ...]]] = {
    1: ((0.25,), (1 / 3,)),
    2: ((0.1225148226554415, 0.5441518440112253), (0.232547451253508, 0.10078588207982532)),
    3: (
        (0.0729940240731497, 0.3470037660383518, 0.7050022098884984),
        (0.15713636106488646, 0.1462462692598661, 0.029950703008580742),
    ),
}


@cache
def cell_rule(kind: str, points: int) -> tuple[Float, Float]:
    """Points (Q,3) and weights (Q,) of a cell type; the weights add up to the reference volume.

    Hexahedra 1, 8, 27 (Gauss); tetrahedra 1, 4, 14; wedges 2, 6, 9, 18 (triangle times Gauss);
    pyramids 1, 8, 27 (conical product: Gauss times Gauss-Jacobi).
    """
    shape = CELL_TYPES[kind].linear
    if shape == "hex8":
        place, weight = _product(_gauss(round(points ** (1 / 3))), 3)
    elif shape == "tet4":
        place, weight = _simplex(_TETRAHEDRON[points])
        weight = weight / 6.0
    elif shape == "wedge6":
        flat, line = {2: (1, 2), 6: (3, 2), 9: (3, 3), 18: (6, 3)}[points]
        place, weight = _extruded(face_rule("tri3", flat), _gauss(line))
    else:
        place, weight = _conical(round(points ** (1 / 3)))
    return _frozen(place), _frozen(weight)


@cache
def face_rule(kind: str, points: int) -> tuple[Float, Float]:
    """Points (Q,2) and weights (Q,): triangles 1, 3, 6; squares 1, 4, 9."""
    if kind.startswith("tri"):
        place, weight = _simplex(_TRIANGLE[points])
        weight = weight / 2.0
    else:
        place, weight = _product(_gauss(round(points**0.5)), 2)
    return _frozen(place), _frozen(weight)


def _gauss(count: int) -> tuple[Float, Float]:
    return {
        1: (np.zeros(1), np.full(1, 2.0)),
        2: (np.array([-1.0, 1.0]) / np.sqrt(3.0), np.ones(2)),
        3: (np.sqrt(0.6) * np.array([-1.0, 0.0, 1.0]), np.array([5.0, 8.0, 5.0]) / 9.0),
    }[count]


def _product(line: tuple[Float, Float], axes: int) -> tuple[Float, Float]:
    """Tensor product, the first coordinate running fastest."""
    grid = np.meshgrid(*([line[0]] * axes), indexing="ij")
    weights = np.meshgrid(*([line[1]] * axes), indexing="ij")
    place = np.stack([part.ravel() for part in grid[::-1]], axis=1)
    return place, np.prod([part.ravel() for part in weights], axis=0)


def _simplex(orbits: _Orbits) -> tuple[Float, Float]:
    """Every point of the orbits; the first barycentric coordinate is the dependent one."""
    points = [
        (place[1:], weight)
        for orbit, weight in orbits
        for place in sorted(set(permutations(orbit)))
    ]
    return np.array([place for place, _ in points]), np.array([weight for _, weight in points])


def _extruded(flat: tuple[Float, Float], line: tuple[Float, Float]) -> tuple[Float, Float]:
    """Triangle rule times line rule, the triangle's points running fastest."""
    count, levels = len(flat[1]), len(line[1])
    place = np.empty((count * levels, 3))
    place[:, :2] = np.tile(flat[0], (levels, 1))
    place[:, 2] = np.repeat(line[0], count)
    return place, np.outer(line[1], flat[1]).ravel()


def _conical(count: int) -> tuple[Float, Float]:
    """A pyramid's levels are squares of half-width 1-z: Gauss there, Gauss-Jacobi along z."""
    height, share = _JACOBI[count]
    flat, area = _product(_gauss(count), 2)
    place = np.empty((len(height), len(flat), 3))
    place[:, :, :2] = flat * (1.0 - np.array(height))[:, None, None]
    place[:, :, 2] = np.array(height)[:, None]
    return place.reshape(-1, 3), np.outer(share, area).ravel()


def _frozen(values: Float) -> Float:
    values.setflags(write=False)
    return values
