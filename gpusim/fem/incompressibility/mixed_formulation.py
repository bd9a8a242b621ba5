"""Conjugate gradients on displacements and pressures together (Bramble & Pasciak).

With the residuals r1 = f - A u - B^T p, r2 = C p - B u, scaled multigrid Â = theta M below A, and Q
for the pressures, the system preconditioned by

    z1 = Â^-1 r1,    z2 = Q^-1 (B z1 - r2)

is symmetric and positive definite in the product <x,y> = x1.(A - Â) y1 + x2.Q y2 (Bramble &
Pasciak, Math. Comput. 50 (1988) 1), so conjugate gradients apply. What they minimise is no less
than e1.(A - Â) e1, hence

    (1 - theta / lambda) ||e_u||_A^2 <= ||e||^2 <= <z,z> / mu

for the least eigenvalues lambda of M^-1 A and mu of the whole: displacements are bounded as they
are without pressures.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_matrix

from gpusim.arrays.array_types import Bool, Float
from gpusim.fem.assembly.assembly import Assembled, assemble
from gpusim.fem.assembly.system import System, make_system
from gpusim.fem.incompressibility.pressure_preconditioners import PressureChebyshev, PressureScaling
from gpusim.fem.incompressibility.volume_split import VolumeSplit, split_volume
from gpusim.fem.krylov.cg import NumpyCG, dot
from gpusim.fem.krylov.error_estimates import Norm, probe
from gpusim.fem.krylov.multigrid_preconditioner import Multigrid
from gpusim.fem.model.model import Model
from gpusim.fem.multigrid.hierarchy import build_hierarchy

# <z,z> relative to when z was last formed from the residuals, below which it is formed anew:
# multigrid in float32 isn't quite linear, and what z has collected of that mustn't matter
_STALE = 1e-5
# multigrid is scaled to this share of A: closer takes fewer iterations, but bounds displacements
# worse, and the least Ritz value that it is measured by lies above the least eigenvalue
_BELOW = 0.7
# of the search for these: most iterations, its first ones, and the factor by which the least Ritz
# value may still fall while they double
_PROBES, _FIRST, _SHARP = 160, 5, 1.1


@dataclass(frozen=True, eq=False)
class MixedFormulation:
    """``multigrid`` is A's, ``theta`` what to scale it by; ``split`` has B and C, ``pressures`` is
    Q^-1, in A's units, which are ``unit`` times K's. ``norm`` is K's; ``probed`` iterations went
    into A's least eigenvalues."""

    multigrid: Multigrid
    split: VolumeSplit
    pressures: PressureScaling | PressureChebyshev
    theta: float
    unit: float
    norm: Norm
    probed: int

    @property
    def lowest(self) -> float:
        """About the least eigenvalue of K / scale."""
        return self.norm.lowest * self.norm.share

    def loop(self, cases: int) -> SaddleCG:
        """Conjugate gradients for some load cases."""
        return SaddleCG(self, cases)

    def apply(self, r: Float) -> Float:
        """About (A/scale)^-1 r for (L,3N), which is no less than K's inverse."""
        return self.multigrid.apply(r) / self.unit


class SaddleCG:
    """The loop of ``cg`` for K = A + B^T C^-1 B; residuals and histories are K's."""

    def __init__(self, mixed: MixedFormulation, cases: int) -> None:
        self._multigrid, self._theta, self._unit = mixed.multigrid, mixed.theta, mixed.unit
        self._b, self._c = mixed.split.divergence, mixed.split.compliance
        self._back, self._pressures = csr_matrix(self._b.T), mixed.pressures
        # C p - B u of everything that has been solved for so far
        self._known = np.zeros((cases, len(self._c)))

    def begin(self, residual: Float) -> Float:
        """Start from a zero correction; returns <z,z> per case (L,)."""
        self._r2 = self._known.copy()
        self._r1 = residual / self._unit
        if self._r2.any():
            self._r1 -= self._forces(self._r2 / self._c)
        self._x = np.zeros_like(residual), np.zeros_like(self._r2)
        self._rz = self._form()
        self._last = self._rz.copy()
        self._d = [one.copy() for one in (self._z1, self._z2, self._az, self._bz)]
        return self._unit * self._rz

    def run(self, count: int, active: Bool) -> Float:
        """``count`` iterations; history (count,L,4): <z,z>, alpha, beta, <w,d>."""
        history = np.empty((count, len(self._rz), 4))
        for line in history:
            d1, d2, ad, bd = self._d
            q1, q2 = ad + self._forces(d2), bd - self._c * d2
            w1 = self._solve(q1)
            bw = self._volumes(w1)
            pq = dot(w1, ad) - dot(q1, d1) + dot(bw - q2, d2)
            alpha = np.divide(self._rz, pq, out=np.zeros_like(pq), where=active & (pq > 0.0))
            step = alpha[:, None]
            for vector, change in zip((*self._x, self._r1, self._r2), (d1, d2, -q1, -q2),
                                      strict=True):  # fmt: skip
                vector += step * change
            if bool((active & (self._rz <= _STALE * self._last)).any()):
                rz = self._form()
                self._last = np.where(active, rz, self._last)
            else:
                self._z1 -= step * w1
                self._bz -= step * bw
                rz = self._close()
            beta = np.divide(rz, self._rz, out=np.zeros_like(rz), where=active & (self._rz > 0.0))
            line[:] = np.stack([self._unit * self._rz, alpha, beta, self._unit * pq], axis=1)
            self._rz = rz
            for old, new in zip(self._d, (self._z1, self._z2, self._az, self._bz), strict=True):
                old *= beta[:, None]
                old += new
        return history

    def correction(self) -> Float:
        """The displacements of this run so far, (L,3N)."""
        return self._x[0].copy()

    def preconditioned(self) -> Float:
        """The displacements of z, (L,3N)."""
        return self._z1

    def keep(self) -> None:
        """The correction has been added to the solution: its pressures count from now on."""
        self._known = self._known + self._c * self._x[1] - self._volumes(self._x[0])

    def residual(self) -> Float:
        """What is left of K's right-hand side by the recursion, (L,3N)."""
        return self._unit * (self._r1 + self._forces(self._r2 / self._c))

    def _form(self) -> Float:
        """z of the residuals."""
        self._z1 = self._solve(self._r1)
        self._bz = self._volumes(self._z1)
        return self._close()

    def _close(self) -> Float:
        """The pressures of z, A z and <z,z>, from its displacements."""
        rest = self._bz - self._r2
        self._z2 = np.stack([self._pressures.apply(one) for one in rest])
        self._az = self._multigrid.product(self._z1)
        return dot(self._z1, self._az - self._r1) + dot(self._z2, rest)

    def _solve(self, r: Float) -> Float:
        return self._multigrid.apply(r) / self._theta

    def _volumes(self, u: Float) -> Float:
        return np.stack([self._b @ one for one in u])

    def _forces(self, p: Float) -> Float:
        return np.stack([self._back @ one for one in p])


def mixed_solver(
    model: Model, formulation: Mapping[str, str], assembled: Assembled, system: System
) -> MixedFormulation | None:
    """None where ``split_volume`` says so, or the least eigenvalues of A don't show soon.

    Raises NotConverged for an A that isn't positive definite.
    """
    split = split_volume(model, formulation, assembled.lattice, system.free)
    if split is None:
        return None
    parts = assemble(split.model, formulation, assembled.lattice)
    shear_system = make_system(split.model, parts)
    hierarchy = build_hierarchy(parts, shear_system, model.mesh.points)
    multigrid = Multigrid(hierarchy)
    spectrum = probe(
        shear_system.case(0), NumpyCG(multigrid.product, multigrid), _PROBES, _FIRST, _SHARP
    )
    if not spectrum.settled.all():
        return None
    unit = shear_system.scale / system.scale
    split = replace(
        split,
        compliance=split.compliance * shear_system.scale,
        shear=split.shear / shear_system.scale,
    )
    diagonal = np.einsum("cii->ci", parts.rows.diagonal)[parts.rows.row_class] / shear_system.scale
    diagonal = np.where(system.free, diagonal, 0.0)
    pressures: PressureScaling | PressureChebyshev = (
        PressureChebyshev(split, diagonal)
        if split.lattice is None
        else PressureScaling(split, diagonal)
    )
    norm = Norm(unit * min(hierarchy.lowest, spectrum.lowest), sought=True, share=1.0 - _BELOW)
    theta = _BELOW * float(spectrum.mu.min())
    return MixedFormulation(multigrid, split, pressures, theta, unit, norm, spectrum.iterations)
