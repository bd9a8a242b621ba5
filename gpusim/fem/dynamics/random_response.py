"""Random response: stationary vibration under a load, or on a base, known by its spectral density.

A linear result is a sum of modal coordinates times what it is in each mode, so that the covariance
of the coordinates, integrated once, gives the RMS of displacements and stresses everywhere.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Complex, Float
from gpusim.fem.dynamics.forced_vibration import checked_frequencies, forced_vibration
from gpusim.fem.dynamics.modal_basis import ModalBasis
from gpusim.fem.model.computation import Computation
from gpusim.fem.model.damping import DAMPINGS, Damping
from gpusim.fem.model.mass import MASS_RULES
from gpusim.fem.model.model import Model, resolve_formulation
from gpusim.fem.model.modes import Modes
from gpusim.fem.model.solution import Solution
from gpusim.fem.recovery.stress import stress
from gpusim.parallel.blas_threads import one_blas_thread
from gpusim.validation import Count, as_float64, checked, one_of, require

# stress components xx yy zz xy yz zx times that have the von Mises stress as their length
_MISES = np.zeros((6, 6))
_MISES[:3, :3] = np.array([[1, -1, 0], [0, 1, -1], [-1, 0, 1]]).T * np.sqrt(0.5)
_MISES[[3, 4, 5], [3, 4, 5]] = np.sqrt(3.0)
# points of Gauss on a panel, which is at most as long as it is away from any pole of the
# response: they leave 5e-14
_GAUSS = np.polynomial.legendre.leggauss(10)
# half widths of a resonance at which panels begin, on both sides of it
_DOUBLED = np.concatenate([[0.0], 2.0 ** np.arange(40)])
_CHUNK = 64


@dataclass(frozen=True, eq=False, repr=False)
class RandomResponse(Computation):
    """Stationary response with zero mean, in the model's units; displacements relative to the base.

    frequencies, excitation : (F,) Hz, and (F,) spectral density there of what drives, per Hz.
    coordinates, shapes : (F,m) complex, per unit of what drives, and (m,N,3): modes, and residual
        vectors.
    covariance : (m,m) of the coordinates, over the whole band.
    truncation : what modes that were left out may add at the upper end of the band, as in
        `gpusim.fem.HarmonicResponse`.
    message, warnings, unknowns, method, timings, model : as all results have them.

    Examples
    --------
    >>> bar = gs.mesh.box(size=(1, 0.1, 0.1), divisions=(8, 1, 1))
    >>> fixed = np.isclose(bar.points[:, :1], 0.0).repeat(3, axis=1)
    >>> model = gs.Model(bar, gs.Isotropic(210e9, 0.3, density=7850.0), fixed)
    >>> shaken = gs.random_response(model, ([10, 200], [1.0, 1.0]), base=(0, 1, 0),
    ...                             damping=gs.ModalDamping(0.02))
    >>> f"{1e3 * shaken.rms[-1, 1]:.2f} mm, {1e-6 * shaken.stress_rms[:, 0].max():.0f} MPa"
    '0.32 mm, 12 MPa'
    """

    frequencies: Float
    excitation: Float
    coordinates: Complex
    shapes: Float
    covariance: Float
    truncation: float
    formulation: Mapping[str, str]

    @cached_property
    def rms(self) -> Float:
        """(N,3) of displacements."""
        return self._rms(self.shapes[..., None])

    @property
    def psd(self) -> Float:
        """(F,N,3) of displacements, length^2/Hz."""
        return self._density(self.shapes)

    @cached_property
    def stress_rms(self) -> Float:
        """(N,6) of the components of stress, xx yy zz xy yz zx."""
        return self._rms(self.stress_shapes[..., None])

    @property
    def stress_psd(self) -> Float:
        """(F,N,6) of the components of stress, stress^2/Hz."""
        return self._density(self.stress_shapes)

    @cached_property
    def von_mises_rms(self) -> Float:
        """(N,) of the von Mises stress, whose square is quadratic in the components (Segalman et
        al., J. Vib. Acoust. 122 (2000) 42)."""
        return self._rms(self.stress_shapes @ _MISES)

    @cached_property
    def stress_shapes(self) -> Float:
        """(m,N,6) stress of the shapes; where materials meet, of that with the greatest von Mises
        RMS."""
        found = [stress(self.model, u, self.formulation, temperature=0.0) for u in self.shapes]
        values, node_of = np.stack([one.values for one in found]), found[0].node_of
        result = np.zeros((len(values), self.model.mesh.node_count, 6))
        order = np.argsort(self._rms(values @ _MISES), kind="stable")
        # the last one written is the greatest
        result[:, node_of[order]] = values[:, order]
        return result

    def _rms(self, modal: Float) -> Float:
        """(...) of vectors (m,...,k): of their lengths."""
        spread = np.tensordot(self.covariance, modal, axes=1)
        return np.asarray(np.sqrt(np.maximum((spread * modal).sum(axis=(0, -1)), 0.0)))

    def _density(self, modal: Float) -> Float:
        """(F,...) of modal results (m,...)."""
        response = np.abs(np.tensordot(self.coordinates, modal, axes=1)) ** 2
        return np.asarray(self.excitation[:, None, None] * response)


@checked
def random_response(
    model: Model,
    psd: npt.ArrayLike,
    *,
    damping: Damping,
    frequencies: npt.ArrayLike | None = None,
    loads: npt.ArrayLike | None = None,
    base: npt.ArrayLike | None = None,
    count: Count = 20,
    modes: Modes | None = None,
    formulation: str | Mapping[str, str] | None = None,
    mass: Annotated[str, one_of(*MASS_RULES)] = "exact",
    prestress: Solution | None = None,
) -> RandomResponse:
    """Stationary random vibration of a linear model under one load, by modal superposition.

    Parameters
    ----------
    model : as for `gpusim.harmonic`.
    psd : (frequencies, values), two rows (R,): one-sided spectral density of the loads' factor in
        1/Hz, or of the base's; straight in between on scales of logarithms, zero
        beyond.
    damping : as for `gpusim.harmonic`, of every mode.
    frequencies : (F,) Hz at which spectral densities of results are given; None: those of ``psd``.
    loads, base : the amplitudes that the factor multiplies, as for `gpusim.harmonic`: weights (L,)
        of the load cases, which vary together, and an acceleration (3,).
    count, modes, formulation, mass, prestress : as for `gpusim.harmonic`.

    RMS are integrals over the band, by Gauss' rule on panels graded towards each resonance: exact
    to about 1e-12. Raises InputError and NotConverged as `gpusim.harmonic` does.

    Examples
    --------
    >>> bar = gs.mesh.box(size=(1, 0.1, 0.1), divisions=(8, 1, 1))
    >>> fixed = np.isclose(bar.points[:, :1], 0.0).repeat(3, axis=1)
    >>> model = gs.Model(bar, gs.Isotropic(210e9, 0.3, density=7850.0), fixed)
    >>> shaker = ([20, 80, 350, 2000], [0.96, 3.85, 3.85, 0.67])  # (m/s^2)^2/Hz
    >>> shaken = gs.random_response(model, shaker, base=(0, 1, 0), damping=gs.ModalDamping(0.02))
    >>> f"{1e6 * shaken.rms[-1, 1]:.0f} um, {1e-6 * shaken.von_mises_rms.max():.1f} MPa"
    '627 um, 19.6 MPa'
    """
    require(isinstance(damping, Damping), "random response: damping", repr(damping), DAMPINGS)
    expected = "(frequencies, values): two rows of at least 2 numbers > 0, frequencies increasing"
    density = as_float64(psd, "random response: psd", expected)
    fits = density.ndim == 2 and len(density) == 2 and density.shape[1] > 1
    good = (
        fits and ((0.0 < density) & (density < np.inf)).all() and (np.diff(density[0]) > 0.0).all()
    )
    require(bool(good), "random response: psd", repr(psd), expected)
    given = density[0] if frequencies is None else checked_frequencies(frequencies)
    highest = density[0, -1:]
    with one_blas_thread():
        basis = forced_vibration(
            model, loads, base, float(highest[0]), count=count, modes=modes,
            formulation=formulation, mass=mass, prestress=prestress,
        )  # fmt: skip
        truncation = basis.truncation(2.0 * np.pi * highest, "random response: psd")
        covariance = _covariance(basis, damping, density)
        coordinates = basis.coordinates(2.0 * np.pi * given, [damping])
    return RandomResponse(
        given, _interpolated(density, given), coordinates, basis.shapes, covariance,
        float(truncation[0]), resolve_formulation(model, formulation), **basis.computation,
    )  # fmt: skip


def _covariance(basis: ModalBasis, damping: Damping, density: Float) -> Float:
    """(m,m) of the coordinates of a basis."""
    borders = _panels(basis.angular, damping, density[0])
    middle, half = 0.5 * (borders[1:] + borders[:-1]), 0.5 * np.diff(borders)
    points, weights = _GAUSS
    result = np.zeros((len(basis.angular),) * 2)
    for first in range(0, len(half), _CHUNK):
        part = slice(first, first + _CHUNK)
        frequencies = (middle[part, None] + half[part, None] * points).ravel()
        weight = (half[part, None] * weights).ravel() * _interpolated(density, frequencies)
        coordinates = basis.coordinates(2.0 * np.pi * frequencies, [damping])
        result += (coordinates.conj().T @ (weight[:, None] * coordinates)).real
    return result


def _interpolated(density: Float, frequencies: Float) -> Float:
    """(m,) of a spectral density (2,R) at some frequencies (m,), Hz."""
    at, (place, value) = np.log(np.maximum(frequencies, 1e-300)), np.log(density)
    return np.asarray(np.exp(np.interp(at, place, value, left=-np.inf, right=-np.inf)))


def _panels(angular: Float, damping: Damping, frequencies: Float) -> Float:
    """Ascending borders, Hz: the ``frequencies`` of a density, octaves, and around each mode, of
    ``angular`` (m,), at doubled multiples of its half width."""
    lost = np.diagonal(damping.dissipation(angular, angular))[angular > 0.0]
    elastic = angular[angular > 0.0]
    got = f"{damping!r}, which leaves mode {np.argmin(lost) + 1} undamped"
    require(bool((lost > 0.0).all()), "random response: damping", got, "damping of every mode")
    offset = (0.5 * lost / elastic)[:, None] * _DOUBLED
    around = np.concatenate([elastic[:, None] + offset, elastic[:, None] - offset]) / (2.0 * np.pi)
    low, high = frequencies[0], frequencies[-1]
    octaves = low * 2.0 ** np.arange(np.ceil(np.log2(high / low)))
    borders = np.unique(np.concatenate([frequencies, octaves, around.ravel()]))
    return np.asarray(borders[(borders >= low) & (borders <= high)])
