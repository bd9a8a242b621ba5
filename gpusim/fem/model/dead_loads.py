"""Dead loads: what follows the body, and heat, as forces on the undeformed one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from gpusim.fem.model.model import Model
from gpusim.fem.model.thermal_loads import thermal


def with_dead_loads(model: Model, formulation: Mapping[str, str]) -> Model:
    """The same model with forces in place of following loads and heat, as linear theory takes
    them."""
    if not model.loads and model.temperature is None:
        return model
    forces = model.load_cases.copy()
    for load in model.loads:
        forces[load.case] += load.forces(model.mesh.points)
    if model.temperature is not None:
        for case, change in enumerate(model.temperature):
            forces[case] += thermal(
                model.mesh, model.materials, change, model.material_of_cell, formulation
            )
    single = model.forces is not None and model.forces.ndim == 2
    return replace(model, forces=forces[0] if single else forces, loads=(), temperature=None)
