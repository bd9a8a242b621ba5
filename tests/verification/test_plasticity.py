"""J2 plasticity in bodies that flow unevenly, against solutions by one coordinate."""

from __future__ import annotations

import numpy as np
import pytest

from tests.support.element_meshes import mesh_of
from tests.support.plastic_cases import (
    INNER,
    MOMENTS,
    OUTER,
    PRESSURE,
    PRESSURES,
    SOFT,
    STEEL,
    WEAK,
    WIDENING,
    Slice,
    bar_errors,
    bent,
    curvatures,
    first_flow,
    pressed_tube,
    tube_under_pressure,
    widened_tube,
)
from tests.support.plastic_references import Tube

RINGS = [
    Slice("hex8", "incompatible", 40),
    Slice("hex20", "reduced", 20),
    Slice("tet10", "bbar", 40),
]
LAYERS = [
    Slice("hex8", "incompatible", 64),
    Slice("hex20", "reduced", 32),
    Slice("tet10", "bbar", 32),
]
BARS = [Slice("hex8", "incompatible", 3), Slice("hex8", "bbar", 3), Slice("hex20", "reduced", 3),
        Slice("tet10", "bbar", 3)]  # fmt: skip
TOLERANCE = 2e-3


@pytest.mark.parametrize("part", RINGS, ids=str)
def test_tube_under_pressure_and_what_stays_of_it(part: Slice) -> None:
    errors = tube_under_pressure(part)
    assert max(errors.values()) <= TOLERANCE, errors


@pytest.mark.parametrize("part", RINGS, ids=str)
def test_soft_tube_widened_by_nearly_a_third(part: Slice) -> None:
    assert abs(widened_tube(part, 3)) <= TOLERANCE


@pytest.mark.parametrize("part", LAYERS[:2], ids=str)
def test_plate_bent_past_yield_and_let_go(part: Slice) -> None:
    assert np.abs(bent(part, plate=True)).max() <= TOLERANCE


@pytest.mark.parametrize("part", LAYERS, ids=str)
def test_blade_bent_past_yield_let_go_and_bent_back(part: Slice) -> None:
    assert np.abs(bent(part, plate=False)).max() <= TOLERANCE


@pytest.mark.parametrize("part", BARS, ids=str)
def test_bar_pulled_and_pressed_time_and_again(part: Slice) -> None:
    mesh = mesh_of(part.kind, (3, 2, 2), amount=0.06)
    strains = [0.0008, 0.003, 0.02, 0.0195, 0.01, -0.01, -0.02, 0.03]
    assert np.abs(bar_errors(part, mesh, strains)).max() <= 1e-6


def test_the_references_are_what_they_are_taken_for() -> None:
    """The tube against Lame's elastic one, the blade against its closed curve; and all of them have
    flown."""
    tube = Tube(STEEL, INNER, OUTER)
    tube.step(1.0)
    lame = (1.0 + STEEL.nu) / STEEL.E * INNER / (OUTER**2 - INNER**2)
    lame *= (1.0 - 2.0 * STEEL.nu) * INNER**2 + OUTER**2
    assert tube.u[0] == pytest.approx(lame, rel=1e-4)
    tube, bore = pressed_tube(PRESSURES)
    assert bore[-3] > 1.1 * lame * PRESSURE and tube.p.max() > 1e-3
    soft = Tube(SOFT, INNER, OUTER)
    soft.step(bore=WIDENING)
    assert soft.p.min() > 0.01
    # M over the moment of first flow, of a blade of which the part beyond z flows
    slope = WEAK.H / (WEAK.E + WEAK.H)
    over = curvatures(plate=False)[:5] / (first_flow(False) / (WEAK.E * 8.0 / 12.0))
    closed = slope * over + (1.0 - slope) * (1.5 - 0.5 / over**2)
    assert closed[1:] == pytest.approx(np.array(MOMENTS[1:5]), rel=1e-4)
    assert curvatures(plate=True)[-1] > 0.2 * curvatures(plate=True)[-2]
