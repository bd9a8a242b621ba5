"""Linear elastic finite elements: models, loads and the static solver."""

from __future__ import annotations

from gpusim.fem.line_load import line_force
from gpusim.fem.loads import (
    body_force,
    centrifugal,
    face_force,
    nodal_force,
    pressure,
    traction,
)
from gpusim.fem.mass import lumped_mass, mass_matrix
from gpusim.fem.material import Isotropic, Material, Orthotropic
from gpusim.fem.model import Model
from gpusim.fem.solution import Solution
from gpusim.fem.statics import METHODS, solve
from gpusim.fem.stress import Stress, principal, stress, von_mises
from gpusim.fem.symmetry import symmetry
from gpusim.fem.thermal import thermal

__all__ = [
    "METHODS",
    "Isotropic",
    "Material",
    "Model",
    "Orthotropic",
    "Solution",
    "Stress",
    "body_force",
    "centrifugal",
    "face_force",
    "line_force",
    "lumped_mass",
    "mass_matrix",
    "nodal_force",
    "pressure",
    "principal",
    "solve",
    "stress",
    "symmetry",
    "thermal",
    "traction",
    "von_mises",
]
