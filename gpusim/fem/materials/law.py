"""What a model asks of a material, and what an element asks of a law."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.field_summary import field_summary


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


@dataclass(frozen=True, eq=False)
class Update:
    """What a law answers at some points.

    Parameters
    ----------
    stress : (…,6) second Piola-Kirchhoff stress.
    moduli : (…,6,6), or (6,6) where they are the same everywhere: the derivative of the stress
        by the strain, symmetric. None where they weren't asked for.
    state : (…,n) the new state; None where the law has none.

    Examples
    --------
    >>> update = gs.Isotropic(210e9, 0.3).update(np.zeros((8, 6)), None, moduli=True)
    >>> update.stress.shape, update.moduli.shape, update.state
    ((8, 6), (6, 6), None)
    """

    stress: Float
    moduli: Float | None
    state: Float | None
    __repr__ = field_summary


@runtime_checkable
class Law(Material, Protocol):
    """A material whose stress follows from its strain and its history.

    A new law is one class in one file: these members, with constants checked when it is made.
    Strains are Green-Lagrange's, components xx yy zz xy yz zx with engineering shear, stresses
    second Piola-Kirchhoff's, both last in arrays of any shape; so a law is objective whatever it
    computes. It works on all points at once and changes no array that it is given: Newton asks
    again from the same state until a step has converged, and several threads ask at once. Moduli
    are symmetric. Asked again at the strain that a step ended with, from the state that it left, a
    law answers with the same stress: reactions are formed so.

    A law may tell more than stress by another method, ``results(strain, state)``: values (…) or
    (…,c) of the points by name, from the state that a step left. They are averaged at nodes as
    stress is (`gpusim.fem.Stress.results`) and get to files under their names. "energy" means what
    is stored per volume at rest; a law that doesn't tell it leaves the body's unknown.

    A strain that the law can't answer raises NotConverged, and the step is cut back. A law in
    logarithmic strain takes `LogarithmicStrain` for the way there and back, as `J2` does.

    Examples
    --------
    >>> isinstance(gs.Isotropic(210e9, 0.3), gs.fem.Law)
    True
    """

    @property
    def state_size(self) -> int:
        """Numbers of history at each point, zero at rest; 0: the law has no history."""

    @property
    def finite_strain(self) -> bool:
        """Whether it holds for any strain. Without, it is linear elasticity: elements turn its
        ``stiffness()`` and ask for nothing else."""

    def update(self, strain: Float, state: Float | None, *, moduli: bool) -> Update:
        """Stress, moduli if wanted and new state at a Green-Lagrange strain (…,6), from the state
        (…,n) at the end of the last step."""


def results_of(law: object, strain: Float, state: Float | None) -> dict[str, Float]:
    """What ``law`` tells of points by name; an energy of NaN if it tells none."""
    results: dict[str, Float] = {"energy": np.full(strain.shape[:-1], np.nan)}
    return results | law.results(strain, state) if hasattr(law, "results") else results
