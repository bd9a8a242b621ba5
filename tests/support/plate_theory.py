"""Natural frequencies of skew plates by Ritz's method with Legendre polynomials, up to its limit.

Thin by Kirchhoff's theory, thick as the solid that it is: frequencies come down to the exact ones
as ``count``, the polynomials each way, grows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numpy.polynomial import Legendre
from scipy.linalg import eigh

Float = npt.NDArray[np.float64]
Ends = tuple[int, int]
"""How often functions vanish at -1 and at 1: 0 free, 1 held, 2 held and not turned."""
Terms = Mapping[tuple[int, int], float]
"""Factors of the derivatives of w, so often by the first and by the second skew coordinate."""


@dataclass(frozen=True)
class SkewPlate:
    """Sides ``length`` along x and ``width``, at ``angle`` degrees."""

    length: float
    width: float
    thickness: float
    E: float
    nu: float
    density: float
    angle: float = 90.0

    @property
    def gradient(self) -> Float:
        """(3,3) derivatives of coordinates from -1 to 1 (columns) by x, y, z (rows)."""
        sine, cosine = np.sin(np.radians(self.angle)), np.cos(np.radians(self.angle))
        edges = np.array([[self.length, 0.0, 0.0],
                          [self.width * cosine, self.width * sine, 0.0],
                          [0.0, 0.0, self.thickness]])  # fmt: skip
        return 2.0 * np.linalg.inv(edges)


def thin_plate(plate: SkewPlate, ends_x: Ends, ends_y: Ends, count: int) -> Float:
    """Hz, the lowest first; about 0 for rigid-body motions."""
    points, weights = np.polynomial.legendre.leggauss(count + 6)
    along, across = (_tables(_polynomials(range(count), ends), points, 2)
                     for ends in (ends_x, ends_y))  # fmt: skip
    (a, _, _), (c, b, _), _ = plate.gradient
    twice_x, twice_y = {(2, 0): a * a}, {(0, 2): b * b, (1, 1): 2.0 * b * c, (2, 0): c * c}
    mixed = {(1, 1): a * b, (2, 0): a * c}

    def product(first: Terms, second: Terms) -> Float:
        total = np.zeros((count**2, count**2))
        for (i, j), left in first.items():
            for (k, m), right in second.items():
                sides = np.einsum("aq,bq,q", along[i], along[k], weights)
                ends = np.einsum("aq,bq,q", across[j], across[m], weights)
                total += left * right * np.kron(sides, ends)
        return total

    nu = plate.nu
    bending = plate.E * plate.thickness**3 / (12.0 * (1.0 - nu**2))
    crossed = product(twice_x, twice_y)
    stiffness = product(twice_x, twice_x) + product(twice_y, twice_y)
    stiffness += nu * (crossed + crossed.T) + 2.0 * (1.0 - nu) * product(mixed, mixed)
    mass = plate.density * plate.thickness * product({(0, 0): 1.0}, {(0, 0): 1.0})
    return _frequencies(bending * stiffness, mass)


def clamped_solid(plate: SkewPlate, count: int, across: int) -> Float:
    """Hz of bending of a plate whose four sides hold still: displacements along the plate are odd
    over its thickness, that across it is even, ``across`` functions each."""
    points, weights = np.polynomial.legendre.leggauss(max(count, 2 * across) + 4)
    side = _tables(_polynomials(range(count), (1, 1)), points, 1)
    odd, even = (_tables(_polynomials(range(first, 2 * across, 2), (0, 0)), points, 1)
                 for first in (1, 0))  # fmt: skip
    depth = (odd, odd, even)
    moduli, gradient = _moduli(plate.E, plate.nu), plate.gradient
    order = np.eye(3, dtype=int)

    def product(i: int, k: int, left: Sequence[int], right: Sequence[int]) -> Float:
        pairs = ((side, side), (side, side), (depth[i], depth[k]))
        one, two, three = (
            np.einsum("aq,bq,q", first[m], second[n], weights)
            for (first, second), m, n in zip(pairs, left, right, strict=True)
        )
        return np.kron(np.kron(one, two), three)

    size = count**2 * across
    stiffness, mass = np.zeros((2, 3 * size, 3 * size))
    for i in range(3):
        rows = slice(i * size, (i + 1) * size)
        mass[rows, rows] = plate.density * product(i, i, (0, 0, 0), (0, 0, 0))
        for k in range(3):
            factors = gradient.T @ moduli[i, :, k, :] @ gradient
            for p, q in np.argwhere(factors != 0.0):
                part = factors[p, q] * product(i, k, order[p], order[q])
                stiffness[rows, k * size : (k + 1) * size] += part
    return _frequencies(stiffness, mass)


def _moduli(E: float, nu: float) -> Float:
    """(3,3,3,3)."""
    lame, shear, unit = E * nu / ((1 + nu) * (1 - 2 * nu)), 0.5 * E / (1 + nu), np.eye(3)
    moduli = lame * np.einsum("ij,kl->ijkl", unit, unit)
    moduli += shear * np.einsum("ik,jl->ijkl", unit, unit)
    return moduli + shear * np.einsum("il,jk->ijkl", unit, unit)


def _polynomials(degrees: Sequence[int], ends: Ends) -> list[Legendre]:
    """Legendre's, times what holds the ends."""
    holds = Legendre([1.0, 1.0]) ** ends[0] * Legendre([1.0, -1.0]) ** ends[1]
    return [holds * Legendre.basis(degree) for degree in degrees]


def _tables(polynomials: Sequence[Legendre], points: Float, derivatives: int) -> list[Float]:
    """(n,Q) values and derivatives at the points."""
    tables = [np.array([one(points) for one in polynomials])]
    for order in range(1, derivatives + 1):
        tables.append(np.array([one.deriv(order)(points) for one in polynomials]))
    return tables


def _frequencies(stiffness: Float, mass: Float) -> Float:
    values = eigh(stiffness, mass, eigvals_only=True)
    return np.sqrt(np.maximum(values, 0.0)) / (2.0 * np.pi)
