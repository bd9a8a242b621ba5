"""Finite elements: models, loads, laws and statics, by linear theory or at large displacements.

In the order in which data passes:

- `materials`: Laws: stress and moduli from strain and history, a file each.
- `elements`: Formulations and their rules (shape functions are in `gpusim.mesh`), stiffness,
  strain.
- `model`: Supports, loads, and the solution.
- `sparse`: Matrices of 3x3 blocks, and their products.
- `lattice`: Rectilinear bricks, whose rows repeat.
- `assembly`: From elements to a matrix of 3x3 blocks, and its system.
- `multigrid`: Levels, transfer, smoothers, the coarsest level.
- `incompressibility`: Displacements and pressures.
- `direct_solvers`: Direct solvers, and the choice between them and multigrid.
- `device`: The solver on a device: texels, operators, smoothing, the V-cycle.
- `krylov`: Krylov iterations, and what is known of their error.
- `linear`: Linear solvers: prepared for a matrix, solved with, updated.
- `procedures`: What is solved step by step with them: statics, linear and nonlinear.
- `eigenvalues`: Natural frequencies and mode shapes, and loads at which bodies buckle.
- `dynamics`: What a body does in time, and in steady vibration.
- `recovery`: What follows from displacements: stress.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from gpusim.fem.linear.solve_plan import METHODS
from gpusim.fem.materials.hardening import Voce
from gpusim.fem.materials.hencky import Hencky
from gpusim.fem.materials.isochoric_neo_hookean import IsochoricNeoHookean
from gpusim.fem.materials.isotropic import Isotropic
from gpusim.fem.materials.j2 import J2
from gpusim.fem.materials.law import Law, Material, Update
from gpusim.fem.materials.neo_hookean import NeoHookean
from gpusim.fem.materials.orthotropic import Orthotropic
from gpusim.fem.materials.saint_venant_kirchhoff import SaintVenantKirchhoff
from gpusim.fem.model.constraints import Equations, equations, tie
from gpusim.fem.model.follower_loads import FollowerPressure
from gpusim.fem.model.loads import (
    body_force,
    centrifugal,
    face_force,
    line_force,
    nodal_force,
    pressure,
    traction,
)
from gpusim.fem.model.mass import lumped_mass, mass_matrix
from gpusim.fem.model.model import Model
from gpusim.fem.model.solution import LoadStep, Solution
from gpusim.fem.model.supports import symmetry
from gpusim.fem.model.thermal_loads import thermal
from gpusim.fem.procedures.statics import solve
from gpusim.fem.recovery.stress import Stress, principal, stress, von_mises

if TYPE_CHECKING:
    from gpusim.fem.dynamics.frequency_response import frequency_response
    from gpusim.fem.dynamics.harmonic import harmonic
    from gpusim.fem.dynamics.random_response import RandomResponse, random_response
    from gpusim.fem.dynamics.transient import transient
    from gpusim.fem.eigenvalues.buckling import buckling
    from gpusim.fem.eigenvalues.modes import modes
    from gpusim.fem.model.buckling import Buckling
    from gpusim.fem.model.damping import ModalDamping, Rayleigh, StructuralDamping
    from gpusim.fem.model.harmonic_response import HarmonicResponse
    from gpusim.fem.model.history import EnergyHistory, History
    from gpusim.fem.model.modes import Modes
    from gpusim.fem.model.record import Record, read_record

# what statics don't need isn't loaded before it is asked for
_LATER = {
    "Buckling": "model.buckling",
    "EnergyHistory": "model.history",
    "HarmonicResponse": "model.harmonic_response",
    "History": "model.history",
    "ModalDamping": "model.damping",
    "Modes": "model.modes",
    "RandomResponse": "dynamics.random_response",
    "Rayleigh": "model.damping",
    "Record": "model.record",
    "StructuralDamping": "model.damping",
    "buckling": "eigenvalues.buckling",
    "frequency_response": "dynamics.frequency_response",
    "harmonic": "dynamics.harmonic",
    "modes": "eigenvalues.modes",
    "random_response": "dynamics.random_response",
    "read_record": "model.record",
    "transient": "dynamics.transient",
}
__all__ = [
    "J2",
    "METHODS",
    "Buckling",
    "EnergyHistory",
    "Equations",
    "FollowerPressure",
    "HarmonicResponse",
    "Hencky",
    "History",
    "IsochoricNeoHookean",
    "Isotropic",
    "Law",
    "LoadStep",
    "Material",
    "ModalDamping",
    "Model",
    "Modes",
    "NeoHookean",
    "Orthotropic",
    "RandomResponse",
    "Rayleigh",
    "Record",
    "SaintVenantKirchhoff",
    "Solution",
    "Stress",
    "StructuralDamping",
    "Update",
    "Voce",
    "body_force",
    "buckling",
    "centrifugal",
    "equations",
    "face_force",
    "frequency_response",
    "harmonic",
    "line_force",
    "lumped_mass",
    "mass_matrix",
    "modes",
    "nodal_force",
    "pressure",
    "principal",
    "random_response",
    "read_record",
    "solve",
    "stress",
    "symmetry",
    "thermal",
    "tie",
    "traction",
    "transient",
    "von_mises",
]


def __getattr__(name: str) -> Any:
    if name in _LATER:
        return getattr(import_module(f"gpusim.fem.{_LATER[name]}"), name)
    raise AttributeError(f"module 'gpusim.fem' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
