"""Checks of a load path that has been followed: what is doubtful about its equilibria, the strains
of its last one, its cells and its materials."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.fem.assembly.element_batches import portions
from gpusim.fem.assembly.equation import Equation
from gpusim.fem.elements.corotational import Corotational
from gpusim.fem.elements.element_response import ElementResponse
from gpusim.fem.materials.j2 import J2, fit_for_flow
from gpusim.fem.model.model import Model
from gpusim.fem.model.solution import LoadStep
from gpusim.mesh.quality import least_jacobian

# of the accumulated plastic strain in one step: stress is a fifth of a per cent off at most
_MOST_FLOW = 0.07
# up to which strains by length and by Green-Lagrange are the same within a per cent
_SMALL_STRAIN = 0.02
# what is said of equilibria without a positive definite tangent
_UNSTABLE = (
    "isn't stable: the body would buckle (a small imperfection of mesh or load shows where to), or "
    "be torn where its material softens"
)
_UNCERTAIN = (
    "may not be stable: loads that follow have no potential there, and the symmetric part of the "
    "stiffness isn't positive definite, which would be enough"
)


def load_path_warnings(equation: Equation, steps: Sequence[LoadStep]) -> tuple[str, ...]:
    """What a reader of the ``steps`` should know."""
    return (
        *_strain_warning(equation, steps[-1].u),
        *_upside_down_warning(equation.model, steps[-1].u),
        *_flow_warning(steps),
        *_locking_warning(equation.responses),
        *_stability_warnings(equation, steps),
    )


def _stability_warnings(equation: Equation, steps: Sequence[LoadStep]) -> list[str]:
    """Wanted steps that end where a body wouldn't stay, or perhaps wouldn't."""
    loose: dict[str, list[int]] = {}
    for number, step in enumerate((one for one in steps if one.wanted), 1):
        if not step.iterations[-1].definite:
            skew = equation.skew_stiffness(step.u, step.factors)
            loose.setdefault(_UNSTABLE if skew is None else _UNCERTAIN, []).append(number)
    return [
        f"{len(numbers)} load steps, first number {numbers[0]}, end in an equilibrium that {what}"
        for what, numbers in loose.items()
    ]


def _upside_down_warning(model: Model, u: Float) -> tuple[str, ...]:
    """Cells whose corners have passed through one another, which no integration point need see."""
    least = [
        least_jacobian(kind, model.mesh.points + u, cells) for kind, _, cells in model.mesh.blocks()
    ]
    inverted = int((np.concatenate(least) <= 0.0).sum())
    return (f"{inverted} cells are turned inside out at a corner",) if inverted else ()


def _flow_warning(steps: Sequence[LoadStep]) -> tuple[str, ...]:
    """Where flow is taken in the direction that it has at the end of a long step: by shear of 0.1,
    0.5 and 1 in one step, which turns it, forces are 0.14, 3 and 10 per cent too small."""
    before, substeps, most = np.zeros(1), 0, 0.0
    for step in steps:
        substeps += step.substeps
        if step.stress is not None and (plastic := step.stress.nodal_plastic_strain) is not None:
            most = max(most, float(np.nanmax(plastic - before)) / substeps)
            before, substeps = plastic, 0
    if not most > _MOST_FLOW:
        return ()
    return (
        f"plastic strain grows by up to {most:.2g} in one step: where its direction turns, stress "
        f"may be {0.4 * most**2:.1%} off (load steps in between make it less)",
    )


def _locking_warning(responses: Sequence[ElementResponse]) -> list[str]:
    """Metal in cells that can't flow at constant volume."""
    return [
        f"{len(block.cells)} {block.name} ({block.formulation!r}) can't flow at constant volume: "
        "where metal yields they are far too stiff"
        for block in (one.block for one in responses)
        if isinstance(block.law, J2) and not fit_for_flow(block.name, block.formulation)
    ]


def _strain_warning(equation: Equation, u: Float) -> tuple[str, ...]:
    """Where elements for small strain are strained more than they are made for."""
    strains = [
        response.strain_extent(which, u)
        for response in equation.responses
        if isinstance(response, Corotational)
        for which in portions(len(response.cells))
    ]
    strain = np.concatenate(strains) if strains else np.zeros(1)
    beyond = int((strain > _SMALL_STRAIN).sum())
    if not beyond:
        return ()
    return (
        f"{beyond} cells are strained by up to {strain.max():.2%}: linear elastic laws are meant "
        f"for {_SMALL_STRAIN:.0%} at most (SaintVenantKirchhoff, Hencky and NeoHookean hold "
        "beyond)",
    )
