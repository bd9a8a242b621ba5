"""Harmonic response: steady vibration under loads, or on a base, that vary as exp(i omega t)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

import numpy as np
import numpy.typing as npt

from gpusim.fem.dynamics.forced_vibration import (
    checked_frequencies,
    complex_numbers,
    forced_vibration,
)
from gpusim.fem.model.damping import DAMPINGS, Damping
from gpusim.fem.model.harmonic_response import HarmonicResponse
from gpusim.fem.model.mass import MASS_RULES
from gpusim.fem.model.model import Model
from gpusim.fem.model.modes import Modes
from gpusim.fem.model.solution import Solution
from gpusim.parallel.blas_threads import one_blas_thread
from gpusim.validation import Count, checked, one_of, require


@checked
def harmonic(
    model: Model,
    frequencies: npt.ArrayLike,
    *,
    damping: Damping | None = None,
    loads: npt.ArrayLike | None = None,
    base: npt.ArrayLike | None = None,
    count: Count = 20,
    modes: Modes | None = None,
    formulation: str | Mapping[str, str] | None = None,
    mass: Annotated[str, one_of(*MASS_RULES)] = "exact",
    prestress: Solution | None = None,
) -> HarmonicResponse:
    """Steady vibration u(t) = Re(u exp(i 2 pi f t)) of a linear model under harmonic loads, by
    superposition of modes and of residual vectors, which are what the static response has beyond
    the modes; ``truncation`` says what modes left out may still add.

    Parameters
    ----------
    model : its load cases are amplitudes of forces; its supports hold still, or move with the base.
    frequencies : (F,) Hz, from 0 up.
    damping : `gpusim.Rayleigh`, `gpusim.ModalDamping` or `gpusim.StructuralDamping`; None: none.
    loads : (L,) complex weights of the load cases; None: 1 for each, or 0 with a ``base``.
    base : (3,) complex amplitude of the acceleration with which all supports move.
    count : how many modes. modes : those of this model, from the lowest one on, if they are known.
    formulation, mass, prestress : as for `gpusim.modes`.

    Raises
    ------
    InputError
        A wrong argument, or no load at all; a frequency beyond the last mode, or at a resonance
        that nothing damps.
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
    given, known = checked_frequencies(frequencies), damping is None or isinstance(damping, Damping)
    require(known, "harmonic: damping", repr(damping), DAMPINGS)
    acceleration = None if base is None else complex_numbers(base, "harmonic: base", 3)
    angular = 2.0 * np.pi * given
    with one_blas_thread():
        basis = forced_vibration(
            model, loads, acceleration, float(given.max()), count=count, modes=modes,
            formulation=formulation, mass=mass, prestress=prestress,
        )  # fmt: skip
        truncation = basis.truncation(angular, "harmonic: frequencies")
        coordinates = basis.coordinates(angular, () if damping is None else (damping,))
    return HarmonicResponse(
        given, coordinates, basis.shapes, truncation, acceleration, **basis.computation
    )
