"""Nearly incompressible bricks: multigrid of an ordinary body, and pressures beside it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from gpusim.fem.assembly.assembly import Assembled, assemble
from gpusim.fem.assembly.system import System, finest_matrix, make_system
from gpusim.fem.incompressibility.checkerboards import PressureScaling
from gpusim.fem.incompressibility.pressure_chebyshev import PressureChebyshev
from gpusim.fem.incompressibility.saddle_point import SaddleCG
from gpusim.fem.incompressibility.volume_split import VolumeSplit, split_volume
from gpusim.fem.krylov.cg import NumpyCG
from gpusim.fem.krylov.error_estimates import Norm
from gpusim.fem.krylov.soft_modes import probe
from gpusim.fem.model.model import Model
from gpusim.fem.multigrid.hierarchy import build_hierarchy
from gpusim.fem.multigrid.preconditioner import Multigrid

__all__ = ["MixedFormulation", "mixed_solver"]

Float = npt.NDArray[np.float64]

# multigrid is scaled to this share of A: closer takes fewer iterations, but bounds displacements
# worse, and the least Ritz value that it is measured by lies above the least eigenvalue
_BELOW = 0.7
# of the search for these: most iterations, its first ones, and the factor by which the least Ritz
# value may still fall while they double
_PROBES, _FIRST, _SHARP = 160, 5, 1.1


@dataclass(frozen=True, eq=False)
class MixedFormulation:
    """What ``SaddleCG`` takes. ``unit`` is A's over K's, ``norm`` K's; ``probed`` iterations went
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
        return self.norm.lowest

    def loop(self, cases: int) -> SaddleCG:
        """Conjugate gradients for some load cases."""
        return SaddleCG(
            self.multigrid, self.theta, self.split.divergence, self.split.compliance,
            self.pressures, self.unit, cases,
        )  # fmt: skip

    def apply(self, r: Float) -> Float:
        """About (A/scale)^-1 r for (L,3N), which is no less than K's inverse."""
        return self.multigrid.apply(r) / self.unit


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
    own = make_system(split.model, parts)
    hierarchy = build_hierarchy(
        finest_matrix(parts.rows, own), parts.groups, parts.lattice, system.free,
        model.mesh.points, parts.rows, own.scale,
    )  # fmt: skip
    multigrid = Multigrid(hierarchy)
    found = probe(own.case(0), NumpyCG(multigrid.product, multigrid), _PROBES, _FIRST, _SHARP)
    if not found.settled.all():
        return None
    unit = own.scale / system.scale
    split = replace(split, compliance=split.compliance * own.scale, shear=split.shear / own.scale)
    diagonal = np.einsum("cii->ci", parts.rows.diagonal)[parts.rows.row_class] / own.scale
    diagonal = np.where(system.free, diagonal, 0.0)
    pressures: PressureScaling | PressureChebyshev = (
        PressureChebyshev(split, diagonal)
        if split.lattice is None
        else PressureScaling(split, diagonal)
    )
    lowest = unit * min(hierarchy.lowest, found.lowest) * (1.0 - _BELOW)
    theta = _BELOW * float(found.mu.min())
    return MixedFormulation(
        multigrid, split, pressures, theta, unit, Norm(lowest, sought=True), found.iterations
    )
