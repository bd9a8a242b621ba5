"""Transposed modes: no buckling under pressure, and what they remember."""

from __future__ import annotations

import numpy as np
import pytest

from gpusim.errors import NotConverged
from gpusim.fem.elements.element_response import Want
from gpusim.fem.elements.enhanced_modes import EnhancedModes
from tests.support.element_responses import (
    E,
    Float,
    Law,
    SaintVenantKirchhoff,
    Update,
    elements,
    motion_of,
    settle,
    single,
)
from tests.support.stability_block import lowest_of_pressed_block

FORM = "finite", "hex8", "incompatible"
ONE = np.array([0])


def test_a_block_pressed_through_its_thickness_is_stable() -> None:
    for aspect in (20, 100):
        for strain in (0.003, 0.03, 0.15, 0.3):
            assert lowest_of_pressed_block(FORM, aspect, strain) >= -1e-7 * E
    # the body's own loss is seen
    assert lowest_of_pressed_block(FORM, 1, 0.5) < -1e-3 * E


def element(law: Law | None = None) -> tuple[EnhancedModes, Float, Float]:
    nodes = single("hex8")
    own = elements(FORM, nodes, np.arange(8)[None], law)
    assert isinstance(own, EnhancedModes)
    return own, nodes, motion_of(nodes)


def test_modes_come_to_rest_where_their_forces_vanish() -> None:
    """Energy is least there: a third route to the modes, by the nodes' forces alone."""
    own, _, u = element()
    settle(own, u)
    rest = own.snapshot().modes
    assert rest is not None and np.abs(rest).max() > 1e-3
    forces = own.response(ONE, u, Want.FORCES)[0]
    rng = np.random.default_rng(0)
    # forces left after condensation don't depend on the modes, to first order
    gaps = []
    direction = rng.normal(size=9)
    for size in (1e-3, 5e-4):
        internal = own.snapshot()
        assert internal.modes is not None
        internal.modes[:] += size * direction
        own.restore(internal)
        gaps.append(np.abs(own.response(ONE, u, Want.FORCES)[0] - forces).max())
        internal.modes[:] = rest
        own.restore(internal)
    assert gaps[0] > 1e-6 and gaps[0] / gaps[1] == pytest.approx(4.0, rel=0.05)


def test_a_step_moves_modes_and_a_cut_back_sets_them_back() -> None:
    own, _, u = element()
    before = own.snapshot()
    first = own.response(ONE, u, Want.TANGENT)
    own.advance(ONE, u, 0.1 * u, True)
    moved = own.snapshot()
    assert before.modes is not None and moved.modes is not None
    assert np.abs(before.modes).max() == 0.0 and np.abs(moved.modes).max() > 1e-3
    own.restore(before)
    again = own.response(ONE, u, Want.TANGENT)
    np.testing.assert_array_equal(first[0], again[0])
    np.testing.assert_array_equal(first[1], again[1])
    # a snapshot isn't what moves on
    own.advance(ONE, u, 0.1 * u, False)
    assert np.abs(before.modes).max() == 0.0


def test_modes_without_stiffness_are_told() -> None:
    class Nothing(SaintVenantKirchhoff):
        def update(self, strain: Float, state: Float | None, *, moduli: bool) -> Update:
            return Update(0.0 * strain, np.zeros((6, 6)), None)

    own, _, u = element(Nothing())
    with pytest.raises(NotConverged, match="singular"):
        own.response(ONE, u, Want.TANGENT)
