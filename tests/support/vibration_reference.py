"""What vibration is judged by: all modes of small models by dense algebra, and closed forms of what
each mode does in time and frequency."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from scipy.linalg import eigh, null_space
from scipy.sparse import coo_matrix, csc_matrix, csr_matrix, eye, hstack, kron, vstack
from scipy.sparse.linalg import spsolve

from gpusim.fem import Model, mass_matrix
from gpusim.mesh.quadrature import FULL_POINTS, cell_rule
from gpusim.mesh.shape_functions import shape_gradients
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

    def harmonic(self, forces: Float, frequencies: Float, ratio: float | Float) -> Complex:
        """(F,N,3) amplitudes under forces (N,3) at ``frequencies`` (F,) Hz; damping ``ratio`` of
        all, or (n,)."""
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

    def lowest(self, count: int) -> DenseModes:
        """The first ones."""
        return DenseModes(self.angular[:count], self.shapes[:count])

    def newmark(self, forces: Float, step: float, count: int, ratio: Float) -> Float:
        """(count + 1,N,3) of the trapezoidal rule from rest, mode by mode."""
        load, stiff, drag = self.forces(forces), self.angular**2, 2.0 * ratio * self.angular
        u = v = np.zeros_like(load)
        a, history = load, [u]
        whole = 1.0 + 0.5 * step * drag + 0.25 * step**2 * stiff
        for _ in range(count):
            ahead_u, ahead_v = u + step * v + 0.25 * step**2 * a, v + 0.5 * step * a
            a = (load - drag * ahead_v - stiff * ahead_u) / whole
            u, v = ahead_u + 0.25 * step**2 * a, ahead_v + 0.5 * step * a
            history.append(u)
        return np.tensordot(np.array(history), self.shapes, axes=1)


def free_motions(model: Model) -> csr_matrix:
    """(3N,n): what supports and constraints leave, as columns."""
    count = 3 * model.mesh.node_count
    held = np.zeros(count, dtype=bool) if model.fixed is None else model.fixed.ravel()
    free = np.flatnonzero(~held)
    if not model.constraints:
        return csr_matrix(eye(count, format="csr")[:, free])
    equations = vstack([one.matrix for one in model.constraints]).tocsc()[:, free]
    held = np.diff(equations.indptr) > 0
    columns = eye(count, format="csc")[:, free]
    moving = csc_matrix(null_space(equations[:, np.flatnonzero(held)].toarray()))
    loose, tied = columns[:, np.flatnonzero(~held)], columns[:, np.flatnonzero(held)]
    return csr_matrix(hstack([loose, tied @ moving]))


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


def dense_buckling(model: Model) -> Float:
    """(n,) factors of the load, by their size, at which stiffness is lost; of fully integrated
    elements of one material."""
    motions = free_motions(model)
    stiff = csc_matrix(motions.T @ stiffness(model) @ motions)
    u = motions @ spsolve(stiff, motions.T @ model.load_cases[0].ravel())
    stressed = (motions.T @ _geometric_stiffness(model, u.reshape(-1, 3)) @ motions).toarray()
    inverse = eigh(-stressed, stiff.toarray(), eigvals_only=True)
    inverse = inverse[np.argsort(-np.abs(inverse))]
    return 1.0 / inverse[np.abs(inverse) > 1e-12 * np.abs(inverse[0])]


def _geometric_stiffness(model: Model, u: Float) -> csr_matrix:
    """(3N,3N) of the stress that displacements ``u`` (N,3) make: the integral of its product with
    two gradients of displacement."""
    ((kind, _, cells),) = model.mesh.blocks()
    (material,) = model.materials
    points, weights = cell_rule(kind, FULL_POINTS[kind])
    shear = np.array([[0, 1], [1, 2], [2, 0]])
    total = np.zeros((len(cells), cells.shape[1], cells.shape[1]))
    for gradient, weight in zip(shape_gradients(kind, points), weights, strict=True):
        jacobian = np.einsum("ckx,kr->cxr", model.mesh.points[cells], gradient)
        slopes = gradient @ np.linalg.inv(jacobian)
        strain = np.einsum("ckx,cky->cxy", u[cells], slopes)
        diagonal = np.diagonal(strain, axis1=1, axis2=2)
        sheared = strain[:, shear[:, 0], shear[:, 1]] + strain[:, shear[:, 1], shear[:, 0]]
        voigt = np.concatenate([diagonal, sheared], axis=1) @ material.stiffness()
        stress = np.zeros_like(strain)
        stress[:, range(3), range(3)] = voigt[:, :3]
        for k, (i, j) in enumerate(shear):
            stress[:, i, j] = stress[:, j, i] = voigt[:, 3 + k]
        volume = weight * np.linalg.det(jacobian)
        total += volume[:, None, None] * (slopes @ stress @ slopes.transpose(0, 2, 1))
    rows = np.repeat(cells, cells.shape[1], axis=1).ravel()
    columns = np.tile(cells, (1, cells.shape[1])).ravel()
    shape = (model.mesh.node_count,) * 2
    scalar = coo_matrix((total.ravel(), (rows, columns)), shape=shape)
    return csr_matrix(kron(scalar, np.eye(3)))


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
    return [slice(first, last) for first, last in pairwise(ends)]
