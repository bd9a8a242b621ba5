"""Heat at finite strain: stress, moduli and history are those of the body that has expanded."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.errors import NotConverged
from gpusim.fem.elements.heated_material import HeatedMaterial
from tests.support.element_responses import ROTATION, elements, single, tensors

Float = npt.NDArray[np.float64]
RANDOM = np.random.default_rng(3)
# what fibres and matrix do, along axes of their own
FREE = np.array([[[0.05, -0.02, 0.03, 0.01, 0.02, -0.03], [0.03, 0.03, 0.03, 0.0, 0.0, 0.0]]])
U = np.eye(3) + tensors(FREE, 0.5)
ELASTIC = ROTATION @ (np.eye(3) + 0.02 * RANDOM.normal(size=(1, 2, 3, 3)))
LAWS = [
    gs.SaintVenantKirchhoff(200.0, 0.3),
    gs.NeoHookean(200.0, 0.3),
    gs.J2(gs.Isotropic(200.0, 0.3), 2.0, 20.0),
]


def green(gradient: Float) -> Float:
    """(…,6) engineering shear."""
    full = 0.5 * (gradient.swapaxes(-1, -2) @ gradient - np.eye(3))
    return full[..., [0, 1, 2, 0, 1, 2], [0, 1, 2, 1, 2, 0]] * [1, 1, 1, 2, 2, 2]


def cauchy(gradient: Float, stress: Float) -> Float:
    ratio = np.linalg.det(gradient)[..., None, None]
    return np.asarray(gradient @ tensors(stress) @ gradient.swapaxes(-1, -2) / ratio)


@pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__)
def test_stress_and_history_are_those_of_the_body_that_has_expanded(law: gs.fem.Law) -> None:
    state = np.zeros((1, 2, law.state_size)) if law.state_size else None
    warm = HeatedMaterial(law, FREE).update(green(ELASTIC @ U), state, moduli=False)
    cold = law.update(green(ELASTIC), state, moduli=False)
    expected = cauchy(ELASTIC, cold.stress)
    assert np.abs(expected).max() > 1.0
    np.testing.assert_allclose(cauchy(ELASTIC @ U, warm.stress), expected, rtol=0, atol=1e-12)
    if cold.state is not None:
        assert cold.state[..., 6].min() > 1e-3
        np.testing.assert_allclose(warm.state, cold.state, rtol=0, atol=1e-14)  # type: ignore[arg-type]


@pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__)
def test_moduli_are_the_derivative_of_the_stress(law: gs.fem.Law) -> None:
    heat, step = HeatedMaterial(law, FREE), 1e-5
    state = np.zeros((1, 2, law.state_size)) if law.state_size else None
    strain = green(ELASTIC @ U)
    moduli = heat.update(strain, state, moduli=True).moduli
    assert moduli is not None
    for column, unit in enumerate(step * np.eye(6)):
        up, down = (heat.update(strain + d, state, moduli=False).stress for d in (unit, -unit))
        slope = (up - down) / (2.0 * step)
        assert np.abs(slope - moduli[..., column]).max() <= 1e-7 * np.abs(moduli).max()
    assert np.abs(moduli - moduli.swapaxes(2, 3)).max() <= 1e-14 * np.abs(moduli).max()


def test_a_body_free_to_expand_has_no_stress() -> None:
    for law in LAWS:
        state = np.zeros((1, 2, law.state_size)) if law.state_size else None
        stress = HeatedMaterial(law, FREE).update(green(ROTATION @ U), state, moduli=False).stress
        assert np.abs(stress).max() <= 1e-14 * 200.0


def test_hot_metal_held_lengthwise_flows_as_its_curve_says() -> None:
    # 1.8 % of heat in a bar whose length is held: the closed form in logarithmic strain
    bar = gs.mesh.box(size=(1, 1, 1), divisions=(1, 1, 1))
    fixed = np.zeros_like(bar.points, dtype=bool)
    fixed[:, 2] = True
    fixed[:, :2] = bar.points[:, :2] == 0.0
    metal = gs.J2(gs.Isotropic(210e3, 0.3, expansion=12e-6), 800.0, 8000.0)
    model = gs.Model(bar, metal, fixed, temperature=1500.0)
    solution = gs.fem.solve(model, geometry="nonlinear", tolerance=1e-10)
    found = solution.steps[-1].stress
    assert found is not None
    strain = np.log(1.018)
    flow = (strain - 800.0 / 210e3) / (1.0 + 8000.0 / 210e3)
    kirchhoff = 800.0 + 8000.0 * flow
    volume = np.exp(-kirchhoff / 210e3 * 0.4)
    np.testing.assert_allclose(found.nodal[:, 2], -kirchhoff / volume, rtol=1e-9)
    np.testing.assert_allclose(found.nodal_plastic_strain, flow, rtol=1e-9)
    assert np.abs(found.nodal[:, :2]).max() <= 1e-6


def test_what_shrinks_to_less_than_nothing_is_refused() -> None:
    nodes = single("tet4")
    own = elements(("finite", "tet4", "full"), nodes, np.arange(4)[None], LAWS[0])
    own.free_strain = np.array([[[-1.5, 0.0, 0.0, 0.0, 0.0, 0.0]]])
    with pytest.raises(
        NotConverged, match=r"tet4, free to expand: 1 cells .* volume of -0.5 times"
    ):
        own.point_values(np.array([0]), np.zeros_like(nodes))
