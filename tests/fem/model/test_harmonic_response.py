"""Instants of a harmonic motion, and the motion of its base."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError
from gpusim.fem import HarmonicResponse

BAR = gs.mesh.box(size=(3.0, 1.0, 2.0), divisions=(3, 1, 2))
MODEL = gs.Model(BAR, gs.Isotropic(50.0, 0.3, density=2.0))
FREQUENCIES = np.array([0.5, 2.0])
TOLD: dict[str, Any] = {"unknowns": 72, "method": "modal", "timings": {}, "model": MODEL}


def response(base: np.ndarray | None = None) -> HarmonicResponse:
    random = np.random.default_rng(3)
    shapes = random.normal(size=(4, BAR.node_count, 3))
    coordinates = random.normal(size=(2, 4)) + 1j * random.normal(size=(2, 4))
    return HarmonicResponse(FREQUENCIES, coordinates, shapes, np.zeros(2), base, **TOLD)


@pytest.mark.parametrize("phase", [0.0, 0.7, -2.0])
def test_an_instant_is_the_real_part(phase: float) -> None:
    found = response()
    expected = np.real(found.u[1] * np.exp(1j * phase))
    assert np.abs(found.at(1, phase) - expected).max() <= 1e-14
    assert np.abs(found.amplitude * np.exp(1j * found.phase) - found.u).max() <= 1e-14


def test_velocity_is_the_slope_in_time() -> None:
    found, step = response(), 1e-4
    later, earlier = (found.at(1, 0.3 + 2.0 * np.pi * 2.0 * dt) for dt in (step, -step))
    slope = (later - earlier) / (2.0 * step)
    assert np.abs(found.velocity(1, 0.3) - slope).max() <= 1e-5 * np.abs(slope).max()


def test_the_base_moves_against_its_acceleration() -> None:
    base = np.array([1.0, 2.0j, 0.0])
    relative = response(base)
    moved = relative.absolute()
    angular = 2.0 * np.pi * FREQUENCIES[:, None, None]
    assert np.abs((moved.u - relative.u) * -(angular**2) - base).max() <= 1e-12
    assert moved.absolute() is moved


def test_what_is_refused() -> None:
    with pytest.raises(InputError, match=r"frequency number; got 2; expected 0 … 1"):
        response().at(2)
    with pytest.raises(InputError, match="phase"):
        response().velocity(0, np.nan)
    standing = HarmonicResponse(
        np.array([0.0]), np.ones((1, 1), complex), np.zeros((1, 4, 3)), np.zeros(1),
        np.ones(3, complex), **TOLD,
    )  # fmt: skip
    with pytest.raises(InputError, match="0 Hz"):
        standing.absolute()
