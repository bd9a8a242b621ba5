"""What is said of load paths: equilibria that aren't stable, doubtful strains and cells."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import gpusim as gs
from gpusim.fem import J2, FollowerPressure, Isotropic, Law, Model, NeoHookean, Solution, solve
from gpusim.mesh import box, quadratic, select_faces
from tests.support.nonlinear_cases import pressed_column


def large(model: Model, factors: object = None, **options: object) -> Solution:
    return solve(model, geometry="nonlinear", factors=factors, **options)  # type: ignore[arg-type]


@pytest.mark.parametrize("method", ["direct", "multigrid"])
def test_a_body_that_would_buckle_is_told_of(method: str) -> None:
    case = pressed_column((20, 1, 1), 10.0, 0.0)
    found = large(case.model, [0.24, 0.251], method=method)
    wanted = [step for step in found.steps if step.wanted]
    # the linear estimate is a factor of 0.2467
    assert [step.iterations[-1].definite for step in wanted] == [True, False]
    assert "1 load steps, first number 2" in found.warnings[0] and "buckle" in found.warnings[0]
    assert not large(case.model, [0.24], method=method).warnings


def pressed_tube(share: float) -> Model:
    """A quarter of a long tube under ``share`` of the outer pressure at which it becomes oval, 3 E
    I / R^3 with E / (1 - nu^2) for E (Timoshenko & Gere, Theory of Elastic Stability, 7.5). By a
    pressure that keeps its directions it would take 4 E I / R^3."""
    radius, wall, law = 10.0, 0.5, Isotropic(1000.0, 0.3)
    flat = quadratic(box((0.5 * np.pi, wall, 1.0), (12, 1, 1)))
    angle, r = flat.points[:, 0], radius - 0.5 * wall + flat.points[:, 1]
    round_ = np.stack([r * np.sin(angle), r * np.cos(angle), flat.points[:, 2]], axis=1)
    mesh = flat.moved(round_ - flat.points)
    fixed = np.stack([angle == 0.0, angle == 0.5 * np.pi, np.ones(len(r), dtype=bool)], axis=1)
    critical = 0.25 * law.E / (1.0 - law.nu**2) * (wall / radius) ** 3
    load = FollowerPressure(select_faces(mesh, name="y_max"), share * critical)
    return Model(mesh, law, fixed, loads=load)


def end_pressed_bar(alpha: float, guided: bool) -> Model:
    """Clamped bar with a pressure on its end that makes up P L^2 / E I = ``alpha``; nodes of the
    end move along the bar only, or are free."""
    mesh = box((100.0, 5.0, 5.0), (20, 1, 1))
    x = mesh.points[:, 0]
    fixed = np.stack([x == 0.0, *[(x == 0.0) | guided & (x == 100.0)] * 2], axis=1)
    load = FollowerPressure(select_faces(mesh, name="x_max"), alpha * 1e4 * 25.0 / 12.0 / 1e4)
    return Model(mesh, Isotropic(1e4, 0.0), fixed, loads=load)


@pytest.mark.parametrize(
    ("build", "critical"),
    [(pressed_tube, 1.0), (lambda alpha: end_pressed_bar(alpha, True), 4.493**2)],
)
def test_what_follows_with_a_potential_buckles_as_in_the_books(
    build: Callable[[float], Model], critical: float
) -> None:
    below, beyond = (large(build(share * critical), [0.5, 1.0]) for share in (0.97, 1.03))
    assert not below.warnings and "number 2" in beyond.warnings[0]
    assert "isn't stable: the body would buckle" in beyond.warnings[0]


def test_a_pressure_that_turns_with_a_free_end_does_not_buckle() -> None:
    """Beck's bar, which has no other equilibrium (and beyond 20.05 E I / L^2 flutters); its
    stiffness is unsymmetric, and twice Euler's load leaves the symmetric part definite."""
    assert not large(end_pressed_bar(5.0, False), [0.5, 1.0]).warnings
    (warning,) = large(end_pressed_bar(19.0, False), [0.2, 1.0]).warnings
    assert "1 load steps, first number 2" in warning and "may not be stable" in warning


def test_metal_in_cells_that_lock_is_warned_of() -> None:
    steel = J2(Isotropic(210e3, 0.3), 250.0, 2000.0)
    block = gs.mesh.split(box((1.0, 1.0, 1.0), (1, 1, 1)), "tet4")
    fixed = np.repeat(block.points[:, :1] == 0.0, 3, axis=1)
    model = Model(block, steel, fixed, np.where(fixed, 0.0, 1.0))
    (told,) = large(model).warnings
    assert told.startswith("6 tet4 ('full') can't flow at constant volume")


def pulled(law: Isotropic | Law, direction: int, way: float) -> Model:
    """A cube between rough plates, one of which moves along x, or aside."""
    mesh = box((1.0, 1.0, 1.0), (1, 1, 1))
    fixed = np.repeat((mesh.points[:, :1] == 0.0) | (mesh.points[:, :1] == 1.0), 3, axis=1)
    moved = (mesh.points[:, :1] == 1.0) & (np.arange(3) == direction)
    return Model(mesh, law, fixed, prescribed=np.where(moved, way, 0.0))


def test_strain_that_a_linear_law_is_not_meant_for_is_told() -> None:
    law = Isotropic(1.0, 0.0)
    assert not large(pulled(law, 0, 0.019)).warnings
    (told,) = large(pulled(law, 0, 0.03)).warnings
    assert told.startswith("1 cells are strained by up to 3.00%: linear elastic laws")
    assert not large(pulled(NeoHookean(1.0, 0.0), 0, 0.03)).warnings


def test_a_corner_that_is_turned_inside_out_is_told() -> None:
    """Which no integration point of the cell has seen."""
    mesh = box((1.0, 1.0, 1.0), (1, 1, 1))
    held = np.ones(mesh.points.shape, dtype=bool)
    corner = (mesh.points == 1.0).all(axis=1)
    pushed = -0.7 * np.repeat(corner[:, None], 3, axis=1)
    model = Model(mesh, NeoHookean(1.0, 0.3), held, prescribed=pushed)
    (told,) = large(model).warnings
    assert told == "1 cells are turned inside out at a corner"
    assert not large(replace(model, prescribed=0.4 * pushed)).warnings


def test_flow_in_long_steps_is_told_by_how_much() -> None:
    steel = J2(Isotropic(200e3, 0.3), 200.0, 1000.0)
    (told,) = large(pulled(steel, 2, 0.3)).warnings
    assert told.startswith("plastic strain grows by up to 0.17 in one step: where its direction")
    assert "stress may be 1.2% off" in told
    assert not large(pulled(steel, 2, 0.3), [0.34, 0.67, 1.0]).warnings
