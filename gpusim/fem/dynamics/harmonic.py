"""Harmonic response: steady vibration under loads, or on a base, that vary as exp(i omega t).

By modal superposition each mode answers by itself; directly, the complex matrix
K (1 + i g) + i omega C - omega^2 M is factorised at each frequency.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt
from scipy.sparse import csc_matrix, csr_matrix
from scipy.sparse.linalg import splu

from gpusim.arrays.array_types import Complex, Float
from gpusim.fem.assembly.equation_of_motion import EquationOfMotion
from gpusim.fem.dynamics.forced_vibration import (
    ForcedVibration,
    checked_frequencies,
    complex_numbers,
)
from gpusim.fem.dynamics.modal_basis import RESOLVED
from gpusim.fem.model.damping import DAMPINGS, Damping, Rayleigh, StructuralDamping
from gpusim.fem.model.harmonic_response import HarmonicResponse
from gpusim.fem.model.model import Model
from gpusim.fem.model.modes import Modes
from gpusim.fem.model.solution import Solution
from gpusim.fem.model.supports import check_supports
from gpusim.parallel.blas_threads import one_blas_thread
from gpusim.validation import Count, checked, one_of, require

# a complex factor of a solid of so many unknowns takes about 1 GB, and 10 s at each frequency
_MOST_DIRECT = 20_000


@checked
def harmonic(
    model: Model,
    frequencies: npt.ArrayLike,
    *,
    damping: Damping | None = None,
    method: Annotated[str, one_of("modal", "direct")] = "modal",
    count: Count = 20,
    loads: npt.ArrayLike | None = None,
    base: npt.ArrayLike | None = None,
    formulation: str | Mapping[str, str] | None = None,
    mass: str = "exact",
    prestress: Solution | None = None,
    modes: Modes | None = None,
) -> HarmonicResponse:
    """Steady vibration u(t) = Re(u exp(i 2 pi f t)) of a linear model under harmonic loads.

    Parameters
    ----------
    model : its load cases are amplitudes of forces; its supports hold still, or move with the base.
    frequencies : (F,) Hz, from 0 up.
    damping : `gpusim.Rayleigh`, `gpusim.ModalDamping` (by modes alone) or
        `gpusim.StructuralDamping`; None: none.
    method : "modal": by superposition of modes and of residual vectors, which are what the static
        response has beyond the modes; ``truncation`` says what modes left out may still add.
        "direct": one complex factorisation at each frequency, up to 20,000 unknowns.
    count : how many modes.
    loads : (L,) complex weights of the load cases; None: 1 for each, or 0 with a ``base``.
    base : (3,) complex amplitude of the acceleration with which all supports move.
    formulation, mass, prestress : as for `gpusim.modes`.
    modes : of this model, if they are known; in place of ``count``.

    Raises
    ------
    InputError
        A wrong argument, or no load at all; a frequency beyond the last mode, or at a resonance
        that nothing damps; a model too large for the direct method.
    NotConverged
        Modes, or a static response, that can't be found.

    Examples
    --------
    >>> bar = gs.mesh.box(size=(1, 0.1, 0.1), divisions=(8, 1, 1))
    >>> fixed = np.isclose(bar.points[:, :1], 0.0).repeat(3, axis=1)
    >>> model = gs.Model(bar, gs.Isotropic(210e9, 0.3, density=7850.0), fixed)
    >>> shaken = gs.harmonic(model, [5.0, 82.0], base=(0, 1, 0), damping=gs.ModalDamping(0.02))
    >>> tip = shaken.absolute().amplitude[:, -1, 1] * (2 * np.pi * shaken.frequencies) ** 2
    >>> tip.round(1).tolist()  # over the acceleration of the base
    [1.0, 26.4]
    """
    acceleration = None if base is None else complex_numbers(base, "harmonic: base", 3)
    require(modes is None or method == "modal", "harmonic: modes", "method 'direct'", "'modal'")
    with one_blas_thread():
        vibration = ForcedVibration(model, count, formulation, mass, prestress, modes)
        load = vibration.load(loads, acceleration)
        response = steady_response(vibration, load, frequencies, damping, method)
    return replace(response, base=acceleration)


def steady_response(
    vibration: ForcedVibration, load: Complex, frequencies: Any, damping: Any, method: str
) -> HarmonicResponse:
    """Under a ``load`` (3N,) on the unknowns of a vibration's equation; see `harmonic`."""
    given, model = checked_frequencies(frequencies), vibration.model
    known = damping is None or isinstance(damping, Damping)
    require(known, "harmonic: damping", repr(damping), DAMPINGS)
    angular = 2.0 * np.pi * given
    if method == "modal":
        basis = vibration.basis(load)
        truncation, coordinates = basis.truncation(angular), basis.coordinates(angular, damping)
        return HarmonicResponse(given, coordinates, basis.shapes, truncation, model)
    if not angular.all():
        check_supports(model)
    u = _direct(vibration.equation, angular, load, damping)
    each = np.eye(len(given), dtype=np.complex128)
    return HarmonicResponse(given, each, u, np.zeros(len(given)), model)


def _direct(
    equation: EquationOfMotion, angular: Float, load: Complex, damping: Damping | None
) -> Complex:
    """u (F,N,3) at ``angular`` (F,) rad/s."""
    unknowns = int(equation.unknown.sum())
    got, expected = f"{unknowns} unknowns", f"at most {_MOST_DIRECT} (method 'modal' takes more)"
    require(unknowns <= _MOST_DIRECT, "harmonic: method 'direct'", got, expected)
    expected = "Rayleigh or StructuralDamping, or method 'modal'"
    proportional = damping is None or isinstance(damping, Rayleigh | StructuralDamping)
    require(proportional, "harmonic: method 'direct': damping", repr(damping), expected)
    stiffness, mass = equation.matrices
    x = np.zeros((len(angular), len(load)), dtype=np.complex128)
    for one, omega in zip(x, angular, strict=True):
        of_mass = of_stiffness = 0.0
        if isinstance(damping, Rayleigh):
            of_mass, of_stiffness = omega * damping.mass, omega * damping.stiffness
        elif isinstance(damping, StructuralDamping):
            of_stiffness = damping.loss_factor
        dynamic = (1.0 + 1j * of_stiffness) * stiffness + (1j * of_mass - omega**2) * mass
        one[equation.unknown] = _solved(dynamic.tocsc(), mass, load[equation.unknown], omega)
    return equation.displacements(x.real) + 1j * equation.displacements(x.imag)


def _solved(dynamic: csc_matrix, mass: csr_matrix, load: Complex, omega: float) -> Complex:
    """x (n,) of ``dynamic`` x = ``load``. Raises InputError at a resonance that nothing damps."""
    x, distance = load, 0.0
    # what is exactly singular is a RuntimeError
    with suppress(RuntimeError):
        factor = splu(dynamic, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.01,
                      options={"SymmetricMode": True})  # fmt: skip
        x = factor.solve(load)
        x += factor.solve(load - dynamic @ x)
        # one inverse iteration more: how far off the nearest resonance is, in squared frequencies
        again = factor.solve(mass @ x)
        distance = np.sqrt(np.vdot(x, mass @ x).real / np.vdot(again, mass @ again).real)
    got = f"a resonance at {omega / (2.0 * np.pi):.9g} Hz that nothing damps"
    resolved = bool(distance > RESOLVED * omega**2)
    require(resolved, "harmonic: frequencies", got, "damping, or other frequencies")
    return x
