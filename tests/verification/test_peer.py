"""The same mesh, loads and supports in CalculiX: the same displacements, digit for digit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gpusim.fem import solve
from tests.support import calculix
from tests.support.verification_models import Problem, cook_membrane, elliptic_plate, slender_beam

# Incompatible modes come in variants, which agree on parallelepipeds only.
ON_DISTORTED_CELLS = [case for case in calculix.ELEMENT if case != ("hex8", "incompatible")]


def worst(problem: Problem, formulation: str, folder: Path) -> float:
    """Greatest difference of any displacement, relative to the greatest of its load case."""
    solution = solve(problem.model, backend="numpy", formulation=formulation, tolerance=1e-8)
    assert solution.converged
    theirs = calculix.run(problem.model, formulation, folder).u
    ours = solution.u.reshape(theirs.shape)
    scale = np.abs(theirs).max(axis=(1, 2))
    return float((np.abs(ours - theirs).max(axis=(1, 2)) / scale).max())


@pytest.mark.parametrize(("kind", "formulation"), calculix.ELEMENT)
def test_slender_beam(kind: str, formulation: str, tmp_path: Path) -> None:
    across = 2 if formulation == "reduced" else 1
    assert worst(slender_beam(kind, "rectangular", across), formulation, tmp_path) <= 1e-6


@pytest.mark.parametrize(("kind", "formulation"), ON_DISTORTED_CELLS)
def test_distorted_slender_beam(kind: str, formulation: str, tmp_path: Path) -> None:
    across = 2 if formulation == "reduced" else 1
    assert worst(slender_beam(kind, "trapezoidal", across), formulation, tmp_path) <= 1e-6


@pytest.mark.parametrize(("kind", "formulation"), ON_DISTORTED_CELLS)
def test_curved_plate(kind: str, formulation: str, tmp_path: Path) -> None:
    problem = elliptic_plate(kind, (3, 4, 2), thick=True)
    assert worst(problem, formulation, tmp_path) <= 1e-6


def test_tapered_membrane(tmp_path: Path) -> None:
    assert worst(cook_membrane("hex20", 4), "reduced", tmp_path) <= 1e-6


def test_the_two_kinds_of_incompatible_modes_differ_on_distorted_cells(tmp_path: Path) -> None:
    """So that nobody takes the agreement on bricks for agreement everywhere."""
    difference = worst(slender_beam("hex8", "trapezoidal"), "incompatible", tmp_path)
    assert 1e-3 < difference < 0.2
