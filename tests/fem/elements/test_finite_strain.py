"""Strain measures against their definitions, small ones with all their digits."""

from __future__ import annotations

import numpy as np
import pytest

from gpusim.fem.elements.finite_strain import (
    green_lagrange,
    largest_principal_strain,
    strain_change,
    volume_change,
)
from tests.support.element_responses import Float, tensors


def slopes(size: float) -> tuple[Float, Float]:
    """(4,5,3,3) and as the functions take them."""
    matrices = size * np.random.default_rng(2).normal(size=(4, 5, 3, 3))
    return matrices, matrices.transpose(2, 3, 0, 1)


def test_strain_and_volume_are_those_of_the_gradient() -> None:
    matrices, slope = slopes(0.3)
    gradient = matrices + np.eye(3)
    expected = 0.5 * (gradient.swapaxes(2, 3) @ gradient - np.eye(3))
    np.testing.assert_allclose(tensors(green_lagrange(slope), 0.5), expected, atol=1e-14)
    ratio = np.linalg.det(gradient) - 1.0
    np.testing.assert_allclose(volume_change(slope), ratio, atol=1e-13)
    step, other = slopes(1e-7)
    change = 0.5 * (gradient.swapaxes(2, 3) @ step + step.swapaxes(2, 3) @ gradient)
    found = tensors(strain_change(gradient.transpose(2, 3, 0, 1), other), 0.5)
    np.testing.assert_allclose(found, change, atol=1e-20)


def test_small_ones_keep_their_digits() -> None:
    matrices, slope = slopes(1e-13)
    linear = 0.5 * (matrices + matrices.swapaxes(2, 3))
    np.testing.assert_allclose(tensors(green_lagrange(slope), 0.5), linear, rtol=0, atol=1e-25)
    trace = np.trace(matrices, axis1=2, axis2=3)
    np.testing.assert_allclose(volume_change(slope), trace, rtol=0, atol=1e-25)


@pytest.mark.parametrize("size", [1e-9, 0.05, 0.4])
def test_the_largest_principal_strain_is_that_of_the_stretch(size: float) -> None:
    matrices, slope = slopes(size)
    gradient = matrices + np.eye(3)
    singular = np.linalg.svd(gradient, compute_uv=False)
    expected = np.abs(singular - 1.0).max(axis=(1, 2))
    found = largest_principal_strain(green_lagrange(slope))
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=3e-16)


def test_equal_stretches_and_none() -> None:
    strain = np.zeros((3, 2, 6))
    strain[1, :, :3] = 0.5 * (1.2**2 - 1.0)
    strain[2, :, 1] = 0.5 * (0.7**2 - 1.0)
    np.testing.assert_allclose(largest_principal_strain(strain), [0.0, 0.2, 0.3], atol=1e-15)
