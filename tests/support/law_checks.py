"""What every law must do, checked for any: shapes, symmetry, moduli as derivatives."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.fem import Law
from gpusim.fem.materials.law import results_of


def green_lagrange(F: Float) -> Float:
    """(…,6) strain of deformation gradients (…,3,3), engineering shear."""
    C = np.swapaxes(F, -1, -2) @ F
    E = 0.5 * (C - np.eye(3))
    return np.stack(
        [E[..., 0, 0], E[..., 1, 1], E[..., 2, 2], C[..., 0, 1], C[..., 1, 2], C[..., 2, 0]],
        axis=-1,
    )


def strains(size: float, count: int = 12, seed: int = 5) -> Float:
    """(count,6) of random deformations: no two stretches alike, all six components."""
    rng = np.random.default_rng(seed)
    return green_lagrange(np.eye(3) + size * rng.uniform(-1.0, 1.0, (count, 3, 3)))


def differences(law: Law, strain: Float, state: Float | None, step: float) -> Float:
    """(P,6,6) derivative of the stress by central differences of fourth order."""

    def stress(component: int, factor: int) -> Float:
        moved = strain.copy()
        moved[:, component] += factor * step
        return law.update(moved, state, moduli=False).stress

    columns = [
        (8.0 * (stress(k, 1) - stress(k, -1)) - stress(k, 2) + stress(k, -2)) / (12.0 * step)
        for k in range(6)
    ]
    return np.stack(columns, axis=-1)


def check_moduli(law: Law, strain: Float, state: Float | None, step: float, rtol: float) -> None:
    """Moduli are symmetric and the derivative of the stress, relative to the stiffness."""
    found = law.update(strain, state, moduli=True).moduli
    assert found is not None
    found = np.broadcast_to(found, (len(strain), 6, 6))
    size = np.abs(law.stiffness()).max()
    assert np.isfinite(found).all()
    np.testing.assert_allclose(found, found.swapaxes(1, 2), rtol=0, atol=1e-13 * size)
    expected = differences(law, strain, state, step)
    np.testing.assert_allclose(found, expected, rtol=0, atol=rtol * size)


def check_energy(law: Law, strain: Float, state: Float | None, step: float, rtol: float) -> None:
    """Stress is the derivative of the energy that the law tells; there is none at rest."""

    def slope(component: int) -> Float:
        moved = np.zeros((4, *strain.shape))
        moved[..., component] = step * np.array([2.0, 1.0, -1.0, -2.0])[:, None]
        states = None if state is None else np.broadcast_to(state, (4, *state.shape))
        energy = results_of(law, strain + moved, states)["energy"]
        return np.asarray(np.array([-1.0, 8.0, -8.0, 1.0]) @ energy / (12.0 * step))

    stress = law.update(strain, state, moduli=False).stress
    expected = np.stack([slope(k) for k in range(6)], axis=-1)
    np.testing.assert_allclose(stress, expected, rtol=0, atol=rtol * np.abs(stress).max())
    rest = None if state is None else np.zeros_like(state)
    assert not results_of(law, np.zeros_like(strain), rest)["energy"].any()


def check_law(law: Law, strain: Float) -> None:
    """All that `gpusim.fem.Law` promises, at strains (P,6) from rest."""
    assert isinstance(law, Law)
    count, size = len(strain), law.state_size
    state = np.zeros((count, size)) if size else None
    stiffness, scale = law.stiffness(), np.abs(law.stiffness()).max()
    rest = law.update(np.zeros((count, 6)), state, moduli=True)
    assert rest.moduli is not None
    off = np.broadcast_to(rest.moduli, (count, 6, 6)) - stiffness
    np.testing.assert_allclose(off, 0.0, rtol=0, atol=1e-14 * scale)
    assert not np.any(rest.stress)
    given = strain.copy()
    whole = law.update(strain, state, moduli=True)
    np.testing.assert_array_equal(strain, given)  # nothing that was given is changed
    assert state is None or not state.any()
    assert whole.stress.shape == (count, 6)
    assert np.isfinite(whole.stress).all()
    assert (whole.state is None) == (size == 0)
    assert whole.state is None or whole.state.shape == (count, size)
    # the same without moduli, and in another shape
    forces = law.update(strain, state, moduli=False)
    assert forces.moduli is None
    np.testing.assert_array_equal(forces.stress, whole.stress)
    shaped = strain.reshape(count // 2, 2, 6)
    nested = None if state is None else state.reshape(count // 2, 2, size)
    again = law.update(shaped, nested, moduli=True)
    np.testing.assert_array_equal(again.stress.reshape(count, 6), whole.stress)
    assert again.moduli is not None and whole.moduli is not None
    assert again.moduli.shape in ((6, 6), (*shaped.shape, 6))
    np.testing.assert_array_equal(again.moduli.reshape(whole.moduli.shape), whole.moduli)
    if whole.state is not None and again.state is not None:
        assert again.state.shape == (count // 2, 2, size)
        np.testing.assert_array_equal(again.state.reshape(count, size), whole.state)


def check_potential(
    law: Law, energy: Callable[[Float, Float], Float], strain: Float, atol: float
) -> None:
    """The stress is the slope of an ``energy`` of trace and determinant of C = 1 + 2 E, by
    differences of fourth order."""

    def of_strain(strain: Float) -> Float:
        xx, yy, zz, xy, yz, zx = np.moveaxis(strain, -1, 0)
        C = 2.0 * np.array([[xx, xy / 2, zx / 2], [xy / 2, yy, yz / 2], [zx / 2, yz / 2, zz]])
        C = np.moveaxis(C, (0, 1), (-2, -1)) + np.eye(3)
        return energy(np.trace(C, axis1=-2, axis2=-1), np.linalg.det(C))

    moved = 1e-3 * np.eye(6)[:, None]
    slope = 8.0 * (of_strain(strain + moved) - of_strain(strain - moved))
    slope += of_strain(strain - 2.0 * moved) - of_strain(strain + 2.0 * moved)
    stress = law.update(strain, None, moduli=False).stress
    np.testing.assert_allclose(stress, slope.T / 12e-3, rtol=0, atol=atol)
