"""Linear elasticity: stress = stiffness times strain, the law of whatever has no other."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import InputError
from gpusim.fem.materials.law import Law, Material, Update
from gpusim.validation import require

_SAME = 1e-9  # of the stiffness' largest entry


class LinearElasticity(ABC):
    """The part of a law that follows from ``stiffness()`` alone."""

    state_size: ClassVar[int] = 0
    finite_strain: ClassVar[bool] = False

    @abstractmethod
    def stiffness(self) -> Float:
        """(6,6) stress over strain, order xx yy zz xy yz zx, engineering shear strains."""

    def update(self, strain: Float, state: Float | None, *, moduli: bool) -> Update:
        """Stress linear in the strain (…,6); moduli (6,6), the same everywhere; no state."""
        matrix = self.stiffness()
        stress = (strain.reshape(-1, 6) @ matrix).reshape(strain.shape)
        return Update(stress, matrix if moduli else None, None)


@dataclass(frozen=True, eq=False)
class LinearMaterial(LinearElasticity):
    """A user's own material that says nothing but its stiffness, as a law."""

    material: Material

    @property
    def density(self) -> float:
        """Mass per volume."""
        return self.material.density

    def stiffness(self) -> Float:
        """(6,6) the material's own."""
        return np.asarray(self.material.stiffness(), np.float64)

    def expansion_strain(self) -> Float:
        """(6,) the material's own."""
        return self.material.expansion_strain()


def law_of(material: Material, where: str) -> Law:
    """``material`` itself if it is a law, else as a linear one.

    Raises InputError naming ``where`` unless a law is at rest without strain, keeps its state
    there, and has its ``stiffness()`` as moduli: elements would rather not find out later.
    """
    if not hasattr(material, "update"):
        return LinearMaterial(material)
    missing = [name for name in ("state_size", "finite_strain") if not hasattr(material, name)]
    if missing or not isinstance(material, Law):
        got = f"update() without {' and '.join(missing)}"
        raise InputError(f"{where}: no law; got {got}; expected the members of gs.fem.Law")
    size, points = material.state_size, 2
    state = np.zeros((points, size)) if size else None
    found = material.update(np.zeros((points, 6)), state, moduli=True)
    moduli = np.asarray(found.moduli)
    shapes = np.shape(found.stress), moduli.shape
    fits = shapes in (((points, 6), (6, 6)), ((points, 6), (points, 6, 6)))
    expected = "(…, 6) and (…, 6, 6)"
    require(fits, f"{where}: shapes of update()'s stress and moduli", shapes, expected)
    new = None if found.state is None else np.shape(found.state)
    expected = f"{None if state is None else state.shape}"
    require(str(new) == expected, f"{where}: shape of update()'s state", new, expected)
    stiffness = np.asarray(material.stiffness())
    scale = np.abs(stiffness).max()
    stress = float(np.abs(found.stress).max())
    require(stress <= _SAME * scale, f"{where}: stress without strain", stress, "0")
    off = float(np.abs(moduli - stiffness).max())
    what = f"{where}: moduli of update() at rest are off stiffness()"
    require(off <= _SAME * scale, what, f"{off:.3g}", "the same")
    return material
