"""Forced vibration: the modal basis of a model, perhaps about a stressed state, and of the one load
that drives it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from gpusim.arrays.array_types import Complex, Float
from gpusim.fem.dynamics.modal_basis import ModalBasis, check_modes
from gpusim.fem.eigenvalues.modes import check_count, equation_about
from gpusim.fem.eigenvalues.modes import modes as modes_of
from gpusim.fem.linear.solve_plan import Clock, Options
from gpusim.fem.model.dead_loads import with_dead_loads
from gpusim.fem.model.mass import inertia_forces
from gpusim.fem.model.model import Model, resolve_formulation
from gpusim.fem.model.modes import Modes
from gpusim.fem.model.solution import Solution
from gpusim.fem.model.supports import check_still
from gpusim.validation import as_float64, require


def forced_vibration(
    model: Model,
    loads: Any,
    base: Any,
    highest: float,
    *,
    count: int,
    formulation: str | Mapping[str, str] | None,
    mass: str,
    prestress: Solution | None,
    modes: Modes | None,
) -> ModalBasis:
    """Of load cases by ``loads`` (L,), None for all of them where the base rests, and of inertia
    where it accelerates by ``base`` (3,), at frequencies up to the ``highest``, Hz; see
    `gpusim.harmonic`."""
    check_still(model, "harmonic")
    require(isinstance(modes, Modes | None), "harmonic: modes", repr(modes), "Modes, or None")
    if modes is None:
        check_count(model, count, "harmonic")
    else:
        check_superposable(modes, model, highest)
    names = resolve_formulation(model, formulation)
    cases, heat = with_dead_loads(model, names).load_cases, model.temperature
    given = [float(base is None)] * len(cases) if loads is None else loads
    weights = complex_numbers(given, "harmonic: loads", len(cases))
    heated = heat is not None and bool(heat[weights != 0.0].any())
    require(not heated, "harmonic: loads", "a case with a change of temperature", "forces")
    if base is not None:
        weights = np.append(weights, complex_numbers(base, "harmonic: base", 3))
        cases = np.concatenate([cases, inertia_forces(model, names, mass)])
    equation = equation_about(prestress, model, names, mass, "harmonic")
    load = weights @ equation.forces(cases)
    require(bool(load.any()), "harmonic: loads", "none", "forces, or a base that accelerates")
    if modes is None:
        modes = modes_of(model, count, formulation=formulation, mass=mass, prestress=prestress)
    options = Options("auto", None, "numpy", 1e-8, None, None, None, names, Clock())
    return ModalBasis.of(equation, modes, load[None], options)


def check_superposable(modes: Modes, model: Model, highest: float) -> None:
    """Raises InputError for known ``modes`` that aren't a basis for vibrations of a model up to the
    ``highest`` frequency, Hz; NotConverged for those that were given up."""
    check_modes(modes)
    fits = modes.shapes.shape[1:] == model.mesh.points.shape
    require(fits, "modes", "those of another mesh", "those of the model")
    got, expected = f"{modes.below} lower ones left out", "all from the lowest one on"
    require(modes.below == 0, "modes", got, expected)
    last, whole = float(modes.frequencies[-1]), len(modes.frequencies) == modes.unknowns
    got, expected = f"up to {highest:.6g} Hz", f"less than {last:.6g} Hz, the last of the modes"
    require(whole or highest < last, "harmonic: frequencies", got, expected)


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
