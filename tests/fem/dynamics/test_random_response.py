"""Random response: integrals against closed forms, RMS of stress, a benchmark, wrong spectra."""

from __future__ import annotations

import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError
from gpusim.fem import RandomResponse
from tests.fem.dynamics.test_harmonic import deep_beam

BAR = gs.mesh.box(size=(1.0, 0.1, 0.12), divisions=(5, 1, 1))
HELD = np.isclose(BAR.points[:, :1], 0.0).repeat(3, axis=1)
STEEL = gs.Isotropic(210e9, 0.3, density=7850.0)
FORCE = np.random.default_rng(0).normal(size=BAR.points.shape)
MODEL = gs.Model(BAR, STEEL, HELD, FORCE)


def integral(one: complex, other: complex, low: float, high: float, power: int) -> float:
    """Of omega^power / (one's dynamic stiffness times the conjugate of the other's), from ``low``
    to ``high`` rad/s, by partial fractions; each is given by its pole with positive parts."""
    poles = np.array([one, -one.conjugate(), other.conjugate(), -other])
    apart = poles[:, None] - poles
    residues = poles**power / np.prod(apart, axis=1, where=~np.eye(4, dtype=bool))
    return float((residues * (np.log(high - poles) - np.log(low - poles))).sum().real)


@pytest.mark.parametrize("ratio", [1e-4, 0.02, 0.5])
@pytest.mark.parametrize("slope", [0, 2])
def test_the_covariance_of_modes_is_their_closed_form(ratio: float, slope: int) -> None:
    band = np.array([20.0, 700.0])
    found = gs.random_response(
        MODEL, (band, 3.0 * band**slope), damping=gs.ModalDamping(ratio), count=6
    )
    count = 4
    known = gs.modes(MODEL, 6)
    angular, forcing = known.angular[:count], np.tensordot(known.shapes[:count], FORCE, axes=2)
    poles = angular * (np.sqrt(1.0 - ratio**2) + 1j * ratio)
    low, high = 2.0 * np.pi * band
    for i in range(count):
        for j in range(count):
            whole = integral(poles[i], poles[j], low, high, slope) / (2.0 * np.pi) ** (slope + 1)
            expected = 3.0 * forcing[i] * forcing[j] * whole
            size = np.sqrt(found.covariance[i, i] * found.covariance[j, j])
            turned = np.sign(np.vdot(found.shapes[i], known.shapes[i]))
            turned *= np.sign(np.vdot(found.shapes[j], known.shapes[j]))
            assert abs(turned * found.covariance[i, j] - expected) <= 1e-9 * size


def test_one_resonance_under_white_noise() -> None:
    """pi/2 f Q S: S0 / (8 zeta omega^3) of a mode, in a band that is wide enough."""
    found = gs.random_response(
        MODEL, ([1e-3, 4000.0], [2.0, 2.0]), damping=gs.ModalDamping(1e-5), count=12
    )
    known = gs.modes(MODEL, 1)
    forcing = np.vdot(known.shapes[0], FORCE)
    expected = 2.0 * forcing**2 / (8.0 * 1e-5 * known.angular[0] ** 3)
    assert abs(found.covariance[0, 0] / expected - 1.0) <= 1e-4


def shaken() -> RandomResponse:
    """With a spectrum of several slopes, on fine steps."""
    spectrum = ([20.0, 80.0, 350.0, 700.0], [0.5, 2.0, 2.0, 0.3])
    return gs.random_response(
        MODEL, spectrum, damping=gs.Rayleigh(10.0, 2e-5), base=(0.0, 1.0, 0.5), count=12,
        frequencies=np.linspace(20.0, 700.0, 6801),
    )  # fmt: skip


def test_rms_are_areas_under_densities() -> None:
    found = shaken()
    for density, rms in ((found.psd, found.rms), (found.stress_psd, found.stress_rms)):
        area = np.sqrt(np.trapezoid(density, found.frequencies, axis=0))
        assert np.abs(area - rms).max() <= 1e-5 * rms.max() > 0.0
    between = found.excitation[np.searchsorted(found.frequencies, [40.0, 500.0])]
    assert abs(between[0] - 1.0) <= 1e-12
    assert abs(between[1] - 2.0 * (500.0 / 350.0) ** (np.log(0.15) / np.log(2.0))) <= 1e-12


def test_densities_are_those_of_the_harmonic_response() -> None:
    found, some = shaken(), [0, 640, 6000]
    steady = gs.harmonic(
        MODEL, found.frequencies[some], damping=gs.Rayleigh(10.0, 2e-5), base=(0, 1, 0.5), count=12
    )
    expected = found.excitation[some, None, None] * steady.amplitude**2
    assert np.abs(found.psd[some] - expected).max() <= 1e-9 * expected.max()
    stress = [gs.fem.stress(MODEL, steady.at(1, turn)).nodal for turn in (0.0, 0.5 * np.pi)]
    expected = found.excitation[640] * (stress[0] ** 2 + stress[1] ** 2)
    assert np.abs(found.stress_psd[640] - expected).max() <= 1e-9 * expected.max()


def test_von_mises_rms_is_that_of_samples() -> None:
    """Of 20,000 Gaussian states with the covariance."""
    found = shaken()
    draws = np.random.default_rng(1).multivariate_normal(
        np.zeros(len(found.covariance)), found.covariance, size=20_000, method="svd"
    )
    states = np.tensordot(draws, found.stress_shapes[:, :6], axes=1)
    sampled = np.sqrt((gs.fem.von_mises(states) ** 2).mean(axis=0))
    assert np.abs(sampled / found.von_mises_rms[:6] - 1.0).max() <= 0.02


def test_where_materials_meet_the_greater_stress_counts() -> None:
    half = (np.arange(BAR.cell_count) >= 2).astype(np.int32)
    soft = gs.Isotropic(70e9, 0.3, density=2700.0)
    model = gs.Model(BAR, [STEEL, soft], HELD, FORCE, material_of_cell=half)
    found = gs.random_response(model, ([10, 90], [1, 1]), damping=gs.ModalDamping(0.02), count=6)
    border = np.isclose(BAR.points[:, 0], 0.4)
    sides = [
        np.stack([gs.fem.stress(model, u).of_material(k) for u in found.shapes]) for k in (0, 1)
    ]
    form = np.diag([1.0, 1.0, 1.0, 3.0, 3.0, 3.0])
    form[:3, :3] -= 0.5 * (1.0 - np.eye(3))
    of_side = [
        np.sqrt(np.einsum("inc,cd,ij,jnd->n", one, form, found.covariance, one, optimize=True))
        for one in (side[:, border] for side in sides)
    ]
    assert (of_side[0] != of_side[1]).all()
    assert np.allclose(found.von_mises_rms[border], np.maximum(*of_side), rtol=1e-12)


def test_nafems_5r() -> None:
    """Peak density of the displacement at mid span 180.90 mm^2/Hz at 42.65 Hz, under a load with
    (1e6 N/m)^2/Hz."""
    model, frequencies = deep_beam(), np.linspace(42.0, 43.4, 141)
    found = gs.random_response(
        model, ([1.0, 200.0], [1.0, 1.0]), damping=gs.ModalDamping(0.02), count=12,
        frequencies=frequencies,
    )  # fmt: skip
    middle = np.flatnonzero((model.mesh.points == [5.0, 1.0, 0.0]).all(axis=1))[0]
    density = found.psd[:, middle, 1]
    assert abs(frequencies[np.argmax(density)] / 42.65 - 1.0) <= 0.005
    assert abs(density.max() / 180.90e-6 - 1.0) <= 0.005


@pytest.mark.parametrize(
    "psd",
    [
        ([10.0, 20.0], [1.0, np.nan]),
        ([10.0, 20.0], [1.0, 0.0]),
        ([0.0, 20.0], [1.0, 1.0]),
        ([20.0, 10.0], [1.0, 1.0]),
        ([10.0, 10.0], [1.0, 1.0]),
        ([10.0], [1.0]),
        [10.0, 20.0],
        ([10.0, 20.0], [1.0]),
        "white",
    ],
)
def test_wrong_spectra(psd: object) -> None:
    with pytest.raises(InputError, match="psd"):
        gs.random_response(MODEL, psd, damping=gs.ModalDamping(0.02))  # type: ignore[arg-type]


def test_what_is_refused() -> None:
    flat = ([10.0, 100.0], [1.0, 1.0])
    for damping in (None, 0.02):
        with pytest.raises(InputError, match="damping"):
            gs.random_response(MODEL, flat, damping=damping)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="leaves mode 2 undamped"):
        gs.random_response(MODEL, flat, damping=gs.ModalDamping([0.02, 0.0]))
    with pytest.raises(InputError, match="base"):
        gs.random_response(MODEL, flat, damping=gs.ModalDamping(0.02), base=(0, np.inf, 0))
    with pytest.raises(InputError, match="random_response count"):
        gs.random_response(MODEL, ([10, 90], [1, 1]), damping=gs.ModalDamping(0.02), count=0)
    with pytest.raises(InputError, match=r"random response: psd; got .*beyond 4 modes that lack"):
        gs.random_response(MODEL, ([10, 1e5], [1, 1]), damping=gs.ModalDamping(0.02), count=4)
    with pytest.raises(InputError, match="frequencies"):
        gs.random_response(MODEL, flat, damping=gs.ModalDamping(0.02), frequencies=[np.nan])
