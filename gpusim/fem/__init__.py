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

import typing as _typing

from gpusim.fem.linear.solve_plan import METHODS as METHODS
from gpusim.fem.materials.hardening import Voce as Voce
from gpusim.fem.materials.hencky import Hencky as Hencky
from gpusim.fem.materials.isochoric_neo_hookean import IsochoricNeoHookean as IsochoricNeoHookean
from gpusim.fem.materials.isotropic import Isotropic as Isotropic
from gpusim.fem.materials.j2 import J2 as J2
from gpusim.fem.materials.law import Law as Law
from gpusim.fem.materials.law import Material as Material
from gpusim.fem.materials.law import Update as Update
from gpusim.fem.materials.neo_hookean import NeoHookean as NeoHookean
from gpusim.fem.materials.orthotropic import Orthotropic as Orthotropic
from gpusim.fem.materials.saint_venant_kirchhoff import SaintVenantKirchhoff as SaintVenantKirchhoff
from gpusim.fem.model.constraints import Equations as Equations
from gpusim.fem.model.constraints import equations as equations
from gpusim.fem.model.constraints import tie as tie
from gpusim.fem.model.follower_loads import FollowerPressure as FollowerPressure
from gpusim.fem.model.loads import body_force as body_force
from gpusim.fem.model.loads import centrifugal as centrifugal
from gpusim.fem.model.loads import face_force as face_force
from gpusim.fem.model.loads import line_force as line_force
from gpusim.fem.model.loads import nodal_force as nodal_force
from gpusim.fem.model.loads import pressure as pressure
from gpusim.fem.model.loads import traction as traction
from gpusim.fem.model.mass import lumped_mass as lumped_mass
from gpusim.fem.model.mass import mass_matrix as mass_matrix
from gpusim.fem.model.model import Model as Model
from gpusim.fem.model.solution import LoadStep as LoadStep
from gpusim.fem.model.solution import Solution as Solution
from gpusim.fem.model.supports import symmetry as symmetry
from gpusim.fem.model.thermal_loads import thermal as thermal
from gpusim.fem.procedures.statics import solve as solve
from gpusim.fem.recovery.stress import Stress as Stress
from gpusim.fem.recovery.stress import principal as principal
from gpusim.fem.recovery.stress import stress as stress
from gpusim.fem.recovery.stress import von_mises as von_mises
from gpusim.public_names import public_names as _public_names

if _typing.TYPE_CHECKING:
    from gpusim.fem.dynamics.frequency_response import frequency_response as frequency_response
    from gpusim.fem.dynamics.harmonic import harmonic as harmonic
    from gpusim.fem.dynamics.random_response import RandomResponse as RandomResponse
    from gpusim.fem.dynamics.random_response import random_response as random_response
    from gpusim.fem.dynamics.transient import transient as transient
    from gpusim.fem.eigenvalues.buckling import buckling as buckling
    from gpusim.fem.eigenvalues.modes import modes as modes
    from gpusim.fem.model.buckling import Buckling as Buckling
    from gpusim.fem.model.damping import ModalDamping as ModalDamping
    from gpusim.fem.model.damping import Rayleigh as Rayleigh
    from gpusim.fem.model.damping import StructuralDamping as StructuralDamping
    from gpusim.fem.model.harmonic_response import HarmonicResponse as HarmonicResponse
    from gpusim.fem.model.history import EnergyHistory as EnergyHistory
    from gpusim.fem.model.history import History as History
    from gpusim.fem.model.modes import Modes as Modes
    from gpusim.fem.model.record import Record as Record
    from gpusim.fem.model.record import read_record as read_record

# what statics don't need isn't loaded before it is asked for
_LATER = {
    "gpusim.fem.dynamics.frequency_response": "frequency_response",
    "gpusim.fem.dynamics.harmonic": "harmonic",
    "gpusim.fem.dynamics.random_response": "RandomResponse random_response",
    "gpusim.fem.dynamics.transient": "transient",
    "gpusim.fem.eigenvalues.buckling": "buckling",
    "gpusim.fem.eigenvalues.modes": "modes",
    "gpusim.fem.model.buckling": "Buckling",
    "gpusim.fem.model.damping": "ModalDamping Rayleigh StructuralDamping",
    "gpusim.fem.model.harmonic_response": "HarmonicResponse",
    "gpusim.fem.model.history": "EnergyHistory History",
    "gpusim.fem.model.modes": "Modes",
    "gpusim.fem.model.record": "Record read_record",
}

__all__, __getattr__, __dir__ = _public_names(__name__, _LATER)
