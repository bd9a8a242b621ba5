"""Forced vibration: a model as it is discretised, and the one load that drives it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any

import numpy as np

from gpusim.arrays.array_types import Complex, Float
from gpusim.errors import NotConverged
from gpusim.fem.assembly.equation_of_motion import EquationOfMotion
from gpusim.fem.dynamics.modal_basis import ModalBasis
from gpusim.fem.eigenvalues.modes import modes as modes_of
from gpusim.fem.linear.solve_plan import Clock, Options
from gpusim.fem.model.dead_loads import with_dead_loads
from gpusim.fem.model.mass import MASS_RULES
from gpusim.fem.model.model import Model, resolve_formulation
from gpusim.fem.model.modes import Modes
from gpusim.fem.model.solution import Solution
from gpusim.validation import Count, as_float64, checked, one_of, require


@checked
@dataclass(frozen=True, eq=False)
class ForcedVibration:
    """Of a ``model``, perhaps about a stressed state; by ``count`` modes, or by ``modes`` that are
    known. See `gpusim.harmonic`."""

    model: Model
    count: Count = 20
    formulation: str | Mapping[str, str] | None = None
    mass: Annotated[str, one_of(*MASS_RULES)] = "exact"
    prestress: Solution | None = None
    modes: Modes | None = None

    def __post_init__(self) -> None:
        got = type(self.model).__name__
        require(isinstance(self.model, Model), "harmonic: model", got, "a Model")
        known = isinstance(self.modes, Modes | None)
        require(known, "harmonic: modes", repr(self.modes), "Modes, or None")
        known = isinstance(self.prestress, Solution | None)
        require(known, "harmonic: prestress", repr(self.prestress), "a Solution, or None")
        given = [self.model.prescribed_cases, *(one.right for one in self.model.constraints)]
        still, expected = not any(one.any() for one in given), "none (the base may shake)"
        require(still, "harmonic: model", "displacements that are given", expected)

    @cached_property
    def names(self) -> dict[str, str]:
        """Formulation per cell type."""
        return resolve_formulation(self.model, self.formulation)

    @cached_property
    def equation(self) -> EquationOfMotion:
        if self.prestress is not None:
            return EquationOfMotion.at(self.prestress, self.names, self.mass)
        return EquationOfMotion.of(self.model, self.names, self.mass)

    def load(self, weights: Any, base: Complex | None) -> Complex:
        """(3N,) on the equation's unknowns: load cases by ``weights`` (L,), None for all of them
        where the base rests, and inertia where it accelerates by ``base`` (3,)."""
        cases, heat = with_dead_loads(self.model, self.names).load_cases, self.model.temperature
        if weights is None:
            weights = np.full(len(cases), 1.0 if base is None else 0.0)
        weights = complex_numbers(weights, "harmonic: loads", len(cases))
        heated = heat is not None and bool(heat[weights != 0.0].any())
        require(not heated, "harmonic: loads", "a case with a change of temperature", "forces")
        load = np.asarray(weights @ self.equation.forces(cases))
        if base is not None:
            along = np.broadcast_to(np.eye(3)[:, None], (3, *cases.shape[1:]))
            load = load - base @ self.equation.inertia_forces(along)
        require(bool(load.any()), "harmonic: loads", "none", "forces, or a base that accelerates")
        return load

    def basis(self, load: Complex) -> ModalBasis:
        """Modes, and what the static response to a ``load`` (3N,) has beyond them."""
        modes = self.modes
        if modes is None:
            modes = modes_of(self.model, self.count, formulation=self.formulation, mass=self.mass,
                             prestress=self.prestress)  # fmt: skip
        if not modes.converged:
            raise NotConverged(f"harmonic: modes; got {modes.message}; expected converged ones")
        options = Options("auto", None, "numpy", 1e-8, None, None, None, self.names, Clock())
        return ModalBasis.of(self.equation, modes, load, options)


def complex_numbers(value: Any, what: str, count: int) -> Complex:
    """(count,) finite numbers. Raises InputError naming ``what``."""
    expected = f"({count},) finite numbers, real or complex"
    try:
        array = np.asarray(value)
    except ValueError:  # rows of several lengths
        array = np.asarray(None)
    fits = array.dtype.kind in "iufc" and array.shape == (count,) and np.isfinite(array).all()
    require(bool(fits), what, repr(value), expected)
    return array.astype(np.complex128)


def checked_frequencies(value: Any) -> Float:
    """(F,) Hz, from 0 up. Raises InputError for anything else."""
    expected = "(F,) finite numbers >= 0, at least one"
    array = as_float64(value, "harmonic: frequencies", expected)
    fits = array.ndim == 1 and array.size and np.isfinite(array).all() and (array >= 0.0).all()
    require(bool(fits), "harmonic: frequencies", repr(value), expected)
    return array
