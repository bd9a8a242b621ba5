"""The elements of a model at large displacements, by law, cell type and formulation."""

from __future__ import annotations

from collections.abc import Mapping

from gpusim.fem.assembly.element_batches import model_groups
from gpusim.fem.elements.corotational import Corotational
from gpusim.fem.elements.element_response import ElementBlock, ElementResponse
from gpusim.fem.elements.enhanced_modes import EnhancedModes
from gpusim.fem.elements.mean_dilatation import MeanDilatation
from gpusim.fem.elements.total_lagrangian import TotalLagrangian
from gpusim.fem.materials.law import Law
from gpusim.fem.model.model import Model

# formulations with an answer of their own at finite strain
_FINITE_STRAIN = {"incompatible": EnhancedModes, "bbar": MeanDilatation}


def element_responses(model: Model, formulation: Mapping[str, str]) -> list[ElementResponse]:
    """Linear elements that turn with their cells where the law is one of small strain, total
    Lagrangian ones else."""
    assert model.material_of_cell is not None
    points = model.mesh.points
    responses: list[ElementResponse] = []
    for number, law in enumerate(model.materials):
        chosen = model.material_of_cell == number
        if not (isinstance(law, Law) and law.finite_strain):
            for group in model_groups(model, formulation, chosen):
                rule = formulation[group.name]
                block = ElementBlock(group.name, rule, points, group.cells, law)
                responses.append(Corotational(block, group))
            continue
        for name, first, cells in model.mesh.blocks():
            own = cells[chosen[first : first + len(cells)]]
            if len(own):
                rule = formulation[name]
                element = _FINITE_STRAIN.get(rule, TotalLagrangian)
                responses.append(element(ElementBlock(name, rule, points, own, law)))
    return responses
