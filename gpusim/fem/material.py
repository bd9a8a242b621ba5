"""Materials."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError

__all__ = ["Isotropic"]


@dataclass(frozen=True)
class Isotropic:
    """Linear isotropic elasticity, in any consistent units.

    ``E`` Young's modulus > 0, ``nu`` Poisson's ratio in (-1, 0.5), ``density`` >= 0 (needed
    for gravity only). Raises InputError outside these ranges.
    """

    E: float
    nu: float
    density: float = 0.0

    def __post_init__(self) -> None:
        self._check("E", "> 0", self._number("E") > 0.0)
        self._check("nu", "in (-1, 0.5)", -1.0 < self._number("nu") < 0.5)
        self._check("density", ">= 0", self._number("density") >= 0.0)

    def _number(self, name: str) -> float:
        try:
            number = float(getattr(self, name))
        except (TypeError, ValueError):
            number = float("nan")
        object.__setattr__(self, name, number)
        return number

    def _check(self, name: str, expected: str, good: bool) -> None:
        value = getattr(self, name)
        if not (good and np.isfinite(value)):
            raise InputError(
                f"Isotropic: {name} out of range; got {value!r}; expected a number {expected}"
            )

    def stiffness(self) -> npt.NDArray[np.float64]:
        """(6,6) stress over strain, order xx yy zz xy yz zx, engineering shear strains."""
        lame = self.E * self.nu / ((1.0 + self.nu) * (1.0 - 2.0 * self.nu))
        shear = 0.5 * self.E / (1.0 + self.nu)
        matrix = np.zeros((6, 6))
        matrix[:3, :3] = lame
        matrix[np.arange(3), np.arange(3)] += 2.0 * shear
        matrix[np.arange(3, 6), np.arange(3, 6)] = shear
        return matrix
