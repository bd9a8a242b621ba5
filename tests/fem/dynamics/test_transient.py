"""Transients: loads of every kind, moving grounds, and arguments that can't be used."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.errors import InputError, NotConverged
from tests.support.vibrating_bar import SOFT, greatest, vibrating_bar

Float = npt.NDArray[np.float64]
TIMES = np.linspace(0.0, 3.0, 13)
STEPS: tuple[dict[str, Any], ...] = (
    {"count": 36},
    {"method": "newmark", "step": 0.05},
    {"method": "hht", "step": 0.05},
    {"method": "generalized-alpha", "step": 0.05},
)


def same(one: gs.History, other: gs.History, tolerance: float = 1e-9) -> None:
    assert greatest(one.u - np.asarray(other.u), one.u) <= tolerance
    assert greatest(one.v - np.asarray(other.v), one.v) <= tolerance


@pytest.mark.parametrize("options", STEPS)
def test_loads_are_the_same_however_they_are_said(options: dict[str, Any]) -> None:
    model = vibrating_bar()
    values = np.outer(np.minimum(TIMES, 1.5), [1.0, -0.5])
    bend = gs.Record([-1.0, 0.0, 1.5, 4.0], np.outer([-1.0, 0.0, 1.5, 1.5], [1.0, -0.5]))
    table, record = (
        gs.transient(model, times=TIMES, loads=loads, **options) for loads in (values, bend)
    )
    same(table, record)
    single = replace(model, forces=model.load_cases[0] - 0.5 * model.load_cases[1])
    same(table, gs.transient(single, times=TIMES, loads=values[:, 0], **options))
    ones = gs.transient(single, times=TIMES, loads=np.ones(13), **options)
    same(ones, gs.transient(single, times=TIMES, **options))


@pytest.mark.parametrize("options", STEPS)
def test_a_moving_ground_is_a_force_of_inertia(options: dict[str, Any]) -> None:
    model = vibrating_bar()
    axes = np.array([0.3, -1.0, 0.5])
    quake = gs.Record([0.0, 0.7, 1.1, 5.0], np.outer([0.0, 2.0, -1.0, 0.5], axes))
    shaken = gs.transient(model, times=TIMES, loads=np.zeros((13, 2)), base=quake, **options)
    pushed = replace(model, forces=-gs.fem.body_force(model.mesh, SOFT.density, axes))
    factors = gs.Record(quake.times, quake.values[:, 2] / axes[2])
    same(shaken, gs.transient(pushed, times=TIMES, loads=factors, **options), 1e-8)
    # beside loads
    both = gs.transient(model, times=TIMES, base=quake, **options)
    alone = gs.transient(model, times=TIMES, **options)
    assert greatest(both.u - np.asarray(alone.u) - shaken.u, both.u) <= 1e-8


def test_a_lumped_mass_moves_with_the_ground_as_it_weighs() -> None:
    model = vibrating_bar()
    quake = gs.Record([0.0, 3.0], [[0.0, 0.0, 1.0]] * 2)
    still = np.zeros((13, 2))
    shaken = gs.transient(model, times=TIMES, loads=still, base=quake, mass="lumped", count=36)
    weight = np.zeros(model.mesh.points.shape)
    weight[:, 2] = -gs.fem.lumped_mass(model)
    pushed = gs.transient(replace(model, forces=weight), times=TIMES, mass="lumped", count=36)
    same(shaken, pushed, 1e-8)


def test_a_moving_load_is_a_case_for_each_place() -> None:
    # over a string of nodes, at a speed of 1
    model = vibrating_bar((6, 1, 1))
    line = np.flatnonzero((model.mesh.points[:, 1:] == [0.0, 1.0]).all(axis=1))
    line = line[np.argsort(model.mesh.points[line, 0])]
    places = model.mesh.points[line, 0]
    forces = np.zeros((len(line), *model.mesh.points.shape))
    forces[np.arange(len(line)), line, 2] = -1.0
    # hat functions: where it is between two nodes, both carry it
    factors = gs.Record(places, np.eye(len(line)))
    rolled = replace(model, forces=forces)
    times = np.linspace(0.0, 3.0, 31)
    exact = gs.transient(rolled, times=times, loads=factors, count=72)
    assert np.allclose(factors.at(times).sum(axis=1), 1.0)
    stepped = gs.transient(rolled, times=times, loads=factors, method="newmark", step=0.0125)
    assert greatest(stepped.u - np.asarray(exact.u), exact.u) <= 1e-2
    # slowly it is a static load that moves
    slow = gs.transient(
        rolled, times=200.0 * times, loads=gs.Record(200.0 * places, np.eye(len(line))),
        damping=gs.ModalDamping(0.5), count=40,
    )  # fmt: skip
    static = np.asarray(gs.solve(rolled).u)
    assert greatest(slow.u[-1] - static[-1], static[-1]) <= 1e-2


def test_a_short_impact_gives_its_impulse() -> None:
    model = vibrating_bar(fixed=False)
    impulse, duration = 0.2, 0.02
    blow = gs.Record(
        [0.0, 0.5 * duration, duration, 4.0],
        np.outer([0.0, 2.0 * impulse / duration, 0.0, 0.0], [0.0, 1.0]),
    )
    weight = 3.0 * 0.8
    for options in ({"count": 30}, {"method": "newmark", "step": duration / 4.0}):
        history = gs.transient(model, times=[0.0, duration, 3.0], loads=blow, **options)  # type: ignore[arg-type]
        mass = gs.fem.lumped_mass(model)
        momentum = np.tensordot(mass, np.asarray(history.v), axes=(0, 1))
        assert np.allclose(momentum[1:], [impulse, 0.0, 0.0], atol=1e-9 + 1e-6 * weight)


WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "decreasing times": ({"times": [0.0, 1.0, 0.5]}, "got 0.5 after 1, number 2; expected times"),
    "one time": ({"times": [0.0]}, "at least 2"),
    "NaN in times": ({"times": [0.0, np.nan]}, "times"),
    "NaN in loads": ({"loads": np.full((13, 2), np.nan)}, "loads"),
    "too few factors": ({"loads": np.ones(13)}, "loads"),
    "a short record": ({"loads": gs.Record([0.0, 1.0], np.ones((2, 2)))}, "to 1; expected 0 to 3"),
    "a narrow record": ({"loads": gs.Record([0.0, 3.0], [1.0, 1.0])}, "2, one for each load case"),
    "a narrow ground": ({"base": gs.Record([0.0, 3.0], [1.0, 1.0])}, "3 accelerations"),
    "a short ground": ({"base": gs.Record([0.0, 1.0], np.ones((2, 3)))}, "transient: base: times"),
    "a long step": ({"method": "newmark", "step": 4.0}, "too long"),
    "a step that misses the loads": ({
        "method": "newmark", "step": 0.5,
        "loads": gs.Record([0.0, 1.1, 1.2, 1.3, 3.0], np.outer([0, 0, 9, 0, 0], [1, 1])),
    }, "too long; got 0.5, which misses 100% of a load"),
    "a blow beside a weight": ({
        "method": "newmark", "step": 0.5,
        "loads": gs.Record([0.0, 1.1, 1.2, 1.3, 3.0], [[9, 0], [9, 0], [9, 1], [9, 0], [9, 0]]),
    }, "too long; got 0.5, which misses 100% of a load"),
    "a blow that no step meets": ({
        "method": "newmark",
        "loads": gs.Record([0, 1, 1 + 1e-9, 1 + 2e-9, 3], np.outer([0, 0, 9, 0, 0], [1, 1])),
    }, "too long"),
    "a step of modes": ({"step": 1e-3}, "step of method 'modal'; got 0.001; expected None"),
    "unknown velocities": ({"initial": (np.zeros((16, 3)), np.full((16, 3), np.nan))}, "not all"),
    "no step": ({"method": "newmark", "step": "long"}, "step"),
    "a negative step": ({"method": "newmark", "step": -0.1}, "step"),
    "a NaN step": ({"method": "newmark", "step": np.nan}, "step"),
    "structural damping": ({"damping": gs.StructuralDamping(0.1)}, "harmonic"),
    "modal damping of steps": ({"method": "hht", "damping": gs.ModalDamping(0.1)}, "Rayleigh"),
    "damped rotations": ({
        "method": "hht", "geometry": "nonlinear", "damping": gs.Rayleigh(0.1, 0.1),
    }, "rotations"),
    "modes at large displacements": ({"geometry": "nonlinear"}, "large displacements"),
    "a radius of HHT": ({"method": "hht", "spectral_radius": 0.3}, "0.5 to 1"),
    "a lone displacement": ({"initial": np.zeros((16, 3))}, "initial"),
    "short displacements": ({"initial": (np.zeros((4, 3)), np.zeros((4, 3)))}, "initial"),
    "fixed nodes that move": ({"initial": (np.ones((16, 3)), np.zeros((16, 3)))}, "fixed nodes"),
    "an unknown method": ({"method": "euler"}, "method"),
    "no model": ({"model": None}, "model"),
    "a function": ({"loads": lambda t: [t, t]}, "loads"),
    "damping by a number": ({"damping": 0.1}, "damping"),
    "progress by a number": ({"progress": 3}, "progress"),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG)
def test_what_cannot_be_used_is_refused(case: str) -> None:
    changes, told = WRONG[case]
    given = {"model": vibrating_bar(), "times": TIMES, **changes}
    with pytest.raises(InputError, match=told):
        gs.transient(**given)


def test_supports_that_move_and_missing_densities_are_refused() -> None:
    model = vibrating_bar()
    assert model.fixed is not None
    moved = replace(model, prescribed=np.where(model.fixed, 0.1, 0.0))
    with pytest.raises(InputError, match="base"):
        gs.transient(moved, times=TIMES)
    with pytest.raises(InputError, match="density"):
        gs.transient(replace(model, materials=[gs.Isotropic(1.0, 0.3)]), times=TIMES)
    pinned = gs.fem.equations(model.mesh, [([(15, "x", 1.0)], 0.1)])
    with pytest.raises(InputError, match="right = 0"):
        gs.transient(replace(model, constraints=[pinned]), times=TIMES)
    held = replace(model, constraints=[gs.fem.equations(model.mesh, [([(15, "x", 1.0)], 0.0)])])
    moving = np.where(model.fixed, 0.0, 1.0)
    with pytest.raises(InputError, match="against constraints"):
        gs.transient(held, times=TIMES, initial=(moving, 0.0 * moving))


def test_modes_that_are_poor_carry_no_motion(monkeypatch: pytest.MonkeyPatch) -> None:
    model = vibrating_bar()
    poor = replace(gs.modes(model, 3), converged=False, message="no luck")
    monkeypatch.setattr("gpusim.fem.dynamics.transient.modes", lambda *_, **__: poor)
    with pytest.raises(NotConverged, match="modes; got no luck"):
        gs.transient(model, times=TIMES)


@pytest.mark.parametrize("method", ["modal", "newmark"])
def test_why_a_body_drifts_on_a_moving_ground_is_said(method: str) -> None:
    bar = gs.mesh.box((1.0, 0.1, 0.1), (4, 1, 1))
    held = np.isclose(bar.points[:, :1], 0.0).repeat(3, axis=1)
    steel, times = gs.Isotropic(210e9, 0.3, density=7850.0), np.linspace(0.0, 1.0, 401)
    options = {"times": times, "method": method, "step": None if method == "modal" else 2.5e-3}

    def warnings(model: gs.Model, course: Float) -> tuple[str, ...]:
        ground = gs.Record(times, np.outer(course, [0.0, 1.0, 0.0]))
        found = gs.transient(model, base=ground, loads=0.0 * times, count=8, **options)
        return tuple(text for text in found.warnings if "base" in text)

    to_and_fro, away = np.cos(40.0 * np.pi * times), np.sin(40.0 * np.pi * times)
    assert warnings(gs.Model(bar, steel, held), to_and_fro) == ()
    # 1 / omega, for a second
    (gone,) = warnings(gs.Model(bar, steel, held), away)
    assert "goes away along y, by 0.00789" in gone and "mean velocity of 0.00789" in gone
    (loose,) = warnings(gs.Model(bar, steel), to_and_fro)
    assert "supports leave the body free" in loose
