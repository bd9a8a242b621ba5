"""Linear elasticity: stress = stiffness times strain, the law of whatever has no other."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import InputError
from gpusim.fem.materials.law import Law, Material, Update, results_of
from gpusim.validation import require

_SAME = 1e-9  # of the stiffness' largest entry
_PROBE = 1e-3  # strain that a linear law is asked with


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

    def results(self, strain: Float, state: Float | None) -> dict[str, Float]:
        """The energy (…)."""
        stress = self.update(strain, state, moduli=False).stress
        return {"energy": 0.5 * (stress * strain).sum(axis=-1)}


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
    there, and has its ``stiffness()`` as moduli; and, if it is for small strain, is that stiffness
    alone: elements that turn ask for nothing else. Elements would rather not find out later.
    """
    if not hasattr(material, "update"):
        return LinearMaterial(material)
    missing = [name for name in ("state_size", "finite_strain") if not hasattr(material, name)]
    if not isinstance(material, Law):
        got = f"update() without {' and '.join(missing)}"
        raise InputError(f"{where}: no law; got {got}; expected the members of gs.fem.Law")
    stiffness = np.asarray(material.stiffness())
    scale = float(np.abs(stiffness).max())
    stress, moduli = _answer(material, np.zeros((2, 3, 6)), where)
    largest = float(np.abs(stress).max())
    require(largest <= _SAME * scale, f"{where}: stress without strain", largest, "0")
    off = np.abs(moduli - stiffness).reshape(-1, 6, 6).max(axis=0)
    row, column = np.unravel_index(int(off.argmax()), off.shape)
    what = f"{where}: moduli of update() at rest are off stiffness()"
    got = f"a difference of {off.max():.3g} in row {row}, column {column}"
    require(off.max() <= _SAME * scale, what, got, "the same")
    if material.finite_strain:
        return material
    expected = "finite_strain = True: elements for small strain ask for stiffness() alone"
    require(material.state_size == 0, f"{where}: history", "finite_strain = False", expected)
    strain = np.broadcast_to(_PROBE * np.eye(6), (2, 6, 6))
    stress, _ = _answer(material, strain, where)
    off = np.abs(stress - strain @ stiffness)
    what = f"{where}: stress of update() isn't stiffness() times strain"
    require(off.max() <= _SAME * _PROBE * scale, what, f"a difference of {off.max():.3g}", expected)
    return material


def _answer(law: Law, strain: Float, where: str) -> tuple[Float, Float]:
    """Stress and moduli of a law that has been through nothing yet, in their shapes."""
    size, shape = law.state_size, strain.shape[:-1]
    state = np.zeros((*shape, size)) if size else None
    found = law.update(strain, state, moduli=True)
    require(isinstance(found, Update), f"{where}: update()", type(found).__name__, "an Update")
    stress, moduli = np.asarray(found.stress), np.asarray(found.moduli)
    shapes = stress.shape, moduli.shape
    fits = shapes in ((strain.shape, (6, 6)), (strain.shape, (*shape, 6, 6)))
    expected = f"{strain.shape}, and (6, 6) or {(*shape, 6, 6)}"
    require(fits, f"{where}: shapes of update()'s stress and moduli", shapes, expected)
    new = None if found.state is None else np.shape(found.state)
    expected = f"{None if state is None else state.shape}"
    require(str(new) == expected, f"{where}: shape of update()'s state", new, expected)
    finite = np.isfinite(stress).all() and np.isfinite(moduli).all()
    require(bool(finite), f"{where}: update()", "values that aren't finite", "finite numbers")
    for name, values in results_of(law, strain, state).items():
        got = np.shape(values)
        what = f"{where}: shape of results()'s {name!r}"
        require(got[:2] == shape and len(got) <= 3, what, got, f"{shape} or {(*shape, 'c')}")
    return stress, moduli
