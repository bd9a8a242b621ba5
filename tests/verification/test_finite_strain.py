"""Patch test at finite strain, and rotations in large steps, of every element with every law."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pytest
from scipy.spatial.transform import Rotation

from gpusim.fem import (
    J2,
    Hencky,
    IsochoricNeoHookean,
    Isotropic,
    LoadStep,
    Material,
    Model,
    NeoHookean,
    Orthotropic,
    SaintVenantKirchhoff,
    Stress,
    Voce,
    solve,
)
from gpusim.fem.assembly.element_responses import element_responses
from gpusim.fem.assembly.equation import Equation
from gpusim.fem.elements.element import ELEMENTS
from gpusim.fem.materials.law import Law
from tests.support.element_meshes import SIZE, mesh_of
from tests.support.element_responses import tensors

Float = npt.NDArray[np.float64]

ELEMENT_FORMS = [(kind, name) for kind, one in ELEMENTS.items() for name in one.formulations]
STEEL = Isotropic(200e3, 0.3)
METAL = J2(STEEL, 250.0, Voce(400.0, 20.0, 500.0))
LAWS = [
    STEEL,
    Orthotropic((11e3, 400.0, 800.0), (0.4, 0.3, 0.03), (700.0, 50.0, 700.0)),
    SaintVenantKirchhoff(70e3, 0.33),
    NeoHookean(3.0, 0.45),
    IsochoricNeoHookean(3.0, 0.45),
    Hencky(2e3, 0.3),
    METAL,
]
# of the deformation gradient, one after the other
FIRST = np.array([[0.08, 0.1, -0.03], [0.02, -0.06, 0.04], [0.0, 0.07, 0.05]])
SECOND = FIRST + np.array([[-0.04, 0.05, 0.06], [0.0, 0.06, -0.03], [0.04, 0.0, -0.02]])
TURNS = [Rotation.from_rotvec(one).as_matrix() for one in ([0.9, -0.6, 0.4], [-0.5, 2.0, 0.8])]


@dataclass(frozen=True)
class EvenStep:
    """A deformation gradient, and the load step that has it on the body's surface."""

    gradient: Float
    load_step: LoadStep

    @property
    def recovered(self) -> Stress:
        assert self.load_step.stress is not None
        return self.load_step.stress


def even_steps(kind: str, formulation: str, law: Material, turns: list[Float]) -> list[EvenStep]:
    """Two gradients, then the second one turned, each in one step from the one before, from
    distorted cells whose inner nodes are free."""
    size = 1.0 if isinstance(law, Law) and law.finite_strain else 0.1
    gradients = [np.eye(3) + size * FIRST, np.eye(3) + size * SECOND]
    gradients += [turn @ gradients[1] for turn in turns]
    mesh = mesh_of(kind, (2, 2, 2), amount=0.06)
    points = mesh.points
    surface = ((points < 1e-9) | (points > np.array(SIZE) - 1e-9)).any(axis=1)[:, None]
    given = [np.where(surface, points @ (one - np.eye(3)).T, 0.0) for one in gradients]
    model = Model(mesh, law, np.repeat(surface, 3, axis=1), prescribed=np.stack(given))
    # what goes on between the steps isn't a rotation: none may be cut back
    found = solve(model, geometry="nonlinear", factors=np.eye(len(gradients)), method="direct",
                  formulation={kind: formulation}, tolerance=1e-11)  # fmt: skip
    assert found.converged and all(step.substeps == 1 for step in found.steps)
    return [EvenStep(*both) for both in zip(gradients, found.steps, strict=True)]


@pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__)
@pytest.mark.parametrize(("kind", "formulation"), ELEMENT_FORMS)
def test_even_strain_is_found_and_turns(kind: str, formulation: str, law: Material) -> None:
    steps = even_steps(kind, formulation, law, TURNS[:1] if law is not METAL else TURNS)
    mesh = mesh_of(kind, (2, 2, 2), amount=0.06)
    stress = [tensors(step.recovered.points[kind]) for step in steps]
    size = np.abs(stress[1]).max()
    for step, found in zip(steps, stress, strict=True):
        exact = mesh.points @ (step.gradient - np.eye(3)).T
        assert np.abs(step.load_step.u - exact).max() <= 1e-9
        assert np.ptp(found.reshape(-1, 9), axis=0).max() <= 1e-9 * size
    for turn, found in zip(TURNS, stress[2:], strict=False):
        assert np.abs(found - turn @ stress[1] @ turn.T).max() <= 1e-9 * size
    assert np.abs(stress[1] - stress[0]).max() > 0.05 * size
    if isinstance(law, Law) and law.finite_strain:
        assert np.abs(stress[1] - by_law(law, steps[:2])).max() <= 1e-9 * size


def by_law(law: Law, steps: list[EvenStep]) -> Float:
    """(3,3) Cauchy stress that the law alone gives at the last of the gradients."""
    state = np.zeros((1, law.state_size)) if law.state_size else None
    for step in steps:
        F = step.gradient
        green = 0.5 * (F.T @ F - np.eye(3))
        voigt = [*np.diag(green), *(2.0 * green[i, j] for i, j in ((0, 1), (1, 2), (2, 0)))]
        update = law.update(np.array([voigt]), state, moduli=False)
        state = update.state
    return np.asarray(F @ tensors(update.stress[0]) @ F.T / np.linalg.det(F))


@pytest.mark.parametrize(("kind", "formulation"), ELEMENT_FORMS)
def test_metal_flows_no_further_as_it_turns(kind: str, formulation: str) -> None:
    """Hughes & Winget, IJNME 15 (1980) 1862."""
    _, begun, *turned = even_steps(kind, formulation, METAL, TURNS)
    before = begun.recovered.plastic_strains
    assert before is not None and before.min() > 0.05
    for step in turned:
        assert np.abs(step.recovered.plastic_strains - before).max() <= 1e-9


@pytest.mark.parametrize(("kind", "formulation"), ELEMENT_FORMS)
def test_uneven_states_turn_with_the_body(kind: str, formulation: str) -> None:
    """A bent and twisted body of metal is turned twice, by more than a right angle in one step:
    forces turn with it, and its points flow no further."""
    mesh = mesh_of(kind, (2, 2, 2), amount=0.05, bulge=0.02)
    ends = (mesh.points[:, :1] <= 1e-9) | (mesh.points[:, :1] >= SIZE[0] - 1e-9)
    fixed = np.repeat(ends, 3, axis=1)
    far = mesh.points[:, 0] >= SIZE[0] - 1e-9
    twist = (mesh.points - 0.5) @ Rotation.from_rotvec([0.05, 0.0, 0.02]).as_matrix().T
    given = np.where(far[:, None], twist + 0.5 + [0.01, 0.0, 0.0] - mesh.points, 0.0)
    model = Model(mesh, METAL, fixed, prescribed=given)
    form = {kind: formulation}
    u = solve(model, geometry="nonlinear", formulation=form, tolerance=1e-9).u
    equation, factors = Equation(model, element_responses(model, form)), np.ones(1)

    def settled(moved: Float) -> tuple[Float, Float]:
        """Forces, and states of the points, where it has come to rest at ``moved``."""
        for _ in range(8):
            equation.linearised(moved, factors)
            equation.advance(moved, np.zeros_like(moved), foretell=False)
        equation.commit(moved, factors)
        (internal,) = equation.snapshot()
        assert internal.state is not None
        return equation.internal(moved, factors), internal.state

    forces, state = settled(u)
    size = np.abs(forces).max()
    # it is the state that was solved for, and it has flown, but not evenly
    assert np.abs(equation.unbalanced(forces)).max() <= 1e-6 * size
    assert state[..., 6].max() > 0.01 and np.ptp(state[..., 6]) > 0.005
    for turn in TURNS:
        turned, now = settled((mesh.points + u) @ turn.T - mesh.points)
        assert np.abs(turned - forces @ turn.T).max() <= 1e-9 * size
        assert np.abs(now - state).max() <= 1e-9
