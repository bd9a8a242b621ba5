"""Harmonic responses: complex amplitudes of displacements, frequency by frequency."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from gpusim.arrays.array_types import Complex, Float
from gpusim.fem.model.computation import Computation
from gpusim.validation import Finite, checked, require


@dataclass(frozen=True, eq=False, repr=False)
class HarmonicResponse(Computation):
    """Steady vibration u(t) = Re(u exp(i 2 pi f t)) at each of ``frequencies`` (F,) Hz, in the
    model's units.

    coordinates, shapes : (F,m) complex and (m,N,3), of modes and others: u is their product.
    truncation : (F,) what modes that were left out may add, in the energy norm over that of the
        static response.
    base : (3,) complex amplitude of the base's acceleration, None where it rests. ``u`` is relative
        to the base; `absolute` has its motion in it.
    message, warnings, unknowns, method, timings, model : as all results have them.

    Examples
    --------
    >>> bar = gs.mesh.box(size=(1, 0.1, 0.1), divisions=(4, 1, 1))
    >>> fixed = np.isclose(bar.points[:, :1], 0.0).repeat(3, axis=1)
    >>> pull = gs.fem.traction(bar, gs.mesh.select_faces(bar, name="x_max"), (1e6, 0, 0))
    >>> steel = gs.Isotropic(210e9, 0.0, density=7850.0)
    >>> model = gs.Model(bar, steel, fixed, pull)
    >>> damping = gs.Rayleigh(stiffness=1e-5)
    >>> r = gs.harmonic(model, [0.0, 1300.0], damping=damping)
    >>> f"{1e6 * r.at(0)[-1, 0]:.3f} um, {np.degrees(r.phase[1, -1, 0]):.0f} degrees"
    '4.762 um, -87 degrees'
    """

    frequencies: Float
    coordinates: Complex
    shapes: Float
    truncation: Float
    base: Complex | None = None

    @cached_property
    def u(self) -> Complex:
        """(F,N,3) complex amplitudes; formed when first asked for."""
        return np.asarray(np.tensordot(self.coordinates, self.shapes, axes=1))

    @cached_property
    def amplitude(self) -> Float:
        """(F,N,3) magnitudes of ``u``."""
        return np.abs(self.u)

    @cached_property
    def phase(self) -> Float:
        """(F,N,3) by how much ``u`` leads the cosine, rad, from -pi to pi."""
        return np.angle(self.u)

    @checked
    def at(self, k: int, phase: Finite = 0.0) -> Float:
        """(N,3) displacements Re(u exp(i phase)) at frequency number ``k``; ``phase`` is 2 pi f t,
        rad."""
        count = len(self.frequencies)
        require(-count <= k < count, "harmonic response: frequency number", k, f"0 … {count - 1}")
        coordinates = np.exp(1j * phase) * self.coordinates[k]
        return np.ascontiguousarray(np.tensordot(coordinates, self.shapes, axes=1).real)

    def velocity(self, k: int, phase: Finite = 0.0) -> Float:
        """(N,3) velocities at the same instant: a quarter of a turn ahead."""
        ahead = self.at(k, phase + 0.5 * np.pi)
        return 2.0 * np.pi * float(self.frequencies[k]) * ahead

    def absolute(self) -> HarmonicResponse:
        """The same with the motion of the base in it, as a camera at rest sees it.

        Raises InputError at 0 Hz, where a base that accelerates goes away.
        """
        if self.base is None:
            return self
        still = bool((self.frequencies > 0.0).all())
        require(still, "absolute harmonic response: frequencies", "0 Hz", "above 0 Hz")
        rigid = np.zeros((3, *self.shapes.shape[1:]))
        rigid[[0, 1, 2], :, [0, 1, 2]] = 1.0
        moved = -self.base / (2.0 * np.pi * self.frequencies[:, None]) ** 2
        coordinates = np.concatenate([self.coordinates, moved], axis=1)
        shapes = np.concatenate([self.shapes, rigid])
        return replace(self, coordinates=coordinates, shapes=shapes, base=None)
