"""What vibration is judged by: all modes of small models by dense algebra, and closed forms of what
each mode does in time and frequency."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.linalg import eigh, null_space
from scipy.sparse import csc_matrix, csr_matrix, eye, vstack

from gpusim.fem import Model, mass_matrix
from tests.support.fem_reference import stiffness

Float = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]
Formulation = str | Mapping[str, str] | None


@dataclass(frozen=True, eq=False)
class DenseModes:
    """All of a model, ``angular`` (n,) rad/s and mass-normalised ``shapes`` (n,N,3)."""

    angular: Float
    shapes: Float

    @property
    def frequencies(self) -> Float:
        """(n,) Hz."""
        return self.angular / (2.0 * np.pi)

    def forces(self, forces: Float) -> Float:
        """(n,) of nodal forces (N,3)."""
        return np.tensordot(self.shapes, forces, axes=2)

    def harmonic(self, forces: Float, frequencies: Float, ratio: float) -> Complex:
        """(F,N,3) amplitudes under forces (N,3) at ``frequencies`` (F,) Hz."""
        omega = 2.0 * np.pi * np.asarray(frequencies)[:, None]
        rest = self.angular**2 - omega**2 + 2j * ratio * self.angular * omega
        return np.tensordot(self.forces(forces) / rest, self.shapes, axes=1)

    def step_response(self, forces: Float, times: Float, ratio: Float) -> Float:
        """(T,N,3) after forces (N,3) that act from 0 on, of damping ratios (n,) below 1."""
        at = np.asarray(times)[:, None]
        damped = self.angular * np.sqrt(1.0 - ratio**2)
        decay = np.exp(-ratio * self.angular * at)
        turned = np.cos(damped * at) + ratio * self.angular / damped * np.sin(damped * at)
        static = self.forces(forces) / self.angular**2
        return np.tensordot(static * (1.0 - decay * turned), self.shapes, axes=1)


def free_motions(model: Model) -> csr_matrix:
    """(3N,n): what supports and constraints leave, as columns."""
    count = 3 * model.mesh.node_count
    held = np.zeros(count, dtype=bool) if model.fixed is None else model.fixed.ravel()
    free = np.flatnonzero(~held)
    if not model.constraints:
        return csr_matrix(eye(count, format="csr")[:, free])
    equations = vstack([one.matrix for one in model.constraints]).tocsc()[:, free]
    tied = np.flatnonzero(np.diff(equations.indptr))
    loose = np.flatnonzero(np.diff(equations.indptr) == 0)
    whole = eye(count, format="csr")
    moving = csr_matrix(null_space(equations[:, tied].toarray()))
    return csr_matrix(
        csc_matrix(whole[:, free[loose]]) if not len(tied) else
        _beside(whole[:, free[loose]], whole[:, free[tied]] @ moving)
    )  # fmt: skip


def _beside(left: csr_matrix, right: csr_matrix) -> csr_matrix:
    return csr_matrix(vstack([left.T, right.T]).T)


def reduced_matrices(
    model: Model, formulation: Formulation = None, rule: str = "exact"
) -> tuple[csr_matrix, csc_matrix, csc_matrix]:
    """(3N,n) the motions that are left, (n,n) stiffness and mass on them."""
    motions = free_motions(model)
    mass = mass_matrix(model, rule, formulation)
    parts = (csc_matrix(motions.T @ one @ motions) for one in (stiffness(model, formulation), mass))
    return motions, *parts


def dense_modes(model: Model, formulation: Formulation = None, rule: str = "exact") -> DenseModes:
    """Of some thousand unknowns at most."""
    motions, stiff, mass = reduced_matrices(model, formulation, rule)
    values, vectors = eigh(stiff.toarray(), mass.toarray())
    shapes = (motions @ vectors).T.reshape(len(values), -1, 3)
    return DenseModes(np.sqrt(np.maximum(values, 0.0)), shapes)


def span_errors(found: Float, wanted: Float, mass: csr_matrix, groups: list[slice]) -> Float:
    """(g,) sines of the greatest angle between the spans of ``groups`` of shapes (n,N,3) of
    ``found`` and ``wanted``, each mass-normalised; of a single mode the root of 1 - MAC."""
    ours, theirs = (one.reshape(len(one), -1) for one in (found, wanted))
    errors = []
    for group in groups:
        basis = theirs[group]
        rest = ours[group] - (ours[group] @ (mass @ basis.T)) @ basis
        errors.append(np.sqrt(np.linalg.norm(rest @ (mass @ rest.T), 2)))
    return np.array(errors)


def clusters(frequencies: Float, apart: float = 1e-4) -> list[slice]:
    """Runs of modes whose neighbours are closer than ``apart``, relative."""
    size = np.maximum(np.abs(frequencies[1:]), 1e-300)
    cuts = np.flatnonzero(np.diff(frequencies) > apart * size) + 1
    ends = [0, *cuts.tolist(), len(frequencies)]
    return [slice(first, last) for first, last in zip(ends, ends[1:], strict=False)]
