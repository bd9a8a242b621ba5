"""Linear orthotropic elasticity."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.fem.materials.constants import ANY, FROM_ZERO, POSITIVE, constant
from gpusim.fem.materials.linear_elasticity import LinearElasticity
from gpusim.fem.materials.symmetric_tensors import COLUMN, ENGINEERING, ROW, strain_congruence
from gpusim.validation import finite_numbers, require, unmasked

Triple = tuple[float, float, float]

# pairs of axes of the shear components, in the order xy yz zx
_SHEAR = ((0, 1), (1, 2), (2, 0))


@unmasked()
@dataclass(frozen=True)
class Orthotropic(LinearElasticity):
    """Linear orthotropic elasticity, in any consistent units.

    Parameters
    ----------
    E : (E1, E2, E3) Young's moduli along the material axes, > 0.
    nu : (nu12, nu23, nu31). nu_ij is the contraction along j over the extension along i when
        pulled along i: strain_j = -nu_ij strain_i. So nu_ij / E_i = nu_ji / E_j; tables (and
        Abaqus decks) that give nu13 want nu31 = nu13 E3 / E1.
    G : (G12, G23, G31) shear moduli, > 0.
    density : >= 0.
    expansion : (a1, a2, a3) thermal expansion along the material axes.
    axes : (3,3), row i is the unit vector of material axis i in global axes; right-handed.
        Default: the global axes. Directions that deviate from orthonormal by less than 1e-6 are
        made exactly so.

    Raises InputError for wrong numbers, and for moduli that give no positive definite stiffness
    (energy would be gained by deforming): needs |nu_ij| < sqrt(E_i / E_j) and
    1 - nu12 nu21 - nu23 nu32 - nu31 nu13 - 2 nu21 nu32 nu13 > 0.

    Examples
    --------
    >>> wood = gs.Orthotropic(E=(11e9, 4e8, 8e8), nu=(0.4, 0.3, 0.03), G=(7e8, 5e7, 7e8))
    >>> wood.axes[0]
    (1.0, 0.0, 0.0)
    """

    E: Triple
    nu: Triple
    G: Triple
    density: float = 0.0
    expansion: Triple = (0.0, 0.0, 0.0)
    axes: tuple[Triple, Triple, Triple] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))

    def __post_init__(self) -> None:
        for name, rule in (("E", POSITIVE), ("nu", ANY), ("G", POSITIVE), ("expansion", ANY)):
            given, what = getattr(self, name), f"Orthotropic: {name} out of range"
            count = len(given) if isinstance(given, Sequence) else np.shape(given)
            require(count in (3, (3,)), what, repr(given), f"three of {rule.expected}")
            values = tuple(constant(one, f"Orthotropic: {name}", rule) for one in given)
            object.__setattr__(self, name, values)
        density = constant(self.density, "Orthotropic: density", FROM_ZERO)
        object.__setattr__(self, "density", density)
        object.__setattr__(self, "axes", _rotation(self.axes))
        _check_definite(self.E, self.nu)

    def stiffness(self) -> Float:
        """(6,6) stress over strain in global axes, order xx yy zz xy yz zx, engineering shear."""
        compliance = np.diag([*(1.0 / np.array(self.E)), *(1.0 / np.array(self.G))])
        for (i, j), nu in zip(_SHEAR, self.nu, strict=True):
            compliance[i, j] = compliance[j, i] = -nu / self.E[i]
        in_axes = np.zeros((6, 6))
        in_axes[:3, :3] = np.linalg.inv(compliance[:3, :3])
        in_axes[np.arange(3, 6), np.arange(3, 6)] = self.G
        turn = strain_congruence(np.array(self.axes))
        matrix = turn.T @ in_axes @ turn
        return np.asarray(0.5 * (matrix + matrix.T))

    def expansion_strain(self) -> Float:
        """(6,) free strain per unit of temperature change in global axes, engineering shear."""
        axes = np.array(self.axes)
        strain = axes.T @ np.diag(self.expansion) @ axes
        return np.asarray(strain[ROW, COLUMN] * ENGINEERING)


def _rotation(value: Any) -> tuple[Triple, ...]:
    expected = "three orthonormal rows, right-handed"
    axes = finite_numbers(value, "Orthotropic: axes", [(3, 3)], expected)
    off = float(np.abs(axes @ axes.T - np.eye(3)).max())
    what = f"Orthotropic: axes are off orthonormal by {off:.2g}"
    require(off <= 1e-6, what, axes.tolist(), expected)
    right_handed = np.linalg.det(axes) > 0.0
    require(right_handed, "Orthotropic: axes are left-handed", axes.tolist(), expected)
    left, _, right = np.linalg.svd(axes)
    exact = left @ right
    # what is exact already stays as it was given
    rows = axes if off <= 1e-15 else exact
    return tuple((float(a), float(b), float(c)) for a, b, c in rows)


def _check_definite(E: Triple, nu: Triple) -> None:
    for (i, j), value in zip(_SHEAR, nu, strict=True):
        limit = float(np.sqrt(E[i] / E[j]))
        what = f"Orthotropic: nu{i + 1}{j + 1} makes the stiffness indefinite"
        expected = f"a size below sqrt(E{i + 1}/E{j + 1}) = {limit:.6g}"
        require(abs(value) < limit, what, value, expected)
    # with x_ij = nu_ij sqrt(E_j / E_i), the scaled compliance's determinant
    x, y, z = (value * np.sqrt(E[j] / E[i]) for (i, j), value in zip(_SHEAR, nu, strict=True))
    rest = 1.0 - x * x - y * y - z * z - 2.0 * x * y * z
    sum_of_products = f"1 - nu12 nu21 - nu23 nu32 - nu31 nu13 - 2 nu21 nu32 nu13 = {rest:.3g}"
    got = f"{nu} with E {E} ({sum_of_products})"
    require(rest > 1e-12, "Orthotropic: nu makes the stiffness indefinite", got, "a positive value")
