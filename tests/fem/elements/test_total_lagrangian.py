"""Elements at finite strain: stress at points, heat, and the law's history."""

from __future__ import annotations

import numpy as np
import pytest

from gpusim.fem.elements.element import ELEMENTS
from gpusim.fem.elements.element_response import Want
from tests.support.element_responses import (
    FORMS,
    HEXAHEDRA,
    ROTATION,
    E,
    Flowing,
    SaintVenantKirchhoff,
    elements,
    settle,
    single,
    tensors,
)

Form = tuple[str, str, str]
FINITE = [form for form in FORMS if form[0] == "finite"]
PLASTIC = [form for form in HEXAHEDRA if form[0] == "finite"]
ONE = np.array([0])
STRETCH = np.array([[1.2, 0.1, 0.0], [0.1, 0.8, -0.05], [0.0, -0.05, 1.1]])


@pytest.mark.parametrize("form", FINITE)
def test_point_values_of_a_homogeneous_deformation(form: Form) -> None:
    nodes = single(form[1])
    own = elements(form, nodes, np.arange(len(nodes))[None])
    gradient = ROTATION @ STRETCH
    u = nodes @ gradient.T + [1.0, 2.0, 3.0] - nodes
    settle(own, u)
    values = own.point_values(ONE, u)
    green = 0.5 * (STRETCH @ STRETCH - np.eye(3))
    np.testing.assert_allclose(tensors(values.strain, 0.5)[0] - green, 0.0, atol=1e-13)
    lame, mu = (SaintVenantKirchhoff().stiffness()[i] for i in ((0, 1), (3, 3)))
    piola = lame * np.trace(green) * np.eye(3) + 2.0 * mu * green
    np.testing.assert_allclose(tensors(values.piola)[0] - piola, 0.0, atol=1e-10)
    cauchy = gradient @ piola @ gradient.T / np.linalg.det(gradient)
    np.testing.assert_allclose(tensors(values.cauchy)[0] - cauchy, 0.0, atol=1e-10)
    extent = np.abs(np.linalg.eigvalsh(STRETCH) - 1.0).max()
    assert own.strain_extent(ONE, u) == pytest.approx([extent], rel=1e-9)
    assert values.volume.shape == (1, len(ELEMENTS[form[1]].rule(form[2]).weight))


@pytest.mark.parametrize("form", FINITE)
def test_a_cell_free_to_expand_has_no_stress(form: Form) -> None:
    nodes = single(form[1])
    points = len(ELEMENTS[form[1]].rule(form[2]).weight)
    heat = STRETCH - np.eye(3)
    voigt = [*np.diag(heat), *(2.0 * heat[i, j] for i, j in ((0, 1), (1, 2), (2, 0)))]
    free = np.broadcast_to(voigt, (1, points, 6))
    own = elements(form, nodes, np.arange(len(nodes))[None], free=free)
    u = nodes @ (ROTATION @ STRETCH).T - nodes
    settle(own, u)
    assert np.abs(own.response(ONE, u, Want.FORCES)[0]).max() <= 1e-11 * E
    held = own.response(ONE, np.zeros_like(u), Want.FORCES)[0]
    assert np.abs(held).max() > 1e-2 * E
    own.free_strain = None
    assert np.abs(own.response(ONE, u, Want.FORCES)[0]).max() > 1e-2 * E


@pytest.mark.parametrize("form", PLASTIC)
def test_history_is_committed_and_set_back(form: Form) -> None:
    nodes = single("hex8")
    own = elements(form, nodes, np.arange(8)[None], Flowing())
    rest = np.zeros_like(nodes)
    pulled = nodes * [0.05, 0.0, 0.0]
    start = own.snapshot()

    def left() -> float:
        """Force of the cell put back to where it was."""
        modes = own.snapshot()
        settle(own, rest)
        force = float(np.abs(own.response(ONE, rest, Want.FORCES)[0]).max())
        own.restore(modes)
        return force

    own.response(ONE, pulled, Want.TANGENT)
    # what is tried leaves no trace, however often
    assert left() == 0.0
    own.response(ONE, 2.0 * pulled, Want.TANGENT)
    first = own.response(ONE, pulled, Want.FORCES)[0]
    own.commit(pulled)
    assert left() > 0.1
    # at the committed strain nothing flows again
    np.testing.assert_allclose(own.response(ONE, pulled, Want.FORCES)[0], first, atol=1e-12 * E)
    stress = own.point_values(ONE, pulled).piola
    deviator = tensors(stress) - np.eye(3) * stress[..., :3].mean(axis=2)[..., None, None]
    state = own.snapshot().state
    assert state is not None and state.shape == (1, 8, 7)
    limit = Flowing.yield_stress + Flowing.hardening * state[..., 6]
    np.testing.assert_allclose(np.sqrt(1.5 * (deviator**2).sum(axis=(2, 3))), limit, rtol=1e-9)
    committed = own.snapshot()
    own.response(ONE, 2.0 * pulled, Want.FORCES)
    own.commit(2.0 * pulled)
    assert own.snapshot().state[..., 6].min() > state[..., 6].max()  # type: ignore[index]
    own.restore(committed)
    np.testing.assert_array_equal(own.snapshot().state, state)
    own.restore(start)
    assert left() == 0.0


def test_elements_that_were_not_asked_keep_their_state() -> None:
    nodes = np.concatenate([single("hex8"), single("hex8") + np.array([2.0, 0.0, 0.0])])
    own = elements(PLASTIC[1], nodes, np.arange(16).reshape(2, 8), Flowing())
    u = nodes * [0.05, 0.0, 0.0]
    own.response(np.array([1]), u, Want.FORCES)
    own.commit(u)
    state = own.snapshot().state
    assert state is not None
    assert np.abs(state[0]).max() == 0.0 and state[1, :, 6].min() > 0.0


def test_laws_with_a_history_foretell_nothing() -> None:
    nodes = single("hex8")
    own = elements(PLASTIC[1], nodes, np.arange(8)[None], Flowing())
    u = nodes * [0.05, 0.0, 0.0]
    expected = own.response(ONE, 2.0 * u, Want.TANGENT)[1]
    own.response(ONE, u, Want.TANGENT)
    own.advance(ONE, u, u, True)
    np.testing.assert_array_equal(own.response(ONE, 2.0 * u, Want.TANGENT)[1], expected)
