"""Patch test at finite strain, and rotations in large steps, of every element with every law."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from scipy.spatial.transform import Rotation

from gpusim.fem import (
    J2,
    Hencky,
    IsochoricNeoHookean,
    Isotropic,
    Material,
    Model,
    NeoHookean,
    Orthotropic,
    SaintVenantKirchhoff,
    Voce,
    solve,
)
from gpusim.fem.assembly.element_responses import element_responses
from gpusim.fem.assembly.equation import Equation
from gpusim.fem.elements.element import ELEMENTS
from gpusim.fem.materials.law import Law
from gpusim.mesh import Mesh
from tests.support.element_meshes import SIZE, mesh_of
from tests.support.element_responses import tensors

Float = npt.NDArray[np.float64]
Bool = npt.NDArray[np.bool_]

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
# from rest, from one to the next, and back: by more than a right angle, and by less than the 120
# degrees from which on a step is cut back
TURNS = [Rotation.from_rotvec(one).as_matrix() for one in ([1.4, -0.9, 0.5], [0.3, -1.5, -1.0])]


def even_states(
    mesh: Mesh, formulation: str, law: Material, gradients: list[Float], free: Bool
) -> list[Float]:
    """(M,Q,3,3) Cauchy stress where all but the ``free`` nodes (N,) are led along one deformation
    gradient after the other, each in one step; the free ones have to follow."""
    fixed = np.repeat(~free[:, None], 3, axis=1)
    exact = [mesh.points @ (one - np.eye(3)).T for one in gradients]
    given = np.stack([np.where(fixed, one, 0.0) for one in exact])
    (kind,) = mesh.cells
    # what would lie between two steps isn't a rotation: none may be cut back
    found = solve(Model(mesh, law, fixed, prescribed=given), geometry="nonlinear", method="direct",
                  factors=np.eye(len(given)), formulation={kind: formulation},
                  tolerance=1e-11)  # fmt: skip
    assert found.converged and all(step.substeps == 1 for step in found.steps)
    result = []
    for step, u in zip(found.steps, exact, strict=True):
        assert np.abs(step.u - u).max() <= 1e-9
        assert step.stress is not None
        stress = tensors(step.stress.points[kind])
        assert np.ptp(stress.reshape(-1, 9), axis=0).max() <= 1e-9 * np.abs(stress).max()
        result.append(stress)
    return result


def distorted(kind: str) -> tuple[Mesh, Bool]:
    """Eight distorted blocks, and the nodes inside."""
    mesh = mesh_of(kind, (2, 2, 2), amount=0.06)
    inside = (mesh.points > 1e-9) & (mesh.points < np.array(SIZE) - 1e-9)
    return mesh, inside.all(axis=1)


@pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__)
@pytest.mark.parametrize(("kind", "formulation"), ELEMENT_FORMS)
def test_even_strain_is_found(kind: str, formulation: str, law: Material) -> None:
    finite = isinstance(law, Law) and law.finite_strain
    gradients = [np.eye(3) + (1.0 if finite else 0.1) * one for one in (FIRST, SECOND)]
    if law is not METAL:
        gradients.append(TURNS[0] @ gradients[1])
    mesh, inside = distorted(kind)
    first, second, *turned = even_states(mesh, formulation, law, gradients, inside)
    size = np.abs(second).max()
    assert np.abs(second - first).max() > 0.05 * size
    for stress in turned:
        assert np.abs(stress - TURNS[0] @ second @ TURNS[0].T).max() <= 1e-9 * size
    if finite:
        assert np.abs(second - by_law(law, gradients[:2])).max() <= 1e-9 * size


def by_law(law: Law, gradients: list[Float]) -> Float:
    """(3,3) Cauchy stress that the law alone gives at the last of the gradients."""
    state = np.zeros((1, law.state_size)) if law.state_size else None
    for F in gradients:
        green = 0.5 * (F.T @ F - np.eye(3))
        voigt = [*np.diag(green), *(2.0 * green[i, j] for i, j in ((0, 1), (1, 2), (2, 0)))]
        update = law.update(np.array([voigt]), state, moduli=False)
        state = update.state
    return np.asarray(F @ tensors(update.stress[0]) @ F.T / np.linalg.det(F))


@pytest.mark.parametrize(("kind", "formulation"), ELEMENT_FORMS)
def test_metal_turns_in_large_steps_without_flowing(kind: str, formulation: str) -> None:
    """Hughes & Winget, IJNME 15 (1980) 1862: strained past yield, turned twice, turned back."""
    mesh, inside = distorted(kind)
    one = np.arange(mesh.node_count) == np.flatnonzero(inside)[-1]
    strained = [np.eye(3) + FIRST, np.eye(3) + SECOND]
    gradients = [*strained, *(turn @ strained[1] for turn in TURNS), strained[1]]
    _, before, *turned, after = even_states(mesh, formulation, METAL, gradients, one)
    # its yield stress rises with whatever it flows
    size = np.abs(before).max()
    for turn, stress in zip(TURNS, turned, strict=True):
        assert np.abs(stress - turn @ before @ turn.T).max() <= 1e-9 * size
    assert np.abs(after - before).max() <= 1e-9 * size


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
