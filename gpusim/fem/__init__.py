"""Linear elastic finite elements: models, loads and the static solver."""

from __future__ import annotations

from gpusim.fem.loads import body_force, face_force, nodal_force, pressure, traction
from gpusim.fem.material import Isotropic
from gpusim.fem.model import Model
from gpusim.fem.solution import Solution
from gpusim.fem.statics import PRECONDITIONERS, solve

__all__ = [
    "PRECONDITIONERS",
    "Isotropic",
    "Model",
    "Solution",
    "body_force",
    "face_force",
    "nodal_force",
    "pressure",
    "solve",
    "traction",
]
