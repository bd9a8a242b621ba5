"""Hardening curves: values, slopes, the equation of the return mapping, refusals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from gpusim.errors import InputError
from gpusim.fem import J2, Isotropic, Voce
from gpusim.fem.materials.hardening import Hardening, flow_curve

STEEL = Isotropic(206.9e3, 0.29)
TABLE = ((0.0, 450.0), (0.01, 450.0), (0.02, 520.0), (0.1, 700.0))
KINDS: list[Hardening] = [0.0, 1.5e3, TABLE, Voce(715.0, 16.93, 129.24), Voce(450.0, 1e3)]


def test_saturating_exponential() -> None:
    """Simo & Hughes' constants for a necking bar."""
    p = np.array([0.0, 0.05, 10.0])
    stress, slope = flow_curve(450.0, Voce(715.0, 16.93, 129.24)).stress_and_slope(p)
    fade = np.exp(-0.8465)
    expected = [450.0, 450.0 + 6.462 + 265.0 * (1.0 - fade), 715.0 + 1292.4]
    np.testing.assert_allclose(stress, expected, rtol=1e-14)
    slopes = [129.24 + 265.0 * 16.93, 129.24 + 265.0 * 16.93 * fade, 129.24]
    np.testing.assert_allclose(slope, slopes, rtol=1e-14)


def test_table_is_straight_between_points_and_constant_beyond() -> None:
    p = np.array([0.0, 0.005, 0.015, 0.06, 0.1, 3.0])
    stress, slope = flow_curve(450.0, TABLE).stress_and_slope(p)
    np.testing.assert_allclose(stress, np.interp(p, *np.array(TABLE).T), rtol=1e-15)
    np.testing.assert_allclose(slope, [0.0, 0.0, 7e3, 2250.0, 0.0, 0.0], rtol=1e-13)


@pytest.mark.parametrize("hardening", KINDS, ids=repr)
def test_increments_end_on_the_curve(hardening: Hardening) -> None:
    """Trial stresses from just above the curve to a hundred times it, from any plastic strain."""
    curve, stiffness = flow_curve(450.0, hardening), 240e3
    p, over = np.meshgrid([0.0, 1e-3, 0.01, 0.0199, 0.07, 0.5], [1e-9, 1e-3, 0.1, 1.0, 100.0])
    p, over = p.ravel(), over.ravel()
    trial = curve.stress_and_slope(p)[0] * (1.0 + over)
    step = curve.increment(trial, p, stiffness)
    assert (step >= 0.0).all()
    end = curve.stress_and_slope(p + step)[0]
    np.testing.assert_allclose(trial - stiffness * step, end, rtol=0, atol=1e-13 * trial.max())
    assert (step[over >= 1e-3] > 0.0).all()


@pytest.mark.parametrize(
    ("hardening", "words"),
    [
        (-1.0, "J2: hardening out of range; got -1.0; expected a number >= 0"),
        (np.nan, "J2: hardening out of range; got nan"),
        (True, "J2: hardening; got True"),
        ("steep", "J2: hardening; got 'steep'"),
        (None, "J2: hardening; got None; expected a number, a Voce or pairs"),
        ([], r"J2: hardening; got .*; expected a number, a Voce or pairs of plastic"),
        ([(0.0, 450.0, 1.0)], r"J2: hardening; got .*; expected a number, a Voce or pairs"),
        ([(0.0, 450.0), (0.1, np.inf)], "J2: hardening; got .*; expected a number, a Voce or"),
        ([(0.1, 450.0)], r"the first pair; got \(0\.1, 450\.0\); expected \(0\.0, 450\.0\), the"),
        ([(0.0, 451.0)], r"the first pair; got \(0\.0, 451\.0\); expected \(0\.0, 450\.0\)"),
        (
            [(0.0, 450.0), (0.2, 500.0), (0.2, 510.0)],
            "plastic strains; got a step of 0 after pair 1; expected rising ones",
        ),
        (
            [(0.0, 450.0), (0.2, 500.0), (0.3, 490.0)],
            "yield stresses; got a step of -10 after pair 1; expected ones that don't fall",
        ),
        (
            np.ma.masked_equal([(0.0, 450.0), (0.2, 500.0)], 500.0),
            "J2 hardening: masked; got an array with masked values",
        ),
        (Voce(449.0, 1.0), "saturation below the yield stress; got 449.0; expected at least 450"),
    ],
)
def test_what_is_no_hardening_is_refused(hardening: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        J2(STEEL, 450.0, hardening)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"saturation": 0.0}, "Voce: saturation out of range; got 0.0; expected a number > 0"),
        ({"rate": -1.0}, "Voce: rate out of range; got -1.0; expected a number > 0"),
        ({"linear": -1.0}, "Voce: linear out of range; got -1.0; expected a number >= 0"),
        ({"rate": "fast"}, "Voce: rate; got 'fast'; expected a number > 0"),
    ],
)
def test_wrong_constants_of_voce_are_refused(change: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=f"^{words}"):
        Voce(**{"saturation": 700.0, "rate": 10.0, **change})
