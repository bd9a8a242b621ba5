"""Laws as elements see them: every one of ours, and one that a user wrote."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import gpusim as gs
from gpusim.arrays.array_types import Float
from gpusim.fem.materials.linear_elasticity import law_of
from tests.support.law_checks import check_energy, check_law, check_moduli, strains

STEEL = gs.Isotropic(210e3, 0.3, density=7.85e-9, expansion=1.2e-5)
WOOD = gs.Orthotropic(E=(11e3, 400.0, 800.0), nu=(0.4, 0.3, 0.03), G=(700.0, 50.0, 700.0))
ELASTIC = [
    STEEL,
    WOOD,
    gs.SaintVenantKirchhoff(70e3, 0.33),
    gs.NeoHookean(3.0, 0.45),
    gs.fem.IsochoricNeoHookean(3.0, 0.45),
    gs.Hencky(2e3, -0.2),
]
PLASTIC = [
    gs.J2(STEEL, yield_stress=250.0),
    gs.J2(STEEL, yield_stress=250.0, hardening=2e3),
    gs.J2(STEEL, yield_stress=250.0, hardening=gs.fem.Voce(500.0, 20.0, 130.0)),
    gs.J2(STEEL, yield_stress=250.0, hardening=[(0.0, 250.0), (0.004, 300.0), (0.1, 500.0)]),
]


@pytest.mark.parametrize("law", [*ELASTIC, *PLASTIC], ids=repr)
@pytest.mark.parametrize("size", [1e-4, 0.02, 0.2])
def test_every_law_does_what_elements_ask_for(law: gs.fem.Law, size: float) -> None:
    check_law(law, strains(size))


@pytest.mark.parametrize("law", ELASTIC, ids=repr)
@pytest.mark.parametrize("size", [1e-4, 0.02, 0.2])
def test_moduli_of_elastic_laws_are_the_derivative(law: gs.fem.Law, size: float) -> None:
    check_moduli(law, strains(size), None, 1e-4, 1e-9)


@pytest.mark.parametrize("law", [*ELASTIC[2:], *PLASTIC], ids=repr)
def test_density_and_expansion_are_as_on_linear_materials(law: gs.fem.Law) -> None:
    assert isinstance(law, gs.fem.Material)
    if isinstance(law, gs.J2):
        assert law.density == 7.85e-9
        np.testing.assert_array_equal(law.expansion_strain(), STEEL.expansion_strain())
    else:
        assert (law.density, law.expansion_strain().any()) == (0.0, False)


@pytest.mark.parametrize("law", ELASTIC[2:], ids=repr)
def test_stress_gives_back_on_a_closed_path_all_that_it_took(law: gs.fem.Law) -> None:
    """Work round a circle in the space of strains, by the trapezium rule (exact for circles)."""
    a, b = strains(0.2, 2)
    angle = np.linspace(0.0, 2.0 * np.pi, 65)[:-1, None]
    path = 0.3 * a + (1.0 - np.cos(angle)) * 0.5 * a + np.sin(angle) * 0.5 * b
    tangent = np.sin(angle) * 0.5 * a + np.cos(angle) * 0.5 * b
    power = (law.update(path, None, moduli=False).stress * tangent).sum(axis=1)
    assert abs(power.mean()) <= 1e-12 * np.abs(power).max()


@pytest.mark.parametrize("law", [*ELASTIC, *PLASTIC], ids=repr)
def test_stress_is_the_derivative_of_the_energy(law: gs.fem.Law) -> None:
    strain = strains(0.1)
    state = np.zeros((len(strain), law.state_size)) if law.state_size else None
    if state is not None:  # elastic from where the flow has ended
        state, strain = law.update(strain, state, moduli=False).state, 0.997 * strain
        assert state is not None and state[:, 6].min() > 0.01
        np.testing.assert_array_equal(law.update(strain, state, moduli=False).state, state)
    check_energy(law, strain, state, 1e-5, 1e-8)


@pytest.mark.parametrize("law", [*ELASTIC, *PLASTIC], ids=repr)
def test_energy_of_small_strain_keeps_its_digits(law: gs.fem.Law) -> None:
    strain = strains(1e-7)
    state = np.zeros((len(strain), law.state_size)) if law.state_size else None
    expected = 0.5 * ((strain @ law.stiffness()) * strain).sum(axis=1)
    found = law.results(strain, state)["energy"]  # type: ignore[attr-defined]
    np.testing.assert_allclose(found, expected, rtol=1e-6)


class Damage:
    """A user's own: the stiffness falls as exp(-(k - 1) / 4), k the largest energy so far."""

    density, state_size, finite_strain = 1.0, 1, True

    def stiffness(self) -> Float:
        return STEEL.stiffness()

    def expansion_strain(self) -> Float:
        return np.zeros(6)

    def update(self, strain: Float, state: Float | None, *, moduli: bool) -> gs.fem.Update:
        assert state is not None
        stress = strain @ self.stiffness()
        energy = 0.5 * (stress * strain).sum(axis=-1, keepdims=True)
        k = np.maximum(np.maximum(state, energy), 0.0)
        left = np.exp(-np.maximum(k - 1.0, 0.0) / 4.0)
        grows = (energy >= state) & (k > 1.0)
        C = left[..., None] * self.stiffness()
        C -= (grows * left / 4.0)[..., None] * stress[..., :, None] * stress[..., None, :]
        return gs.fem.Update(left * stress, C if moduli else None, k)

    def results(self, strain: Float, state: Float) -> dict[str, Float]:
        return {"damage": 1.0 - np.exp(-np.maximum(state[..., 0] - 1.0, 0.0) / 4.0)}


def test_a_users_law_is_one_class() -> None:
    law, strain = Damage(), strains(0.01)
    assert law_of(law, "materials[0]") is law
    check_law(law, strain)
    check_moduli(law, strain, np.zeros((len(strain), 1)), 1e-6, 1e-8)
    unloaded = law.update(
        0.5 * strain, law.update(strain, np.zeros((12, 1)), moduli=False).state, moduli=False
    )
    assert (unloaded.state > 1.0).any()
    fresh = law.update(0.5 * strain, np.zeros((12, 1)), moduli=False).stress
    assert (np.abs(unloaded.stress) < np.abs(fresh)).any()


def bar(law: gs.fem.Law) -> gs.Model:
    """Two units long, pulled by its end along x, free to contract."""
    mesh = gs.mesh.box(size=(2.0, 1.0, 1.0), divisions=(2, 1, 1))
    x, y, z = (np.isclose(mesh.points, 0.0)).T
    end = np.isclose(mesh.points[:, 0], 2.0)
    fixed = np.stack([x | end, y, z], axis=1)
    prescribed = np.zeros(mesh.points.shape)
    prescribed[end, 0] = 2.0
    return gs.Model(mesh, law, fixed, prescribed=prescribed)


def test_a_users_law_is_solved_with_its_history() -> None:
    # stretched, let go and stretched further, but not to where it softens and cells are no longer
    # strained alike: by the closed form of uniaxial stress
    E = STEEL.E
    stretch = np.array([0.5, 0.1, 0.5, 0.6]) * np.sqrt(10.0 / E)
    solution = gs.fem.solve(bar(Damage()), geometry="nonlinear", factors=stretch, tolerance=1e-9)
    green = stretch + 0.5 * stretch**2
    energy = 0.5 * E * green**2
    k = np.maximum.accumulate(energy)
    damaged = np.exp(-np.maximum(k - 1.0, 0.0) / 4.0) * E * green
    force = [step.reactions[step.reactions[:, 0] > 0.0, 0].sum() for step in solution.steps]
    assert (k > 1.0).any()
    assert np.abs(np.array(force) - (1.0 + stretch) * damaged).max() <= 1e-6 * damaged.max()
    # what it tells is recovered; it tells no energy
    damage = np.stack([step.stress.nodal_results["damage"] for step in solution.steps])
    expected = 1.0 - np.exp(-np.maximum(k - 1.0, 0.0) / 4.0)
    np.testing.assert_allclose(damage, expected[:, None] + np.zeros(damage.shape[1]), rtol=1e-6)
    assert np.isnan(solution.strain_energy).all() and solution.external_work[0] > 0.0


def test_a_law_for_small_strain_is_linear_or_refused() -> None:
    law = Damage()
    law.finite_strain = False
    with pytest.raises(gs.InputError, match=r"materials\[0\]: history.*finite_strain = True"):
        gs.fem.solve(bar(law), geometry="nonlinear")
    stiffens = Damage()
    stiffens.finite_strain, stiffens.state_size = False, 0
    stiffens.results = lambda strain, state: {}  # type: ignore[method-assign]
    stiffens.update = lambda strain, state, *, moduli: gs.fem.Update(  # type: ignore[method-assign]
        strain @ STEEL.stiffness() * (1.0 + np.abs(strain).max()), STEEL.stiffness(), None
    )
    with pytest.raises(gs.InputError, match="isn't stiffness"):
        law_of(stiffens, "materials[0]")


def test_a_law_that_loses_its_numbers_is_named() -> None:
    law = Damage()
    answer = law.update

    def lost(strain: Float, state: Float | None, *, moduli: bool) -> gs.fem.Update:
        found = answer(strain, state, moduli=moduli)
        return replace(found, stress=np.where(np.abs(strain) > 1e-4, np.nan, found.stress))

    law.update = lost  # type: ignore[method-assign]
    with pytest.raises(gs.NotConverged, match="Damage: got a stress that isn't finite"):
        gs.fem.solve(bar(law), geometry="nonlinear", factors=[0.01])
