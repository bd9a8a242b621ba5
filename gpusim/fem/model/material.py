"""Materials: linear elasticity with thermal expansion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import InputError
from gpusim.validation import is_number, real_numbers, require

Triple = tuple[float, float, float]

# pairs of axes of the shear components, in the order xy yz zx
_SHEAR = ((0, 1), (1, 2), (2, 0))


@runtime_checkable
class Material(Protocol):
    """What a model asks of a material; all in global axes and any consistent units.

    Examples
    --------
    >>> isinstance(gs.Isotropic(210e9, 0.3), gs.fem.Material)
    True
    """

    @property
    def density(self) -> float:
        """Mass per volume, >= 0."""

    def stiffness(self) -> Float:
        """(6,6) stress over strain, order xx yy zz xy yz zx, engineering shear strains."""

    def expansion_strain(self) -> Float:
        """(6,) free strain per unit of temperature change, same order."""


@dataclass(frozen=True)
class Isotropic:
    """Linear isotropic elasticity, in any consistent units.

    ``E`` Young's modulus > 0, ``nu`` Poisson's ratio in (-1, 0.5), ``density`` >= 0 (needed for
    gravity, rotation and mass), ``expansion`` linear thermal expansion per unit of temperature.
    Raises InputError outside these ranges.

    Examples
    --------
    >>> steel = gs.Isotropic(E=210e9, nu=0.3, density=7850.0)
    >>> steel.stiffness().shape
    (6, 6)
    """

    finite_strain: ClassVar[bool] = False
    state_size: ClassVar[int] = 0
    E: float
    nu: float
    density: float = 0.0
    expansion: float = 0.0

    def __post_init__(self) -> None:
        for name, expected, good in (
            ("E", " > 0", lambda value: value > 0.0),
            ("nu", " in (-1, 0.5)", lambda value: -1.0 < value < 0.5),
            ("density", " >= 0", lambda value: value >= 0.0),
            ("expansion", "", lambda value: True),
        ):
            value = _number(getattr(self, name), f"Isotropic: {name}", expected)
            require(good(value), f"Isotropic: {name} out of range", value, f"a number{expected}")
            object.__setattr__(self, name, value)

    def stiffness(self) -> Float:
        """(6,6) stress over strain, order xx yy zz xy yz zx, engineering shear strains."""
        lame = self.E * self.nu / ((1.0 + self.nu) * (1.0 - 2.0 * self.nu))
        shear = 0.5 * self.E / (1.0 + self.nu)
        matrix = np.zeros((6, 6))
        matrix[:3, :3] = lame
        matrix[np.arange(3), np.arange(3)] += 2.0 * shear
        matrix[np.arange(3, 6), np.arange(3, 6)] = shear
        return matrix

    def expansion_strain(self) -> Float:
        """(6,) free strain per unit of temperature change: ``expansion`` in xx, yy, zz."""
        return np.array([self.expansion] * 3 + [0.0] * 3)


@dataclass(frozen=True)
class Orthotropic:
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

    finite_strain: ClassVar[bool] = False
    state_size: ClassVar[int] = 0
    E: Triple
    nu: Triple
    G: Triple
    density: float = 0.0
    expansion: Triple = (0.0, 0.0, 0.0)
    axes: tuple[Triple, Triple, Triple] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))

    def __post_init__(self) -> None:
        for name, expected in (("E", "> 0"), ("nu", ""), ("G", "> 0"), ("expansion", "")):
            given = getattr(self, name)
            values = _numbers(given, (3,))
            good = values is not None and (expected == "" or bool((values > 0.0).all()))
            what = f"Orthotropic: {name} out of range"
            require(good, what, repr(given), f"three numbers {expected}".rstrip())
            assert values is not None
            object.__setattr__(self, name, tuple(values.tolist()))
        density = _number(self.density, "Orthotropic: density", " >= 0")
        require(density >= 0.0, "Orthotropic: density out of range", density, "a number >= 0")
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
        turn = strain_rotation(np.array(self.axes))
        matrix = turn.T @ in_axes @ turn
        return np.asarray(0.5 * (matrix + matrix.T))

    def expansion_strain(self) -> Float:
        """(6,) free strain per unit of temperature change in global axes, engineering shear."""
        axes = np.array(self.axes)
        strain = axes.T @ np.diag(self.expansion) @ axes
        shear = [2.0 * strain[i, j] for i, j in _SHEAR]
        return np.array([*np.diag(strain), *shear])


def strain_rotation(axes: Float) -> Float:
    """(6,6) T with strain along ``axes`` (rows) = T strain in global axes (engineering shear).

    e'_ij = a_ik a_jl e_kl. Stress turns with the inverse transpose, stiffness as T^t C T.
    """
    pairs = ((0, 0), (1, 1), (2, 2), *_SHEAR)
    matrix = np.empty((6, 6))
    for row, (i, j) in enumerate(pairs):
        for column, (k, m) in enumerate(pairs):
            value = axes[i, k] * axes[j, m]
            if k != m:
                value = 0.5 * (value + axes[i, m] * axes[j, k])
            matrix[row, column] = value if row < 3 else 2.0 * value
    return matrix


def _number(value: Any, what: str, expected: str) -> float:
    """A finite number. Raises InputError for anything else, an array of one number included."""
    require(is_number(value), what, repr(value), f"a number{expected}")
    try:
        number = float(value)
    except OverflowError:  # a whole number of more than 308 digits
        number = np.inf
    require(np.isfinite(number), f"{what} out of range", number, f"a number{expected}")
    return number


def _numbers(value: Any, shape: tuple[int, ...]) -> Float | None:
    """Finite float64 of that shape, or None."""
    if isinstance(value, Sequence) and any(isinstance(one, bool) for one in value):
        return None
    try:
        array = real_numbers(value, "")
    except InputError:
        return None
    return array if array.shape == shape and bool(np.isfinite(array).all()) else None


def _rotation(value: Any) -> tuple[Triple, ...]:
    axes = _numbers(value, (3, 3))
    expected = "three orthonormal rows, right-handed"
    require(axes is not None, "Orthotropic: axes", repr(value), expected)
    assert axes is not None
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
