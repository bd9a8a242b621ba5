"""J2 plasticity against one-dimensional solutions, another implementation, and differences."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from scipy.optimize import brentq

import gpusim as gs
from gpusim.arrays.array_types import Float
from gpusim.fem.materials.hardening import Hardening
from tests.support.law_checks import check_moduli, green_lagrange, strains

E, NU, YIELD = 200e3, 0.3, 250.0
STEEL = gs.Isotropic(E, NU)
KINDS: list[Hardening] = [
    0.0,
    2e3,
    gs.fem.Voce(500.0, 20.0, 130.0),
    ((0.0, 250.0), (0.004, 310.0), (0.03, 400.0), (0.08, 420.0)),
]
PULLED_AND_PRESSED = [0.0008, 0.003, 0.012, 0.011, 0.0095, 0.002, -0.02, -0.0189, 0.05, 0.09]


def yield_stress(hardening: Hardening, p: float) -> float:
    if isinstance(hardening, gs.fem.Voce):
        gain = hardening.saturation - YIELD
        return YIELD + hardening.linear * p + gain * (1.0 - np.exp(-hardening.rate * p))
    if isinstance(hardening, Sequence):
        return float(np.interp(p, *np.array(hardening).T))
    return YIELD + hardening * p


def bar(hardening: Hardening, path: Sequence[float]) -> list[tuple[float, float]]:
    """Stress and p of a bar along logarithmic strains: one equation a step, by bisection."""
    plastic = p = 0.0
    results = []
    for strain in path:
        trial = E * (strain - plastic)

        def excess(step: float, trial: float = trial, p: float = p) -> float:
            return abs(trial) - E * step - yield_stress(hardening, p + step)

        if excess(0.0) > 0.0:
            step = brentq(excess, 0.0, abs(trial) / E, xtol=1e-16, rtol=1e-14)
            plastic, p = plastic + np.sign(trial) * step, p + step
        results.append((E * (strain - plastic), p))
    return results


@pytest.mark.parametrize("hardening", KINDS, ids=repr)
def test_pulled_and_pressed_bar(hardening: Hardening) -> None:
    """Free sides, found by Newton's method with the law's own moduli."""
    law, state = gs.J2(STEEL, YIELD, hardening), np.zeros((1, 7))
    found, across = [], 0.0
    for along in PULLED_AND_PRESSED:
        for _ in range(25):
            strain = np.array([[across, 0.5 * np.expm1(2.0 * along), across, 0.0, 0.0, 0.0]])
            update = law.update(strain, state, moduli=True)
            assert update.moduli is not None and update.state is not None
            if abs(update.stress[0, 0]) <= 1e-12 * YIELD:
                break
            C = update.moduli[0]
            across -= update.stress[0, 0] / (C[0, 0] + C[0, 2])
        else:
            pytest.fail(f"the sides of the bar aren't free at {along}")
        assert update.state[0, 6] >= state[0, 6]
        state = update.state
        found.append((update.stress[0, 1] * np.exp(2.0 * along), state[0, 6]))
    expected = np.array(bar(hardening, PULLED_AND_PRESSED))
    np.testing.assert_allclose(np.array(found)[:, 0], expected[:, 0], rtol=0, atol=1e-9 * YIELD)
    np.testing.assert_allclose(np.array(found)[:, 1], expected[:, 1], rtol=0, atol=1e-12)
    assert (np.diff(expected[:, 1]) == 0.0).sum() >= 2  # it was unloaded, too


def logarithm(F: Float) -> Float:
    value, vector = np.linalg.eigh(F.T @ F)
    return np.asarray((vector * (0.5 * np.log(value))) @ vector.T)


def reference(hardening: Hardening, path: list[Float]) -> list[tuple[Float, float]]:
    """T (3,3) and p along deformation gradients: full matrices, a point at a time, bisection."""
    plastic, p, shear = np.zeros((3, 3)), 0.0, STEEL.shear
    results = []
    for F in path:
        elastic = logarithm(F) - plastic
        deviator = elastic - np.trace(elastic) / 3.0 * np.eye(3)
        trial = 2.0 * shear * np.sqrt(1.5 * (deviator**2).sum())

        def excess(step: float, trial: float = trial, p: float = p) -> float:
            return trial - 3.0 * shear * step - yield_stress(hardening, p + step)

        if excess(0.0) > 0.0:
            step = brentq(excess, 0.0, trial / (3.0 * shear), xtol=1e-16, rtol=1e-14)
            flow = 1.5 * step * deviator * 2.0 * shear / trial
            plastic, p, elastic = plastic + flow, p + step, elastic - flow
        T = 2.0 * shear * elastic + STEEL.lame * np.trace(elastic) * np.eye(3)
        results.append((T, p))
    return results


@pytest.mark.parametrize("hardening", KINDS, ids=repr)
def test_simple_shear_to_and_fro(hardening: Hardening) -> None:
    """S : dE = T : dH for each direction of dE, H by eigenvectors and differences."""
    shears = [0.001, 0.004, 0.05, 0.3, 0.299, 0.1, -0.4, 0.6]
    path = [np.array([[1.0, g, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]) for g in shears]
    law, state = gs.J2(STEEL, YIELD, hardening), np.zeros((1, 7))
    for F, (T, p) in zip(path, reference(hardening, path), strict=True):
        update = law.update(green_lagrange(F[None]), state, moduli=False)
        assert update.state is not None
        state = update.state
        xx, yy, zz, xy, yz, zx = update.stress[0]
        S = np.array([[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]])
        for direction in (F, np.diag([1.0, 2.0, 3.0]), np.eye(3)[[1, 2, 0]]):
            h = 1e-3
            moved = [logarithm(F + k * h * direction) for k in (1, -1, 2, -2)]
            dH = (8.0 * (moved[0] - moved[1]) - moved[2] + moved[3]) / (12.0 * h)
            dE = 0.5 * (direction.T @ F + F.T @ direction)
            work = np.abs(T).max() * np.abs(dH).max()
            np.testing.assert_allclose((S * dE).sum(), (T * dH).sum(), rtol=0, atol=1e-9 * work)
        np.testing.assert_allclose(state[0, 6], p, rtol=1e-10, atol=1e-14)


def flowed(law: gs.J2, size: float, count: int = 12) -> tuple[Float, Float]:
    """Strains, and a state that came by other ones, so that nothing is coaxial."""
    before = law.update(strains(size, count, seed=1), np.zeros((count, 7)), moduli=False).state
    assert before is not None
    return strains(size, count, seed=2), before


@pytest.mark.parametrize("hardening", KINDS, ids=repr)
@pytest.mark.parametrize("size", [0.01, 0.1, 0.4])
def test_consistent_moduli_where_it_flows(hardening: Hardening, size: float) -> None:
    law = gs.J2(STEEL, YIELD, hardening)
    strain, state = flowed(law, size)
    update = law.update(strain, state, moduli=True)
    assert update.state is not None
    assert (update.state[:, 6] > state[:, 6] + 1e-4).all()
    check_moduli(law, strain, state, 2e-5, 1e-8)


@pytest.mark.parametrize("hardening", KINDS, ids=repr)
def test_consistent_moduli_at_equal_stretches(hardening: Hardening) -> None:
    law, strain = gs.J2(STEEL, YIELD, hardening), np.zeros((3, 6))
    strain[0, :3] = [0.05, 0.05, -0.02]
    strain[1, :3] = [0.05, 0.05 + 1e-9, -0.02]
    strain[2, 3] = 0.05
    check_moduli(law, strain, np.zeros((3, 7)), 2e-5, 1e-8)
    # and elastic with plastic strain of other axes: C = 1, H = 0, where the stress isn't zero
    state = np.zeros((1, 7))
    state[0] = [2e-4, -1e-4, -1e-4, 2e-4, 0.0, -1e-4, 3e-3]
    assert law.update(np.zeros((1, 6)), state, moduli=False).stress.any()
    check_moduli(law, np.zeros((1, 6)), state, 2e-5, 1e-9)


def test_unloading_is_elastic() -> None:
    """Back by a little: the state is the same to the bit, moduli are those of elasticity."""
    law = gs.J2(STEEL, YIELD, 2e3)
    strain, _ = flowed(law, 0.02)
    state = law.update(strain, np.zeros((12, 7)), moduli=False).state
    back = law.update(0.995 * strain, state, moduli=True)
    np.testing.assert_array_equal(back.state, state)
    check_moduli(law, 0.995 * strain, state, 1e-5, 1e-9)
    # where it stopped it is on the yield surface: asked again, it doesn't flow by rounding
    again = law.update(strain, state, moduli=True)
    np.testing.assert_array_equal(again.state, state)
    # but it would: its moduli are those of going on
    on = law.update(strain * (1.0 + 1e-7), state, moduli=True)
    assert again.moduli is not None and on.moduli is not None
    np.testing.assert_allclose(again.moduli, on.moduli, rtol=0, atol=1e-5 * E)


def test_below_the_yield_stress_it_is_hencky() -> None:
    strain = strains(5e-4)
    update = gs.J2(STEEL, YIELD, 2e3).update(strain, None, moduli=True)
    assert update.state is not None and not update.state.any()
    elastic = gs.Hencky(E, NU).update(strain, None, moduli=True)
    np.testing.assert_allclose(update.stress, elastic.stress, rtol=0, atol=1e-12 * YIELD)
    assert update.moduli is not None and elastic.moduli is not None
    np.testing.assert_allclose(update.moduli, elastic.moduli, rtol=0, atol=1e-12 * E)


def test_volume_changes_are_elastic() -> None:
    law = gs.J2(STEEL, YIELD)
    strain = green_lagrange(np.diag([1.02, 1.02, 1.02])[None])
    update = law.update(strain, np.zeros((1, 7)), moduli=False)
    assert update.state is not None and not update.state.any()
    after = law.update(strains(0.2), np.zeros((12, 7)), moduli=False).state
    assert after is not None
    np.testing.assert_allclose(after[:, :3].sum(axis=1), 0.0, atol=1e-15)


def test_points_flow_each_for_itself() -> None:
    """Elastic and plastic ones among each other give what each gives alone."""
    law = gs.J2(STEEL, YIELD, gs.fem.Voce(500.0, 20.0))
    strain = strains(0.01)
    strain[::3] *= 0.01
    together = law.update(strain, np.zeros((12, 7)), moduli=True)
    assert together.state is not None and together.moduli is not None
    assert ((together.state[:, 6] > 0.0) == (np.arange(12) % 3 > 0)).all()
    for point in range(12):
        alone = law.update(strain[point], np.zeros(7), moduli=True)
        assert alone.state is not None and alone.moduli is not None
        np.testing.assert_allclose(together.stress[point], alone.stress, rtol=0, atol=1e-10)
        np.testing.assert_allclose(together.state[point], alone.state, rtol=0, atol=1e-15)
        np.testing.assert_allclose(together.moduli[point], alone.moduli, rtol=0, atol=1e-7)


def test_wrong_arguments_are_refused() -> None:
    with pytest.raises(gs.InputError, match="J2: elastic; got NeoHookean; expected an Isotropic"):
        gs.J2(gs.NeoHookean(E, NU), YIELD)  # type: ignore[arg-type]
    with pytest.raises(
        gs.InputError, match=r"J2: yield_stress out of range; got 0.0; expected a n"
    ):
        gs.J2(STEEL, 0.0)
    with pytest.raises(gs.InputError, match="J2: yield_stress; got '250'; expected a number > 0"):
        gs.J2(STEEL, "250")  # type: ignore[arg-type]


def test_it_is_a_value() -> None:
    given = np.array([[0.0, 250.0], [0.1, 300.0]])
    law = gs.J2(STEEL, np.float32(250.0), given)  # type: ignore[arg-type]
    assert law == gs.J2(STEEL, 250.0, [(0, 250), (0.1, 300)])
    assert hash(law) == hash(gs.J2(STEEL, 250.0, [(0, 250), (0.1, 300)]))
    given[1, 1] = 1e9
    assert law.hardening == ((0.0, 250.0), (0.1, 300.0))
    assert gs.J2(STEEL, 250.0, 1).hardening == 1.0
