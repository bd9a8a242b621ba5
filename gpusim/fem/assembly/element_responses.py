"""The elements of a model at large displacements, by law, cell type and formulation."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.fem.assembly.element_batches import model_groups
from gpusim.fem.elements.corotational import Corotational
from gpusim.fem.elements.element_response import ElementBlock, ElementResponse
from gpusim.fem.elements.enhanced_modes import EnhancedModes
from gpusim.fem.elements.mean_dilatation import MeanDilatation
from gpusim.fem.elements.total_lagrangian import TotalLagrangian
from gpusim.fem.materials.linear_elasticity import law_of
from gpusim.fem.model.model import Model
from gpusim.fem.model.thermal_loads import point_temperature

# formulations with an answer of their own at finite strain
_FINITE_STRAIN = {"incompatible": EnhancedModes, "bbar": MeanDilatation}


def element_responses(model: Model, formulation: Mapping[str, str]) -> list[ElementResponse]:
    """Linear elements that turn with their cells where the law is one of small strain, total
    Lagrangian ones else."""
    assert model.material_of_cell is not None
    points = model.mesh.points
    responses: list[ElementResponse] = []
    for number, material in enumerate(model.materials):
        law = law_of(material, f"solve: materials[{number}]")
        chosen = model.material_of_cell == number
        if not law.finite_strain:
            for group in model_groups(model, formulation, chosen):
                rule, numbers = formulation[group.name], group.numbers
                block = ElementBlock(group.name, rule, points, group.cells, law, numbers)
                responses.append(Corotational(block, group))
            continue
        for name, first, cells in model.mesh.blocks():
            own, rule = np.flatnonzero(chosen[first : first + len(cells)]), formulation[name]
            if len(own):
                block = ElementBlock(name, rule, points, cells[own], law, first + own)
                responses.append(_FINITE_STRAIN.get(rule, TotalLagrangian)(block))
    return responses


def free_strain(response: ElementResponse, change: Float) -> Float:
    """(M,Q,6) strain by which heat stretches the material of each point, of a ``change`` (N,) of
    temperature that is linear between corners."""
    block = response.block
    warm = point_temperature(block.name, block.rule, change[block.cells])
    return np.asarray(warm[..., None] * block.law.expansion_strain())
