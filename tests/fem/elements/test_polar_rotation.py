"""Rotations against SciPy's polar decomposition, and small ones against their series."""

from __future__ import annotations

import numpy as np
from scipy.linalg import polar

from gpusim.fem.elements.polar_rotation import polar_rotation


def test_the_rotation_is_that_of_scipy_whatever_the_stretch() -> None:
    generator = np.random.default_rng(0)
    turns = np.linalg.qr(generator.normal(size=(40, 3, 3)))[0]
    turns *= np.linalg.det(turns)[:, None, None]
    sides = np.exp(generator.uniform(-3.0, 3.0, (40, 3)))
    axes = np.linalg.qr(generator.normal(size=(40, 3, 3)))[0]
    gradients = turns @ (axes * sides[:, None]) @ axes.transpose(0, 2, 1)
    gradients[0] = np.diag([-1.0, -1.0, 1.0])  # half a turn
    found = polar_rotation((gradients - np.eye(3)).transpose(1, 2, 0)) + np.eye(3)[..., None]
    for number, gradient in enumerate(gradients):
        np.testing.assert_allclose(found[..., number], polar(gradient)[0], rtol=0, atol=2e-13)


def test_small_rotations_keep_their_digits() -> None:
    slope = np.random.default_rng(1).normal(size=(3, 3, 20)) * np.geomspace(1e-14, 1e-6, 20)
    size = np.abs(slope).max(axis=(0, 1))
    # R - 1 of 1 + H is W + (W^2 - W S - S W) / 2 + O(H^3): here of its antisymmetric part W
    skew = 0.5 * (slope - slope.swapaxes(0, 1))
    stretch = slope - skew

    def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.einsum("ijm,jkm->ikm", a, b)

    second = 0.5 * (product(skew, skew) - product(skew, stretch) - product(stretch, skew))
    error = np.abs(polar_rotation(slope) - skew - second).max(axis=(0, 1))
    assert (error <= 1e-15 * size + 10.0 * size**3).all()


def test_no_motion_is_no_rotation() -> None:
    np.testing.assert_array_equal(polar_rotation(np.zeros((3, 3, 2))), np.zeros((3, 3, 2)))
